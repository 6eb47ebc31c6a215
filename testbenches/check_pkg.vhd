-- SPDX-License-Identifier: MIT OR Apache-2.0

-- How test benches check and count. Not for synthesis.

package check_pkg is

  -- Ends the simulation unless `holds`; `checks` counts how often it was asked.

  procedure check (
    checks : inout natural;
    what   : in    string;
    holds  : in    boolean
  );

end package check_pkg;

package body check_pkg is

  procedure check (
    checks : inout natural;
    what   : in    string;
    holds  : in    boolean
  ) is
  begin

    checks := checks + 1;

    assert holds
      report what
      severity failure;

  end procedure check;

end package body check_pkg;
