-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;

library std;
  use std.env.all;

library pe_lib;
  use pe_lib.pe_trace_pkg.all;

-- Ticks of three steps: from a sample on, from the middle of a period, in a deep pipeline; clocks in which no step begins
-- count nothing.

entity pe_tick_tb is
end entity pe_tick_tb;

architecture bench of pe_tick_tb is

  signal clk    : std_ulogic := '0';
  signal sample : std_ulogic := '0';
  signal arrive : std_ulogic := '0';
  signal first  : std_ulogic_vector(5 downto 0);
  signal middle : std_ulogic_vector(5 downto 0);
  signal deep   : std_ulogic_vector(5 downto 0);
  signal every  : std_ulogic_vector(5 downto 0);

begin

  clk <= not clk after 5 ns;

  u_first : entity pe_lib.pe_tick
    generic map (
      STEPS     => 3,
      DONE      => 0,
      ONE_BIT   => 4,
      DATA_BITS => 6
    )
    port map (
      clk_i     => clk,
      sample_i  => sample,
      operand_o => first,
      arrive_i  => '0'
    );

  u_middle : entity pe_lib.pe_tick
    generic map (
      STEPS     => 3,
      DONE      => 2,
      ONE_BIT   => 0,
      DATA_BITS => 6
    )
    port map (
      clk_i     => clk,
      sample_i  => sample,
      operand_o => middle,
      arrive_i  => '0'
    );

  u_deep : entity pe_lib.pe_tick
    generic map (
      STEPS     => 3,
      DONE      => 0,
      ONE_BIT   => 4,
      DATA_BITS => 6,
      DEEP      => true
    )
    port map (
      clk_i     => clk,
      sample_i  => sample,
      operand_o => deep,
      arrive_i  => arrive
    );

  u_every : entity pe_lib.pe_tick
    generic map (
      STEPS     => 1,
      DONE      => 0,
      ONE_BIT   => 3,
      DATA_BITS => 6
    )
    port map (
      clk_i     => clk,
      sample_i  => sample,
      operand_o => every,
      arrive_i  => '0'
    );

  p_check : process is

    variable checks : natural;
    variable before : std_ulogic_vector(5 downto 0); -- the deep operand of the last step

    procedure check (
      constant operand : in std_ulogic_vector;
      constant wanted  : in std_ulogic_vector;
      constant step    : in natural
    ) is
    begin

      assert operand = wanted
        report "step " & integer'image(step) & " gives " & to_string(operand)
        severity failure;

      checks := checks + 1;

    end procedure check;

  begin

    checks := 0;
    before := (others => '0');
    wait until falling_edge(clk);
    check(first, "000000", 0);
    check(middle, "000000", 0);

    for step in 0 to 9 loop

      sample <= '1';
      wait until falling_edge(clk);
      sample <= '0';

      if (step mod 3 = 0) then
        check(first, "010000", step);
      else
        check(first, "000000", step);
      end if;

      if (step mod 3 = 1) then
        check(middle, "000001", step);
      else
        check(middle, "000000", step);
      end if;

      check(every, "001000", step);

      wait until falling_edge(clk);
      arrive <= '1';
      wait until falling_edge(clk);
      arrive <= '0';
      check(deep, before, step);
      wait until falling_edge(clk);

      if (step mod 3 = 0) then
        check(deep, "010000", step);
      else
        check(deep, "000000", step);
      end if;

      before := deep;

      wait until falling_edge(clk);

    end loop;

    print("checks " & integer'image(checks));
    finish;

  end process p_check;

end architecture bench;
