-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_write_pkg.all;

-- Purpose:  The write side of a PE up to the word that the write group stores: base word and shift, addition,
--           saturation.
-- Generics: SHIFTS ascend. The number of words of a memory is a power of two; INDEX_WORDS may be 0.
-- Timing:   docs/hardware.md, "Timing", scale group: word_o is loaded two clocks after the control word with base and
--           shift, with DEEP three. All registers hold in clocks without advance_i.

entity pe_scale is
  generic (
    WORD_BITS        : positive;        -- stored word, guard bits included
    DATA_BITS        : positive;        -- data port of the multiplier
    COEFFICIENT_BITS : positive;        -- coefficient port of the multiplier
    CONTROL_BITS     : positive;        -- control word
    LAYOUT           : layout_t;        -- its fields
    BASE_WORDS       : positive;        -- base memory, a power of two
    SHIFTS           : natural_array_t; -- right shifts
    ACCUMULATOR_BITS : positive;        -- running sum
    BASE_IMAGE       : word_array_t;    -- initial base memory
    INDEX_WORDS      : natural;         -- index memory, 0 or a power of two
    INDEX_WIDTH      : natural;         -- bits of an index
    OCTAVE_WIDTH     : natural;         -- bits of an index that count octaves, 0 if none do
    SATURATE         : boolean;         -- clamps words that are out of range; false if none can be
    ACCESS_STATES    : boolean;         -- states can be read and replaced
    DEEP             : boolean          -- a register behind base memory and shifts
  );
  port (
    clk_i           : in    std_ulogic;                                             -- clock
    advance_i       : in    std_ulogic;                                             -- executes the control word
    control_i       : in    std_ulogic_vector(CONTROL_BITS - 1 downto 0);           -- control register
    hold_i          : in    signed(ACCUMULATOR_BITS - 1 downto 0);                  -- sum of the last chain
    write_base_i    : in    std_ulogic;                                             -- the base memory takes the word
    write_index_i   : in    std_ulogic;                                             -- the index memory takes its segment
    write_address_i : in    std_ulogic_vector(index_bits(BASE_WORDS) - 1 downto 0); -- base word to write
    replace_i       : in    std_ulogic;                                             -- words are their replacements
    replacement_i   : in    std_ulogic_vector(WORD_BITS downto 0);                  -- less the offset, 0 without replace_i
    look_i          : in    std_ulogic;                                             -- the base memory is read for the host
    look_here_i     : in    std_ulogic;                                             -- in this PE
    look_address_i  : in    std_ulogic_vector(index_bits(BASE_WORDS) - 1 downto 0); -- base word to read
    base_o          : out   std_ulogic_vector(WORD_BITS - 1 downto 0);              -- base word that was read
    word_o          : out   std_ulogic_vector(WORD_BITS - 1 downto 0);              -- word of the write group
    saturated_o     : out   std_ulogic                                              -- it saturated
  );
end entity pe_scale;

architecture rtl of pe_scale is

  constant BASE_BITS : positive := index_bits(BASE_WORDS);

  -- Constant left shift of the sum, for words that are wider than products; right shifts count from here.
  constant LEFT : natural := larger(WORD_BITS + 2 - DATA_BITS - COEFFICIENT_BITS, 0);

  -- Shifted sums keep one bit below the word's LSB, which rounds; the sum keeps every upper bit.
  constant SHIFTED_BITS : positive := ACCUMULATOR_BITS + LEFT - smallest(SHIFTS) + 1;
  constant SUM_BITS     : positive := larger(WORD_BITS + 1, SHIFTED_BITS) + 1;

  -- Upper bits of a saturated word that tell its sign; the others are 0.
  constant CEILING_BITS : positive := 8;

  -- A six-input lookup table chooses among four shift positions, and the adder's tables have room for one more choice
  -- among three. So the positions go in up to three groups of at most four; groups of one cost no table.
  constant SHIFT_COUNT : positive := SHIFTS'length;
  constant SHIFT_BITS  : natural  := index_bits(SHIFT_COUNT);

  constant FIRST_MID   : positive := first_of_mid(SHIFT_COUNT);
  constant FIRST_HIGH  : positive := first_of_high(SHIFT_COUNT);
  constant HIGH_SHIFTS : natural  := larger(SHIFT_COUNT - FIRST_HIGH, 0);
  constant MID_SHIFTS  : natural  := larger(SHIFT_COUNT - FIRST_MID, 0) - HIGH_SHIFTS;

  signal offset    : std_ulogic_vector(WORD_BITS - 1 downto 0);
  signal indexed   : std_ulogic_vector(BASE_BITS - 1 downto 0);
  signal address   : std_ulogic_vector(BASE_BITS - 1 downto 0);
  signal enable    : std_ulogic;
  signal based     : std_ulogic;
  signal write     : std_ulogic;
  signal base      : std_ulogic_vector(WORD_BITS - 1 downto 0);
  signal position  : unsigned(larger(SHIFT_BITS, 1) - 1 downto 0) := (others => '0');
  signal use_mid   : std_ulogic                                   := '0';
  signal use_high  : std_ulogic                                   := '0';
  signal low_sum   : std_ulogic_vector(SHIFTED_BITS - 1 downto 0);
  signal mid_sum   : std_ulogic_vector(SHIFTED_BITS - 1 downto 0);
  signal high_sum  : std_ulogic_vector(SHIFTED_BITS - 1 downto 0);
  signal increment : std_ulogic_vector(SHIFTED_BITS - 1 downto 0);
  signal addend    : std_ulogic_vector(SHIFTED_BITS - 1 downto 0);
  signal sum       : signed(SUM_BITS - 1 downto 1)                := (others => '0');
  signal word      : std_ulogic_vector(WORD_BITS - 1 downto 0)    := (others => '0');
  signal saturated : std_ulogic                                   := '0';

begin

  -- Half an LSB of the data port is the base of a word without one. Bit by bit: GHDL 2.0 writes wide constants as
  -- character strings into Verilog.

  g_offset : for i in 0 to WORD_BITS - 1 generate

    offset(i) <= '1' when i = WORD_BITS - DATA_BITS - 1 else
                 '0';

  end generate g_offset;

  u_base : entity pe_lib.pe_ram
    generic map (
      WORDS     => BASE_WORDS,
      WORD_BITS => WORD_BITS,
      IMAGE     => BASE_IMAGE,
      DEEP      => DEEP
    )
    port map (
      clk_i           => clk_i,
      ce_i            => enable,
      write_enable_i  => write,
      write_address_i => write_address_i,
      write_data_i    => word,
      read_enable_i   => based,
      read_address_i  => address,
      default_i       => offset,
      read_data_o     => base
    );

  -- A replaced word has no base but the offset.

  g_accessed : if ACCESS_STATES generate

    enable  <= advance_i or look_i;
    write   <= write_base_i and not look_i;
    based   <= look_here_i when look_i = '1' else
               flag(control_i, LAYOUT.base.enable) and not replace_i;
    address <= look_address_i when look_i = '1' else
               indexed;

  end generate g_accessed;

  g_closed : if not ACCESS_STATES generate

    enable  <= advance_i;
    write   <= write_base_i;
    based   <= flag(control_i, LAYOUT.base.enable);
    address <= indexed;

  end generate g_closed;

  base_o <= base;

  -- The index is fetched in the word before; without one it is 0.

  g_index : if INDEX_WORDS > 0 generate

    constant PLACE_BITS : positive := larger(index_bits(INDEX_WORDS), 1);

    signal index : std_ulogic_vector(INDEX_WIDTH - 1 downto 0);

  begin

    u_index : entity pe_lib.pe_index
      generic map (
        WORDS        => INDEX_WORDS,
        WORD_BITS    => WORD_BITS,
        INDEX_WIDTH  => INDEX_WIDTH,
        OCTAVE_WIDTH => OCTAVE_WIDTH
      )
      port map (
        clk_i           => clk_i,
        ce_i            => advance_i,
        write_enable_i  => write_index_i,
        octave_i        => flag(control_i, LAYOUT.write_octave),
        write_address_i => bits(control_i, LAYOUT.write_index_address, PLACE_BITS),
        word_i          => word,
        read_enable_i   => flag(control_i, LAYOUT.index.enable),
        read_address_i  => bits(control_i, LAYOUT.index.address, PLACE_BITS),
        index_o         => index
      );

    indexed <= bits(control_i, LAYOUT.base.address, BASE_BITS)
               or std_ulogic_vector(resize(unsigned(index), BASE_BITS));

  end generate g_index;

  g_no_index : if INDEX_WORDS = 0 generate

    indexed <= bits(control_i, LAYOUT.base.address, BASE_BITS);

  end generate g_no_index;

  p_scale : process (clk_i) is

    variable index : unsigned(larger(SHIFT_BITS, 1) - 1 downto 0);

  begin

    if rising_edge(clk_i) then
      if (advance_i = '1') then
        index    := unsigned(bits(control_i, LAYOUT.shift, larger(SHIFT_BITS, 1)));
        position <= index;
        use_mid  <= '0';
        use_high <= '0';

        if (MID_SHIFTS > 0 and index >= FIRST_MID) then
          use_mid <= '1';
        end if;

        if (HIGH_SHIFTS > 0 and index >= FIRST_HIGH) then
          use_high <= '1';
        end if;
      end if;
    end if;

  end process p_scale;

  -- Groups of more than one position begin at multiples of four, so the index's low bits are theirs.
  low_sum <= chosen(shifted(hold_i, SHIFTS, 0, FIRST_MID, LEFT, SHIFTED_BITS), std_ulogic_vector(position), SHIFTED_BITS);

  g_mid : if MID_SHIFTS > 0 generate

    mid_sum <= chosen(shifted(hold_i, SHIFTS, FIRST_MID, MID_SHIFTS, LEFT, SHIFTED_BITS), std_ulogic_vector(position),
                      SHIFTED_BITS);

  end generate g_mid;

  g_no_mid : if MID_SHIFTS = 0 generate

    mid_sum <= (others => '0');

  end generate g_no_mid;

  g_high : if HIGH_SHIFTS > 0 generate

    high_sum <= chosen(shifted(hold_i, SHIFTS, FIRST_HIGH, HIGH_SHIFTS, LEFT, SHIFTED_BITS),
                       std_ulogic_vector(position - FIRST_HIGH), SHIFTED_BITS);

  end generate g_high;

  g_no_high : if HIGH_SHIFTS = 0 generate

    high_sum <= (others => '0');

  end generate g_no_high;

  increment <= high_sum when HIGH_SHIFTS > 0 and use_high = '1' else
               mid_sum when MID_SHIFTS > 0 and use_mid = '1' else
               low_sum;

  g_direct : if not DEEP generate

    addend <= increment;

  end generate g_direct;

  g_registered : if DEEP generate

    signal shifted_sum : std_ulogic_vector(SHIFTED_BITS - 1 downto 0) := (others => '0');

  begin

    p_shift : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (advance_i = '1') then
          shifted_sum <= increment;
        end if;
      end if;

    end process p_shift;

    addend <= shifted_sum;

  end generate g_registered;

  p_add : process (clk_i) is

    variable extended : signed(SUM_BITS - 1 downto 0);
    variable total    : signed(SUM_BITS - 1 downto 0);

  begin

    if rising_edge(clk_i) then
      if (advance_i = '1') then
        extended := resize(signed(addend), SUM_BITS);

        -- One of the two is 0.
        if (ACCESS_STATES) then
          extended := extended or resize(signed(replacement_i & '0'), SUM_BITS);
        end if;

        -- base & '1' + increment, where the 1 below the base rounds to nearest. Written as a difference, because
        -- synthesis sorts the operands of a sum, and only next to the second one the choice above is free.
        total := resize(signed(base & '0'), SUM_BITS) - not extended;
        sum   <= total(SUM_BITS - 1 downto 1);
      end if;
    end if;

  end process p_add;

  p_saturate : process (clk_i) is

    variable differs : std_ulogic;

  begin

    if rising_edge(clk_i) then
      if (advance_i = '1') then
        differs := '0';

        for i in WORD_BITS to SUM_BITS - 2 loop

          differs := differs or (sum(i) xor sum(SUM_BITS - 1));

        end loop;

        -- All but the upper bits of a saturated word are 0 whatever its sign: the register's synchronous reset does
        -- that without logic.
        word <= std_ulogic_vector(sum(WORD_BITS downto 1));

        if (SATURATE and differs = '1') then
          word                                                <= (others => '0');
          word(WORD_BITS - 1 downto WORD_BITS - CEILING_BITS) <= (others => not sum(SUM_BITS - 1));
        end if;

        if (SATURATE) then
          word(WORD_BITS - 1) <= sum(SUM_BITS - 1);
        end if;

        saturated <= differs;
      end if;
    end if;

  end process p_saturate;

  word_o      <= word;
  saturated_o <= saturated;

end architecture rtl;
