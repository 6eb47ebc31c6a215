-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library std;
  use std.textio.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Text output of test benches; docs/hardware.md, "Trace". Not for synthesis.

package pe_trace_pkg is

  -- Hex digits without leading zeros, lower case.

  function hex (
    value : std_ulogic_vector
  ) return string;

  -- Prints `t` lines for the memory writes in a network's trace and adds their number to `checks`.

  procedure print_trace (
    trace     : in    std_ulogic_vector;
    cycle     : in    natural;
    own_words : in    natural_array_t;
    word_bits : in    positive;
    data_bits : in    positive;
    checks    : inout natural
  );

  -- Prints a `v` line for every PE whose sticky flag is set.

  procedure print_overflow (
    trace : in std_ulogic_vector;
    pes   : in positive
  );

  -- Prints one line.

  procedure print (
    text_line : in string
  );

  -- Reads a line of hexadecimal words; the first one goes into the lowest bits.

  procedure read_words (
    file source : text;
    bits        : in    positive;
    words       : out   std_ulogic_vector
  );

  -- The next 16 pseudo-random bits, not all 0.

  function next_random (
    random : unsigned
  ) return unsigned;

end package pe_trace_pkg;

package body pe_trace_pkg is

  function hex (
    value : std_ulogic_vector
  ) return string is

    constant DIGITS : string(1 to 16)                           := "0123456789abcdef";
    constant COUNT  : positive                                  := (value'length + 3) / 4;
    constant PADDED : std_ulogic_vector(4 * COUNT - 1 downto 0) := std_ulogic_vector(resize(unsigned(value), 4 * COUNT));

    variable text_value : string(1 to COUNT);
    variable first      : positive;

  begin

    assert not is_x(value)
      report "undefined value"
      severity failure;

    for i in 1 to COUNT loop

      text_value(i) := DIGITS(to_integer(unsigned(PADDED(4 * (COUNT - i) + 3 downto 4 * (COUNT - i)))) + 1);

    end loop;

    first := 1;
    while first < COUNT and text_value(first) = '0' loop
      first := first + 1;
    end loop;
    return text_value(first to COUNT);

  end function hex;

  procedure print (
    text_line : in string
  ) is

    variable buffered : line;

  begin

    write(buffered, text_line);
    writeline(output, buffered);

  end procedure print;

  -- The bits of a field from its lowest one on.

  function field (
    trace : std_ulogic_vector;
    lsb   : natural;
    width : positive
  ) return std_ulogic_vector is
  begin

    return trace(lsb + width - 1 downto lsb);

  end function field;

  procedure print_trace (
    trace     : in    std_ulogic_vector;
    cycle     : in    natural;
    own_words : in    natural_array_t;
    word_bits : in    positive;
    data_bits : in    positive;
    checks    : inout natural
  ) is

    variable first   : natural;
    variable address : natural;

  begin

    if (trace(trace'high) /= '1') then
      return;
    end if;

    for pe in own_words'range loop

      first := pe * TRACE_BITS;

      if (trace(first + TRACE_OWN_WRITE) = '1') then
        address := to_integer(unsigned(field(trace, first + TRACE_OWN_ADDRESS, TRACE_ADDRESS_BITS)));
        print("t " & integer'image(cycle) & " " & integer'image(pe) & " "
              & hex(std_ulogic_vector(to_unsigned(address, 17))) & " "
              & hex(field(trace, first + TRACE_OWN_VALUE, word_bits)));
        checks  := checks + 1;
      end if;

      if (trace(first + TRACE_IMPORTED_WRITE) = '1') then
        address := own_words(pe)
                   + to_integer(unsigned(field(trace, first + TRACE_IMPORTED_ADDRESS, TRACE_ADDRESS_BITS)));
        print("t " & integer'image(cycle) & " " & integer'image(pe) & " "
              & hex(std_ulogic_vector(to_unsigned(address, 17))) & " "
              & hex(field(trace, first + TRACE_IMPORTED_VALUE, data_bits)));
        checks  := checks + 1;
      end if;

    end loop;

  end procedure print_trace;

  procedure print_overflow (
    trace : in std_ulogic_vector;
    pes   : in positive
  ) is
  begin

    if (trace'length > 1) then

      for pe in 0 to pes - 1 loop

        if (trace(pe * TRACE_BITS + TRACE_OVERFLOW) = '1') then
          print("v " & integer'image(pe));
        end if;

      end loop;

    end if;

  end procedure print_overflow;

  procedure read_words (
    file source : text;
    bits        : in    positive;
    words       : out   std_ulogic_vector
  ) is

    variable fields : line;
    variable word   : std_ulogic_vector((bits + 3) / 4 * 4 - 1 downto 0);

  begin

    readline(source, fields);

    for i in 0 to words'length / bits - 1 loop

      hread(fields, word);
      words((i + 1) * bits - 1 downto i * bits) := word(bits - 1 downto 0);

    end loop;

  end procedure read_words;

  function next_random (
    random : unsigned
  ) return unsigned is
  begin

    return random(14 downto 0) & (random(15) xor random(13) xor random(12) xor random(10));

  end function next_random;

end package body pe_trace_pkg;
