-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Purpose:  Reads the output memories of all PEs and rounds what it reads, one output per clock.
-- Generics: PLACES has a row for each output: the number of its memory, and in PLACE_BITS the place there.
-- Timing:   An output is at value_o, in every clock, enabled or not, five clocks after its address, and one for each
--           register that joins memories; its memory is read in the third of these.

entity pe_output_reader is
  generic (
    STORAGE_BITS : positive;       -- width of an output
    WORD_BITS    : positive;       -- stored word, guard bits included
    DATA_BITS    : positive;       -- data operand: tells the rounding offset
    SHOWN_BITS   : positive;       -- upper bits of a stored word that memories keep
    MEMORIES     : positive;       -- output memories
    PLACE_BITS   : positive;       -- place in the largest one
    OUTPUTS      : positive;       -- outputs
    PLACES       : word_array_t;   -- where they are
    SATURATE     : boolean := true -- clamps what is out of range; false if it is proven that nothing can be
  );
  port (
    clk_i     : in    std_ulogic;                                                     -- clock
    address_i : in    std_ulogic_vector(larger(index_bits(OUTPUTS), 1) - 1 downto 0); -- output to read
    here_o    : out   std_ulogic_vector(MEMORIES - 1 downto 0);                       -- its memory
    place_o   : out   std_ulogic_vector(PLACE_BITS - 1 downto 0);                     -- its place there
    words_i   : in    std_ulogic_vector(MEMORIES * SHOWN_BITS - 1 downto 0);          -- words of the memories, all but one 0
    value_o   : out   std_ulogic_vector(STORAGE_BITS - 1 downto 0)                    -- output
  );
end entity pe_output_reader;

architecture rtl of pe_output_reader is

  -- Words that one register joins.
  constant JOINED_AT_ONCE : positive := 6;

  -- Words that are left of so many after some registers.

  function joined_words (
    words : positive;
    level : natural
  ) return positive is

    variable count : positive;

  begin

    count := words;

    for i in 1 to level loop

      count := (count + JOINED_AT_ONCE - 1) / JOINED_AT_ONCE;

    end loop;

    return count;

  end function joined_words;

  -- Registers until one is left.

  function join_levels (
    words : positive
  ) return natural is

    variable level : natural;

  begin

    level := 0;
    while joined_words(words, level) > 1 loop
      level := level + 1;
    end loop;
    return level;

  end function join_levels;

  constant MEMORY_BITS : positive := larger(index_bits(MEMORIES), 1);
  constant ROW_BITS    : positive := MEMORY_BITS + PLACE_BITS;
  constant LEVELS      : natural  := join_levels(MEMORIES);

  type level_t is array (natural range <>) of std_ulogic_vector(MEMORIES * SHOWN_BITS - 1 downto 0);

  signal row    : std_ulogic_vector(ROW_BITS - 1 downto 0);
  signal here   : std_ulogic_vector(MEMORIES - 1 downto 0)   := (others => '0');
  signal place  : std_ulogic_vector(PLACE_BITS - 1 downto 0) := (others => '0');
  signal joined : level_t(0 to LEVELS);
  signal word   : std_ulogic_vector(WORD_BITS - 1 downto 0);

begin

  u_places : entity pe_lib.pe_rom
    generic map (
      CONTROL_BITS => ROW_BITS,
      PERIOD       => OUTPUTS,
      CONTENT      => PLACES
    )
    port map (
      clk_i     => clk_i,
      fetch_i   => '1',
      address_i => address_i,
      control_o => row
    );

  p_select : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      place <= row(PLACE_BITS - 1 downto 0);
      here  <= (others => '0');

      for i in here'range loop

        if (unsigned(row(ROW_BITS - 1 downto PLACE_BITS)) = i) then
          here(i) <= '1';
        end if;

      end loop;

    end if;

  end process p_select;

  here_o    <= here;
  place_o   <= place;
  joined(0) <= words_i;

  -- A table of six inputs in front of each register.

  g_levels : for level in 1 to LEVELS generate

    constant BELOW : positive := joined_words(MEMORIES, level - 1);
    constant COUNT : positive := joined_words(MEMORIES, level);

    signal words : std_ulogic_vector(COUNT * SHOWN_BITS - 1 downto 0) := (others => '0');

  begin

    p_join : process (clk_i) is

      variable sum : std_ulogic_vector(SHOWN_BITS - 1 downto 0);

    begin

      if rising_edge(clk_i) then
        for i in 0 to COUNT - 1 loop

          sum := (others => '0');

          for k in JOINED_AT_ONCE * i to JOINED_AT_ONCE * i + JOINED_AT_ONCE - 1 loop

            if (k < BELOW) then
              sum := sum or joined(level - 1)((k + 1) * SHOWN_BITS - 1 downto k * SHOWN_BITS);
            end if;

          end loop;

          words((i + 1) * SHOWN_BITS - 1 downto i * SHOWN_BITS) <= sum;

        end loop;

      end if;

    end process p_join;

    joined(level)(COUNT * SHOWN_BITS - 1 downto 0)                     <= words;
    joined(level)(MEMORIES * SHOWN_BITS - 1 downto COUNT * SHOWN_BITS) <= (others => '0');

  end generate g_levels;

  word(WORD_BITS - 1 downto WORD_BITS - SHOWN_BITS) <= joined(LEVELS)(SHOWN_BITS - 1 downto 0);
  word(WORD_BITS - SHOWN_BITS - 1 downto 0)         <= (others => '0');

  u_output : entity pe_lib.pe_output
    generic map (
      STORAGE_BITS => STORAGE_BITS,
      WORD_BITS    => WORD_BITS,
      DATA_BITS    => DATA_BITS,
      INDEX_BITS   => 1,
      CAPTURE_WORD => 0,
      SATURATE     => SATURATE
    )
    port map (
      clk_i     => clk_i,
      advance_i => '1',
      index_i   => "0",
      publish_i => '1',
      word_i    => word,
      value_o   => value_o
    );

end architecture rtl;
