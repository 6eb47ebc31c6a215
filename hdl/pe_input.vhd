-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;

-- Purpose:  Samples an external input when a step begins, and rounds it to a data operand.
-- Generics: STORAGE_BITS and DATA_BITS are at most WORD_BITS.
-- Timing:   The operand is valid one clock after sample_i; with DEEP two clocks after arrive_i, when the PEs begin the
--           step. The input must be defined in the clock of sample_i, or simulation stops; it may be anything in all
--           other clocks.

entity pe_input is
  generic (
    STORAGE_BITS : positive;        -- width of the input
    WORD_BITS    : positive;        -- stored word, guard bits included
    DATA_BITS    : positive;        -- data operand
    DEEP         : boolean := false -- a second register, loaded by a replica
  );
  port (
    clk_i      : in    std_ulogic;                                   -- clock
    sample_i   : in    std_ulogic;                                   -- takes the input
    clear_i    : in    std_ulogic := '0';                            -- clears the flag
    value_i    : in    std_ulogic_vector(STORAGE_BITS - 1 downto 0); -- external input
    operand_o  : out   std_ulogic_vector(DATA_BITS - 1 downto 0);    -- what the ports of PEs see
    overflow_o : out   std_ulogic;                                   -- sticky: an input was too large
    arrive_i   : in    std_ulogic                                    -- loads the operand a clock later, with DEEP
  );
end entity pe_input;

architecture rtl of pe_input is

  constant GUARD_BITS : integer := WORD_BITS - STORAGE_BITS;
  constant DROPPED    : integer := WORD_BITS - DATA_BITS;

  -- Half an LSB of the operand; bit by bit, because GHDL 2.0 writes wide constants as character strings into Verilog.
  signal half : signed(WORD_BITS downto 0);
  signal most : std_ulogic_vector(DATA_BITS - 1 downto 0); -- largest operand

  signal taken  : std_ulogic_vector(STORAGE_BITS - 1 downto 0);
  signal arrive : std_ulogic;

  signal operand  : std_ulogic_vector(DATA_BITS - 1 downto 0) := (others => '0');
  signal overflow : std_ulogic                                := '0';

begin

  assert STORAGE_BITS <= WORD_BITS and DATA_BITS <= WORD_BITS
    report "pe_input: input and operand have at most the WORD_BITS of a word"
    severity failure;

  -- synthesis translate_off
  p_handshake : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      assert sample_i /= '1' or not is_x(value_i)
        report "pe_input: the input is undefined when it is sampled"
        severity failure;
    end if;

  end process p_handshake;

  -- synthesis translate_on

  g_half : for i in 0 to WORD_BITS generate

    half(i) <= '1' when i = DROPPED - 1 else
               '0';

  end generate g_half;

  -- Bit by bit: GHDL 2.0 writes wide constants as character strings into Verilog.

  g_most : for i in 0 to DATA_BITS - 1 generate

    most(i) <= '0' when i = DATA_BITS - 1 else
               '1';

  end generate g_most;

  g_direct : if not DEEP generate

    taken  <= value_i;
    arrive <= sample_i;

  end generate g_direct;

  g_second : if DEEP generate

    signal sampled : std_ulogic_vector(STORAGE_BITS - 1 downto 0) := (others => '0');

  begin

    p_take : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (sample_i = '1') then
          sampled <= value_i;
        end if;
      end if;

    end process p_take;

    u_arrive : entity pe_lib.pe_replica
      generic map (
        WIDTH => 1
      )
      port map (
        clk_i      => clk_i,
        value_i(0) => arrive_i,
        value_o(0) => arrive
      );

    taken <= sampled;

  end generate g_second;

  p_sample : process (clk_i) is

    variable word : signed(WORD_BITS downto 0);

  begin

    if rising_edge(clk_i) then
      if (clear_i = '1') then
        overflow <= '0';
      end if;

      if (arrive = '1') then
        word    := shift_left(resize(signed(taken), WORD_BITS + 1), GUARD_BITS) + half;
        operand <= std_ulogic_vector(word(WORD_BITS - 1 downto DROPPED));

        if (word(WORD_BITS) /= word(WORD_BITS - 1)) then
          operand  <= most;
          overflow <= '1';
        end if;
      end if;
    end if;

  end process p_sample;

  operand_o  <= operand;
  overflow_o <= overflow;

end architecture rtl;
