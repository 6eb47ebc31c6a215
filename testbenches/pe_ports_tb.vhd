-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library std;
  use std.env.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_trace_pkg.all;

-- Rounding, clamping and handshake of pe_input and pe_output for 16-bit ports, 24-bit words and 18-bit operands; with
-- DEEP the same a clock later.

entity pe_ports_tb is
end entity pe_ports_tb;

architecture bench of pe_ports_tb is

  signal clk       : std_ulogic                     := '0';
  signal enable    : std_ulogic                     := '1';
  signal publish   : std_ulogic                     := '0';
  signal value_in  : std_ulogic_vector(15 downto 0) := (others => '0');
  signal narrow    : std_ulogic_vector(13 downto 0);
  signal exact     : std_ulogic_vector(17 downto 0);
  signal too_large : std_ulogic;
  signal fits      : std_ulogic;
  signal index     : std_ulogic_vector(2 downto 0)  := "101";
  signal word      : std_ulogic_vector(23 downto 0) := (others => '0');
  signal value_out : std_ulogic_vector(15 downto 0);

  -- Of a deep pipeline.
  signal arrive     : std_ulogic                     := '0';
  signal late_exact : std_ulogic_vector(17 downto 0);
  signal late_fits  : std_ulogic;
  signal late_word  : std_ulogic_vector(23 downto 0) := (others => '0');
  signal late_out   : std_ulogic_vector(15 downto 0);

begin

  clk <= not clk after 5 ns;

  -- 14-bit operands lose two bits of the input.
  u_narrow : entity pe_lib.pe_input
    generic map (
      STORAGE_BITS => 16,
      WORD_BITS    => 24,
      DATA_BITS    => 14
    )
    port map (
      clk_i      => clk,
      sample_i   => enable,
      value_i    => value_in,
      operand_o  => narrow,
      overflow_o => too_large,
      arrive_i   => '0'
    );

  u_exact : entity pe_lib.pe_input
    generic map (
      STORAGE_BITS => 16,
      WORD_BITS    => 24,
      DATA_BITS    => 18
    )
    port map (
      clk_i      => clk,
      sample_i   => enable,
      value_i    => value_in,
      operand_o  => exact,
      overflow_o => fits,
      arrive_i   => '0'
    );

  u_output : entity pe_lib.pe_output
    generic map (
      STORAGE_BITS => 16,
      WORD_BITS    => 24,
      DATA_BITS    => 18,
      INDEX_BITS   => 3,
      CAPTURE_WORD => 5
    )
    port map (
      clk_i     => clk,
      advance_i => enable,
      index_i   => index,
      publish_i => publish,
      word_i    => word,
      value_o   => value_out
    );

  u_late_exact : entity pe_lib.pe_input
    generic map (
      STORAGE_BITS => 16,
      WORD_BITS    => 24,
      DATA_BITS    => 18,
      DEEP         => true
    )
    port map (
      clk_i      => clk,
      sample_i   => enable,
      value_i    => value_in,
      operand_o  => late_exact,
      overflow_o => late_fits,
      arrive_i   => arrive
    );

  u_late_output : entity pe_lib.pe_output
    generic map (
      STORAGE_BITS => 16,
      WORD_BITS    => 24,
      DATA_BITS    => 18,
      INDEX_BITS   => 3,
      CAPTURE_WORD => 5,
      DEEP         => true
    )
    port map (
      clk_i     => clk,
      advance_i => enable,
      index_i   => index,
      publish_i => publish,
      word_i    => late_word,
      value_o   => late_out
    );

  p_late : process (clk) is
  begin

    if rising_edge(clk) then
      late_word <= word;
    end if;

  end process p_late;

  p_check : process is

    variable checks : natural;

    procedure check_input (
      constant number : in integer;
      constant wanted : in integer
    ) is
    begin

      value_in <= std_ulogic_vector(to_signed(number, 16));
      wait until rising_edge(clk);
      wait until falling_edge(clk);

      assert to_integer(signed(narrow)) = wanted
        report "input " & integer'image(number) & " gives " & integer'image(to_integer(signed(narrow)))
        severity failure;

      assert to_integer(signed(exact)) = number * 4
        report "no bit of " & integer'image(number) & " need be lost"
        severity failure;

      -- The next input comes before the replica tells.
      arrive   <= '1';
      enable   <= '0';
      wait until rising_edge(clk);
      arrive   <= '0';
      value_in <= (others => '1');
      wait until rising_edge(clk);
      wait until falling_edge(clk);
      enable   <= '1';

      assert late_exact = exact and late_fits = fits
        report "input " & integer'image(number) & " does not arrive later"
        severity failure;

      checks := checks + 3;

    end procedure check_input;

    -- The stored word carries 2**5, half an LSB of its 18-bit operand; the output has 8 bits less than the word.

    procedure check_output (
      constant number : in integer;
      constant wanted : in integer
    ) is
    begin

      word    <= std_ulogic_vector(to_signed(number, 24));
      index   <= "101";
      publish <= '0';
      wait until rising_edge(clk);
      word    <= (others => '1');
      index   <= "100";
      wait until rising_edge(clk);
      publish <= '1';
      wait until rising_edge(clk);
      wait until falling_edge(clk);

      assert to_integer(signed(value_out)) = wanted
        report "word " & integer'image(number) & " gives " & integer'image(to_integer(signed(value_out)))
        severity failure;

      publish <= '0';
      wait until rising_edge(clk);
      wait until falling_edge(clk);

      assert late_out = value_out
        report "word " & integer'image(number) & " does not come out later"
        severity failure;

      checks := checks + 2;

    end procedure check_output;

  begin

    checks := 0;
    check_input(0, 0);
    check_input(1, 0);
    check_input(2, 1);
    check_input(-2, 0);
    check_input(-3, -1);
    check_input(-32768, -8192);

    assert too_large = '0' and fits = '0'
      report "early overflow"
      severity failure;

    check_input(32767, 8191);

    assert too_large = '1' and fits = '0'
      report "32767 rounds up beyond the largest 14-bit operand, and only there"
      severity failure;

    -- Sticky
    check_input(5, 1);

    assert too_large = '1'
      report "the flag does not stick"
      severity failure;

    check_output(32, 0);
    check_output(32 + 127, 0);
    check_output(32 + 128, 1);
    check_output(32 - 128, 0);
    check_output(32 - 129, -1);
    check_output(32 + 256 * 1000, 1000);
    check_output(8388607, 32767);
    check_output(-8388608, -32768);

    print("checks " & integer'image(checks + 3));
    finish;

  end process p_check;

end architecture bench;
