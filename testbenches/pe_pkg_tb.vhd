-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library std;
  use std.env.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_write_pkg.all;
  use pe_lib.pe_trace_pkg.all;

library work;
  use work.check_pkg.all;

-- Functions of pe_pkg and pe_write_pkg: layout, selection, latency, segments.

entity pe_pkg_tb is
end entity pe_pkg_tb;

architecture bench of pe_pkg_tb is

begin

  p_check : process is

    variable checks  : natural;
    variable layout  : layout_t;
    variable entries : std_ulogic_vector(40 * 6 - 1 downto 0);
    variable picked  : std_ulogic_vector(5 downto 0);

    variable ordinal_bits : natural;

    variable octave   : natural;
    variable mantissa : natural;

  begin

    checks := 0;

    -- Widths
    check(checks, "index_bits(1)", index_bits(1) = 0);
    check(checks, "index_bits(2)", index_bits(2) = 1);
    check(checks, "index_bits(5)", index_bits(5) = 3);
    check(checks, "index_bits(64)", index_bits(64) = 6);

    -- own 1+5, imported 1+5, coefficient 18, close 1, base 1+5, shift 2, write 2+5, send 1, receive 1+5, port 2
    layout := control_layout(32, 32, 0, 32, 4, 4, 18, false, false, true, 0, false);
    check(checks, "plain layout", layout.bits = 55);
    check(checks, "own_enable is the top bit", layout.own.enable.lsb = 54 and layout.own.enable.width = 1);
    check(checks, "port is at the bottom", layout.port_index.lsb = 0 and layout.port_index.width = 2);
    check(checks, "coefficient", layout.coefficient.lsb = 25 and layout.coefficient.width = 18);
    check(checks, "absent coefficient memory", layout.coefficient_address.width = 0 and layout.write_factor.width = 0);
    check(checks, "absent flag reads 0", flag((54 downto 0 => '1'), layout.write_factor) = '0');
    layout := control_layout(32, 16, 16, 32, 4, 4, 18, true, true, true, 0, false);
    check(checks, "full layout", layout.bits = 45);
    layout := control_layout(2, 2, 0, 0, 0, 1, 25, false, false, false, 0, false);
    check(checks, "smallest layout", layout.bits = 2 + 25 + 1 + 2 + 3);
    layout := control_layout(2, 2, 0, 0, 0, 1, 25, false, false, false, 8, false);
    check(checks, "layout with indices", layout.bits = 2 + 25 + 1 + 2 + 3 + 2 * (1 + 3) and layout.write_octave.width = 0);
    layout := control_layout(2, 2, 0, 0, 0, 1, 25, false, false, false, 8, true);
    check(checks, "layout with octaves", layout.bits = 2 + 25 + 1 + 2 + 3 + 2 * (1 + 3) + 1);

    -- Indices: words of ten bits, counted down from the largest in steps that the definition says.
    for i in -512 to 511 loop

      check(checks, "equal segment",
            to_integer(unsigned(equal_segment(std_ulogic_vector(to_signed(i, 10)), 3))) = (i + 512) / 128);

      octave := 0;
      while (octave < 3 and i < 2 ** (8 - octave)) loop
        octave := octave + 1;
      end loop;

      -- Two bits behind the leading one; in the last octave, below 64, the two upper ones of six.
      mantissa := larger(i, 0) / 16;

      if (octave < 3) then
        mantissa := (i - 2 ** (8 - octave)) / 2 ** (6 - octave);
      end if;

      check(checks, "octave segment",
            to_integer(unsigned(octave_segment(std_ulogic_vector(to_signed(i, 10)), 4, 2))) = 4 * octave + mantissa);

    end loop;

    -- Selection
    for i in 0 to 39 loop

      entries((i + 1) * 6 - 1 downto i * 6) := std_ulogic_vector(to_unsigned(63 - i, 6));

    end loop;

    for count in 1 to 40 loop

      ordinal_bits := larger(index_bits(count), 1);

      for i in 0 to 2 ** ordinal_bits - 1 loop

        picked := chosen(entries(count * 6 - 1 downto 0), std_ulogic_vector(to_unsigned(i, ordinal_bits)), 6);

        if (i < count) then
          check(checks, "chosen", picked = std_ulogic_vector(to_unsigned(63 - i, 6)));
        elsif (count > 1) then
          check(checks, "nothing to choose", picked = "000000");
        end if;

      end loop;

    end loop;

    -- Latency
    check(checks, "single block", multiplier_latency(25, 18) = 1 and multiplier_latency(18, 25) = 1);
    check(checks, "several blocks", multiplier_latency(32, 18) = 3 and multiplier_latency(25, 25) = 3);
    check(checks, "pause word", pause_word(1) = 7 and pause_word(3) = 9);

    -- Text
    check(checks, "hex", hex("0000000000101111") = "2f" and hex("00000") = "0" and hex("1000000000000000000000000") = "1000000");

    print("checks " & integer'image(checks));
    finish;

  end process p_check;

end architecture bench;
