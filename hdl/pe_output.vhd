-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;

-- Purpose:  Captures a word of a PE's write group and publishes it, rounded, when the step is done.
-- Generics: STORAGE_BITS and DATA_BITS are at most WORD_BITS; CAPTURE_WORD has at most INDEX_BITS.
-- Timing:   Captures in the clock in which CAPTURE_WORD is executed, and value_o changes a clock after publish_i; with
--           DEEP both are a clock later.

entity pe_output is
  generic (
    STORAGE_BITS : positive;        -- width of the output
    WORD_BITS    : positive;        -- stored word, guard bits included
    DATA_BITS    : positive;        -- data operand: tells the rounding offset
    INDEX_BITS   : positive;        -- width of a word index
    CAPTURE_WORD : natural;         -- control word that writes the value
    SATURATE     : boolean := true; -- clamps what is out of range; false if it is proven that nothing can be
    DEEP         : boolean := false -- registers of its own of what it is told
  );
  port (
    clk_i     : in    std_ulogic;                                  -- clock
    advance_i : in    std_ulogic;                                  -- the control word is executed
    index_i   : in    std_ulogic_vector(INDEX_BITS - 1 downto 0);  -- its index
    publish_i : in    std_ulogic;                                  -- the step is done
    word_i    : in    std_ulogic_vector(WORD_BITS - 1 downto 0);   -- word of the PE's write group
    value_o   : out   std_ulogic_vector(STORAGE_BITS - 1 downto 0) -- output
  );
end entity pe_output;

architecture rtl of pe_output is

  constant GUARD_BITS : natural := WORD_BITS - STORAGE_BITS;
  constant DROPPED    : natural := WORD_BITS - DATA_BITS;

  -- Half an LSB of the output less the offset that the stored word carries.

  function rounding return signed is

    variable half   : signed(WORD_BITS downto 0);
    variable offset : signed(WORD_BITS downto 0);

  begin

    half   := signed(shift_right(shift_left(to_unsigned(1, WORD_BITS + 1), GUARD_BITS), 1));
    offset := signed(shift_right(shift_left(to_unsigned(1, WORD_BITS + 1), DROPPED), 1));
    return half - offset;

  end function rounding;

  constant ROUNDING_WORD : signed(WORD_BITS downto 0) := rounding;

  -- The same bit by bit, because GHDL 2.0 writes wide constants as character strings into Verilog.
  signal round_by : signed(WORD_BITS downto 0);

  signal captured : std_ulogic_vector(WORD_BITS - 1 downto 0)    := (others => '0');
  signal value    : std_ulogic_vector(STORAGE_BITS - 1 downto 0) := (others => '0');

  signal capture : std_ulogic := '0';
  signal publish : std_ulogic;

begin

  assert CAPTURE_WORD < 2 ** INDEX_BITS
    report "pe_output: CAPTURE_WORD has at most INDEX_BITS"
    severity failure;

  g_direct : if not DEEP generate

    publish <= publish_i;

  end generate g_direct;

  g_replicated : if DEEP generate

    p_select : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        capture <= '0';

        if (unsigned(index_i) = CAPTURE_WORD) then
          capture <= advance_i;
        end if;
      end if;

    end process p_select;

    u_publish : entity pe_lib.pe_replica
      generic map (
        WIDTH => 1
      )
      port map (
        clk_i      => clk_i,
        value_i(0) => publish_i,
        value_o(0) => publish
      );

  end generate g_replicated;

  g_round_by : for i in 0 to WORD_BITS generate

    round_by(i) <= ROUNDING_WORD(i);

  end generate g_round_by;

  p_capture : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (capture = '1' or (not DEEP and advance_i = '1' and unsigned(index_i) = CAPTURE_WORD)) then
        captured <= word_i;
      end if;
    end if;

  end process p_capture;

  p_publish : process (clk_i) is

    variable sum : signed(WORD_BITS downto 0);

  begin

    if rising_edge(clk_i) then
      if (publish = '1') then
        sum   := resize(signed(captured), WORD_BITS + 1) + round_by;
        assert SATURATE or sum(WORD_BITS) = sum(WORD_BITS - 1)
          report "pe_output: an output is out of range, which was proven impossible"
          severity failure;
        value <= std_ulogic_vector(sum(WORD_BITS - 1 downto GUARD_BITS));

        if (SATURATE and sum(WORD_BITS) /= sum(WORD_BITS - 1)) then
          value                   <= (others => not sum(WORD_BITS));
          value(STORAGE_BITS - 1) <= sum(WORD_BITS);
        end if;
      end if;
    end if;

  end process p_publish;

  value_o <= value;

end architecture rtl;
