-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Functions of the write side: shifted sums, segments of written words, and addresses of rings; see docs/hardware.md.

package pe_write_pkg is

  -- First shift position of the second and of the third group of a number of positions.

  function first_of_mid (
    count : positive
  ) return positive;

  function first_of_high (
    count : positive
  ) return positive;

  -- The shifted sums, each `width` bits, of `count` shift positions from `first` on, the first one rightmost.

  function shifted (
    value  : signed;
    shifts : natural_array_t;
    first  : natural;
    count  : positive;
    left   : natural;
    width  : positive
  ) return std_ulogic_vector;

  -- Which of 2**index_width equal parts of the range of all words a word is in.

  function equal_segment (
    word        : std_ulogic_vector;
    index_width : positive
  ) return std_ulogic_vector;

  -- The same for a range from 0 on that is halved again and again: the upper `octave_width` bits are the number of
  -- zeros in front of the leading one, the others the bits behind it. The last octave takes all words below it, and
  -- its bits begin at the place of the leading one. Negative words count as 0.

  function octave_segment (
    word         : std_ulogic_vector;
    index_width  : positive;
    octave_width : positive
  ) return std_ulogic_vector;

  -- An address of a ring, if `ring` is '1': the number of the step is added to its `count` lowest bits.

  function turned (
    address : std_ulogic_vector;
    ring    : std_ulogic;
    turn    : std_ulogic_vector;
    count   : natural
  ) return std_ulogic_vector;

end package pe_write_pkg;

package body pe_write_pkg is

  function first_of_mid (
    count : positive
  ) return positive is
  begin

    if (count <= 3) then
      return 1;
    end if;

    return 4;

  end function first_of_mid;

  function first_of_high (
    count : positive
  ) return positive is
  begin

    if (count = 3 or count = 6) then
      return count - 1;
    end if;

    return 8;

  end function first_of_high;

  function shifted (
    value  : signed;
    shifts : natural_array_t;
    first  : natural;
    count  : positive;
    left   : natural;
    width  : positive
  ) return std_ulogic_vector is

    variable entries : std_ulogic_vector(count * width - 1 downto 0);
    variable source  : integer;

  begin

    for entry in 0 to count - 1 loop

      for i in 0 to width - 1 loop

        source := i + shifts(shifts'low + first + entry) - 1 - left;

        if (source < 0) then
          entries(entry * width + i) := '0';
        elsif (source > value'high) then
          entries(entry * width + i) := value(value'high);
        else
          entries(entry * width + i) := value(source);
        end if;

      end loop;

    end loop;

    return entries;

  end function shifted;

  function equal_segment (
    word        : std_ulogic_vector;
    index_width : positive
  ) return std_ulogic_vector is

    variable index : std_ulogic_vector(index_width - 1 downto 0);

  begin

    index                  := word(word'high downto word'high - index_width + 1);
    index(index_width - 1) := not index(index_width - 1);
    return index;

  end function equal_segment;

  function octave_segment (
    word         : std_ulogic_vector;
    index_width  : positive;
    octave_width : positive
  ) return std_ulogic_vector is

    constant LAST          : positive := 2 ** octave_width - 1;
    constant MANTISSA_BITS : natural  := index_width - octave_width;

    variable rest   : std_ulogic_vector(LAST + MANTISSA_BITS downto 0);
    variable octave : std_ulogic_vector(octave_width - 1 downto 0);
    variable empty  : std_ulogic;

  begin

    -- The sign is not needed: a negative word has no leading one.
    rest := word(word'high - 1 downto word'high - 1 - LAST - MANTISSA_BITS) and (rest'range => not word(word'high));

    for i in octave_width - 1 downto 0 loop

      empty := not (or rest(rest'high downto rest'high - 2 ** i + 1));

      if (empty = '1') then
        rest := rest(rest'high - 2 ** i downto 0) & (2 ** i - 1 downto 0 => '0');
      end if;

      octave(i) := empty;

    end loop;

    if ((and octave) = '0') then
      rest := rest(rest'high - 1 downto 0) & '0';
    end if;

    return octave & rest(rest'high downto rest'high - MANTISSA_BITS + 1);

  end function octave_segment;

  function turned (
    address : std_ulogic_vector;
    ring    : std_ulogic;
    turn    : std_ulogic_vector;
    count   : natural
  ) return std_ulogic_vector is

    variable value : std_ulogic_vector(address'length - 1 downto 0);
    variable added : std_ulogic_vector(turn'length - 1 downto 0);

  begin

    value := address;

    if (count > 0) then
      added                     := turn and (turn'range => ring);
      value(count - 1 downto 0) := std_ulogic_vector(unsigned(value(count - 1 downto 0))
                                                     + unsigned(added(count - 1 downto 0)));
    end if;

    return value;

  end function turned;

end package body pe_write_pkg;
