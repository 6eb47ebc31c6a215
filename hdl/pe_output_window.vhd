-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_register_pkg.all;

-- Purpose:  The window of outputs of a network that keeps them in memories: copies the outputs of each step into one of two
--           banks while the next step runs, and shows the other bank, so that what a host reads is of one step.
-- Generics: Words are of 32 bits. SAMPLE_0 has a row for each: 1 if it has a value in the initial state, and this value.
-- Timing:   A word is copied per clock, from the clock behind capture_i on. Banks exchange roles when all are there, or, if
--           outputs were held, when they no longer are. output_o and is_out_o answer next_i of the clock before and word_i
--           of the same clock. A step may begin with room_o: it then cannot end before the last word was asked for.

entity pe_output_window is
  generic (
    WORD_BITS    : positive;              -- address of a word in a window
    OUTPUT_WORDS : positive;              -- words of outputs
    HALVES       : positive range 1 to 2; -- words of an output
    VALUE_BITS   : positive;              -- output
    ADDRESS_BITS : positive;              -- address of an output
    LATENCY      : positive;              -- clocks from an address to the output
    STEP_CLOCKS  : natural;               -- clocks of a step
    SAMPLE_0     : word_array_t;          -- words of the initial state
    ALL_SAMPLED  : boolean                -- all of them have a value
  );
  port (
    clk_i      : in    std_ulogic;                                                          -- clock
    next_i     : in    std_ulogic_vector(WORD_BITS - 1 downto 0);                           -- word that is read next
    word_i     : in    std_ulogic_vector(WORD_BITS - 1 downto 0);                           -- word that is read
    output_o   : out   std_ulogic_vector(31 downto 0);                                      -- it
    is_out_o   : out   std_ulogic;                                                          -- there is such an output
    all_out_o  : out   std_ulogic;                                                          -- all outputs can be read
    sample_o   : out   std_ulogic_vector(63 downto 0);                                      -- step whose outputs these are
    hold_i     : in    std_ulogic;                                                          -- outputs stay
    capture_i  : in    std_ulogic;                                                          -- outputs are new
    stepping_i : in    std_ulogic;                                                          -- a step is under way
    steps_i    : in    unsigned(63 downto 0);                                               -- steps that have ended
    renew_i    : in    std_ulogic;                                                          -- there is the initial state
    forget_i   : in    std_ulogic;                                                          -- there is another state
    room_o     : out   std_ulogic;                                                          -- a step may begin
    settled_o  : out   std_ulogic;                                                          -- nothing is to be copied
    copy_o     : out   std_ulogic;                                                          -- a word is copied
    place_o    : out   std_ulogic_vector(larger(index_bits(OUTPUT_WORDS), 1) - 1 downto 0); -- its number
    data_o     : out   std_ulogic_vector(31 downto 0);                                      -- it
    copied_o   : out   std_ulogic;                                                          -- the last one is copied
    address_o  : out   std_ulogic_vector(ADDRESS_BITS - 1 downto 0);                        -- output to read
    value_i    : in    std_ulogic_vector(VALUE_BITS - 1 downto 0)                           -- it, LATENCY clocks later
  );
end entity pe_output_window;

architecture rtl of pe_output_window is

  constant PLACE_BITS : positive := larger(index_bits(OUTPUT_WORDS), 1);

  -- Clocks of a step in which no word is asked for: words are on their way, `done_o` may wait for an enabled clock, and
  -- a deep pipeline follows later.
  constant SPARE : natural := LATENCY + 8;

  -- Words that can be asked for while a step runs.

  function words_of_step return natural is
  begin

    if (STEP_CLOCKS > SPARE) then
      return STEP_CLOCKS - SPARE;
    end if;

    return 0;

  end function words_of_step;

  constant ROOM : natural := words_of_step;

  -- Words of the step that is copied: asked for, on their way, and stored
  signal asked  : unsigned(PLACE_BITS downto 0)           := to_unsigned(OUTPUT_WORDS, PLACE_BITS + 1);
  signal on_way : std_ulogic_vector(LATENCY - 1 downto 0) := (others => '0');
  signal stored : unsigned(PLACE_BITS downto 0)           := to_unsigned(OUTPUT_WORDS, PLACE_BITS + 1);
  signal number : unsigned(63 downto 0)                   := (others => '0'); -- of that step
  signal value  : std_ulogic_vector(63 downto 0);
  signal data   : std_ulogic_vector(31 downto 0);
  signal copy   : std_ulogic;
  signal copied : std_ulogic;
  signal held   : std_ulogic                              := '0';             -- all are there and not shown

  -- What is shown
  signal show    : std_ulogic;
  signal bank    : std_ulogic            := '0';
  signal first   : std_ulogic            := '1'; -- outputs of the initial state
  signal defined : std_ulogic            := '0'; -- outputs of a step
  signal sample  : unsigned(63 downto 0) := (others => '0');
  signal all_of  : std_ulogic;

  -- What is read
  signal read_address  : std_ulogic_vector(PLACE_BITS downto 0);
  signal write_address : std_ulogic_vector(PLACE_BITS downto 0);
  signal shown         : std_ulogic_vector(31 downto 0);
  signal first_word    : std_ulogic_vector(32 downto 0);
  signal was_first     : std_ulogic := '0';
  signal was_defined   : std_ulogic := '0';
  signal is_word       : std_ulogic;

begin

  copy   <= on_way(LATENCY - 1);
  copied <= copy when stored = OUTPUT_WORDS - 1 else
            '0';
  show   <= not hold_i and (copied or held);

  p_copy : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      on_way <= on_way(LATENCY - 2 downto 0) & '0';

      if (asked /= OUTPUT_WORDS) then
        asked     <= asked + 1;
        on_way(0) <= '1';
      end if;

      if (copy = '1') then
        stored <= stored + 1;
      end if;

      if (copied = '1') then
        held <= '1';
      end if;

      if (show = '1') then
        held    <= '0';
        bank    <= not bank;
        first   <= '0';
        defined <= '1';
        sample  <= number;
      end if;

      if (capture_i = '1') then
        asked  <= (others => '0');
        on_way <= (others => '0');
        stored <= (others => '0');
        held   <= '0';
        number <= steps_i + 1;
      end if;

      if (forget_i = '1' or renew_i = '1') then
        asked   <= to_unsigned(OUTPUT_WORDS, PLACE_BITS + 1);
        on_way  <= (others => '0');
        stored  <= to_unsigned(OUTPUT_WORDS, PLACE_BITS + 1);
        held    <= '0';
        first   <= renew_i;
        defined <= '0';
      end if;

      if (renew_i = '1') then
        sample <= (others => '0');
      end if;
    end if;

  end process p_copy;

  value <= std_ulogic_vector(resize(signed(value_i), 64));
  data  <= value(63 downto 32) when HALVES = 2 and stored(0) = '1' else
           value(31 downto 0);

  write_address <= not bank & std_ulogic_vector(stored(PLACE_BITS - 1 downto 0));
  read_address  <= bank & next_i(PLACE_BITS - 1 downto 0);

  u_banks : entity pe_lib.pe_ram
    generic map (
      WORDS     => 2 ** (PLACE_BITS + 1),
      WORD_BITS => 32,
      IMAGE     => zeros(2 ** (PLACE_BITS + 1), 32)
    )
    port map (
      clk_i           => clk_i,
      ce_i            => '1',
      write_enable_i  => copy,
      write_address_i => write_address,
      write_data_i    => data,
      read_enable_i   => '1',
      read_address_i  => read_address,
      default_i       => (others => '0'),
      read_data_o     => shown
    );

  u_initial : entity pe_lib.pe_rom
    generic map (
      CONTROL_BITS => 33,
      PERIOD       => OUTPUT_WORDS,
      CONTENT      => SAMPLE_0
    )
    port map (
      clk_i     => clk_i,
      fetch_i   => '1',
      address_i => next_i(PLACE_BITS - 1 downto 0),
      control_o => first_word
    );

  -- Which of both was read is of the clock that read it.
  p_read : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      was_first   <= first;
      was_defined <= defined;
    end if;

  end process p_read;

  -- A bit more: GHDL 2.0 cuts a constant that does not fit the number it is compared with.
  is_word <= '1' when resize(unsigned(word_i), WORD_BITS + 1) < OUTPUT_WORDS else
             '0';
  all_of  <= '1' when ALL_SAMPLED else
             '0';

  output_o  <= first_word(31 downto 0) when was_first = '1' else
               shown;
  is_out_o  <= is_word and (was_defined or (was_first and first_word(32)));
  all_out_o <= defined or (first and all_of);
  sample_o  <= std_ulogic_vector(sample);

  g_ahead : if OUTPUT_WORDS <= ROOM generate

    room_o <= '1';

  end generate g_ahead;

  g_behind : if OUTPUT_WORDS > ROOM generate

    room_o <= '1' when stepping_i = '0' and asked >= OUTPUT_WORDS - ROOM else
              '0';

  end generate g_behind;

  settled_o <= '1' when stored = OUTPUT_WORDS and capture_i = '0' else
               '0';
  copy_o    <= copy;
  place_o   <= std_ulogic_vector(stored(PLACE_BITS - 1 downto 0));
  data_o    <= data;
  copied_o  <= copied;
  address_o <= std_ulogic_vector(resize(shift_right(asked, HALVES - 1), ADDRESS_BITS));

end architecture rtl;
