-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- One misuse of an entity per scenario, each of which must end in the assertion that is named here; testbenches/run.sh
-- runs them all. Scenario 0 is legal: it ends by itself.
--
--  1 pe_ram: WORDS is a power of two
--  2 pe_ram: WORDS is a power of two, and IMAGE has
--  3 pe_rom: CONTENT has PERIOD elements
--  4 pe_multiplier: LATENCY must be 1 or 3
--  5 pe_multiplier: operands are signed
--  6 pe_index: an index has at most the bits of a word
--  7 pe_sequencer: a round needs more than PAUSE_WORD
--  8 pe_sequencer: ce_i is undefined
--  9 pe_sequencer: step_i is undefined
-- 10 pe_input: input and operand have at most
-- 11 pe_input: the input is undefined when it is sampled
-- 12 pe_tick: DONE is less than STEPS
-- 13 pe_output: CAPTURE_WORD has at most INDEX_BITS
-- 14 pe: control words have 40 bits
-- 15 pe: the ports of the multiplier
-- 16 pe: FACTOR needs a coefficient memory
-- 17 pe: an imported memory needs a port
-- 18 pe_output_memory: WORDS is a power of two

entity misuse is
  generic (
    SCENARIO : natural := 0 -- what is done wrong, 0 nothing
  );
end entity misuse;

architecture test of misuse is

  constant CLOCKS : positive := 100;

  -- One value where nothing is wrong, another in one scenario.

  function unless (
    wrong  : natural;
    legal  : natural;
    misused : natural
  ) return natural is
  begin

    if (SCENARIO = wrong) then
      return misused;
    end if;

    return legal;

  end function unless;

  function bit_unless (
    wrong : natural
  ) return std_ulogic is
  begin

    if (SCENARIO = wrong) then
      return 'X';
    end if;

    return '1';

  end function bit_unless;

  constant FOUR_WORDS : word_array_t(0 to 3)(7 downto 0) := (others => (others => '0'));
  constant ONE_WORD   : word_array_t(0 to 0)(7 downto 0) := (others => (others => '0'));
  constant WIDE_WORD  : word_array_t(0 to 3)(9 downto 0) := (others => (others => '0'));

  constant RAM_WORDS    : positive := unless(1, unless(2, 4, 2), 3);
  constant ROM_WORDS    : positive := unless(3, 4, 3);
  constant LATENCY      : positive := unless(4, 1, 2);
  constant OPERAND_BITS : positive := unless(5, 8, 1);
  constant INDEX_WIDTH  : positive := unless(6, 3, 9);
  constant PERIOD       : positive := unless(7, 16, 6);
  constant INPUT_BITS   : positive := unless(10, 8, 12);
  constant DONE         : natural  := unless(12, 0, 4);
  constant CAPTURE_WORD : natural  := unless(13, 3, 16);
  constant SHOWN_WORDS  : natural  := unless(18, 4, 1);
  constant PORT_COUNT   : natural  := unless(17, 1, 0);
  constant FACTOR_BITS  : positive := unless(15, 8, 11);

  constant LAYOUT : layout_t := control_layout(4, 4, 0, 4, PORT_COUNT, 1, FACTOR_BITS, SCENARIO = 16, false, false, 0, false);

  constant CONTROL_BITS : positive := unless(14, LAYOUT.bits, 40);

  signal clk     : std_ulogic                    := '0';
  signal ce      : std_ulogic                    := '1';
  signal step    : std_ulogic                    := '1';
  signal sample  : std_ulogic;
  signal address : std_ulogic_vector(1 downto 0) := (others => '0');
  signal value   : std_ulogic_vector(INPUT_BITS - 1 downto 0);

begin

  clk  <= not clk after 5 ns when now < CLOCKS * 10 ns else
          '0';
  ce   <= '1', bit_unless(8) after 200 ns;
  step <= '1', bit_unless(9) after 200 ns;

  value <= (others => '0') when SCENARIO /= 11 else
           (others => 'U');

  u_ram : entity pe_lib.pe_ram
    generic map (
      WORDS     => RAM_WORDS,
      WORD_BITS => 8,
      IMAGE     => FOUR_WORDS
    )
    port map (
      clk_i           => clk,
      ce_i            => '1',
      write_enable_i  => '0',
      write_address_i => (others => '0'),
      write_data_i    => (others => '0'),
      read_enable_i   => '1',
      read_address_i  => (others => '0'),
      default_i       => (others => '0'),
      read_data_o     => open
    );

  u_rom : entity pe_lib.pe_rom
    generic map (
      CONTROL_BITS => 8,
      PERIOD       => ROM_WORDS,
      CONTENT      => FOUR_WORDS
    )
    port map (
      clk_i     => clk,
      fetch_i   => '1',
      address_i => (others => '0'),
      control_o => open
    );

  u_multiplier : entity pe_lib.pe_multiplier
    generic map (
      DATA_BITS        => OPERAND_BITS,
      COEFFICIENT_BITS => 8,
      LATENCY          => LATENCY,
      PRE_ADDER        => false
    )
    port map (
      clk_i         => clk,
      ce_i          => '1',
      own_i         => (others => '0'),
      imported_i    => (others => '0'),
      coefficient_i => (others => '0'),
      product_o     => open
    );

  u_index : entity pe_lib.pe_index
    generic map (
      WORDS        => 4,
      WORD_BITS    => 8,
      INDEX_WIDTH  => INDEX_WIDTH,
      OCTAVE_WIDTH => 0
    )
    port map (
      clk_i           => clk,
      ce_i            => '1',
      write_enable_i  => '0',
      octave_i        => '0',
      write_address_i => address,
      word_i          => (others => '0'),
      read_enable_i   => '1',
      read_address_i  => address,
      index_o         => open
    );

  u_sequencer : entity pe_lib.pe_sequencer
    generic map (
      PERIOD     => PERIOD,
      ROUNDS     => 1,
      PAUSE_WORD => 7
    )
    port map (
      clk_i     => clk,
      ce_i      => ce,
      step_i    => step,
      fetch_o   => open,
      address_o => open,
      repeat_o  => open,
      round_o   => open,
      advance_o => open,
      index_o   => open,
      parity_o  => open,
      last_o    => open,
      settle_o  => open,
      sample_o  => sample,
      arrive_o  => open,
      publish_o => open,
      busy_o    => open,
      done_o    => open
    );

  u_input : entity pe_lib.pe_input
    generic map (
      STORAGE_BITS => INPUT_BITS,
      WORD_BITS    => 10,
      DATA_BITS    => 8
    )
    port map (
      clk_i      => clk,
      sample_i   => sample,
      value_i    => value,
      operand_o  => open,
      overflow_o => open,
      arrive_i   => '0'
    );

  u_tick : entity pe_lib.pe_tick
    generic map (
      STEPS     => 4,
      DONE      => DONE,
      ONE_BIT   => 3,
      DATA_BITS => 8
    )
    port map (
      clk_i     => clk,
      sample_i  => sample,
      operand_o => open,
      arrive_i  => '0'
    );

  u_output : entity pe_lib.pe_output
    generic map (
      STORAGE_BITS => 8,
      WORD_BITS    => 10,
      DATA_BITS    => 8,
      INDEX_BITS   => 4,
      CAPTURE_WORD => CAPTURE_WORD
    )
    port map (
      clk_i     => clk,
      advance_i => '1',
      index_i   => (others => '0'),
      publish_i => '0',
      word_i    => (others => '0'),
      value_o   => open
    );

  u_outputs : entity pe_lib.pe_output_memory
    generic map (
      WORDS      => SHOWN_WORDS,
      SHOWN_BITS => 9,
      DATA_BITS  => 8
    )
    port map (
      clk_i     => clk,
      write_i   => '0',
      word_i    => (others => '0'),
      settle_i  => '0',
      publish_i => '0',
      here_i    => '0',
      place_i   => (others => '0'),
      word_o    => open
    );

  u_pe : entity pe_lib.pe
    generic map (
      WORD_BITS        => 10,
      DATA_BITS        => 8,
      COEFFICIENT_BITS => FACTOR_BITS,
      CONTROL_BITS     => CONTROL_BITS,
      OWN_WORDS        => 4,
      BASE_WORDS       => 4,
      COEFF_WORDS      => 0,
      IMPORTED_WORDS   => 4,
      PORT_COUNT       => PORT_COUNT,
      SHIFTS           => (0 => 7),
      ACCUMULATOR_BITS => 24,
      FACTOR           => SCENARIO = 16,
      PRE_ADDER        => false,
      SWAP             => false,
      BASE_LAST        => false,
      SEND             => false,
      OWN_IMAGE        => FOUR_WORDS,
      BASE_IMAGE       => WIDE_WORD,
      COEFF_IMAGE      => ONE_WORD,
      IMPORTED_IMAGE   => FOUR_WORDS
    )
    port map (
      clk_i      => clk,
      advance_i  => '0',
      settle_i   => '0',
      parity_i   => '0',
      last_i     => '0',
      control_i  => (others => '0'),
      ports_i    => (others => '0'),
      link_o     => open,
      word_o     => open,
      show_o     => open,
      overflow_o => open,
      trace_o    => open
    );

end architecture test;
