-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;
  use ieee.math_real.all;

library std;
  use std.env.all;

library pe_lib;
  use pe_lib.pe_trace_pkg.all;

library work;
  use work.check_pkg.all;

-- What simulations multiply by against the operator of numeric_std, which synthesis takes: operands of many widths, random,
-- extreme, and with bits that are neither 0 nor 1.

entity pe_product_tb is
end entity pe_product_tb;

architecture bench of pe_product_tb is

  constant LENGTH : positive := 300;

  type widths_t is array (natural range <>) of positive;

  -- Around the ends of digits of 13 bits.
  constant WIDTHS : widths_t := (2, 12, 13, 14, 18, 25, 26, 27, 35, 64);

  type found_t is array (WIDTHS'range, WIDTHS'range) of boolean;

  signal clk   : std_ulogic          := '0';
  signal left  : signed(63 downto 0) := (others => '0');
  signal right : signed(63 downto 0) := (others => '0');
  signal equal : found_t;

begin

  clk <= not clk after 5 ns;

  g_left : for l in WIDTHS'range generate

    g_right : for r in WIDTHS'range generate

      signal product : signed(widths(l) + WIDTHS(r) - 1 downto 0);

    begin

      u_multiplier : entity pe_lib.pe_multiplier
        generic map (
          DATA_BITS        => WIDTHS(l),
          COEFFICIENT_BITS => WIDTHS(r),
          LATENCY          => 1,
          PRE_ADDER        => true
        )
        port map (
          clk_i         => clk,
          ce_i          => '1',
          own_i         => left(63 downto 64 - WIDTHS(l)),
          imported_i    => (others => '0'),
          coefficient_i => right(63 downto 64 - WIDTHS(r)),
          product_o     => product
        );

      -- `=` of signals compares bit by bit, X with X too, unlike that of numbers.
      equal(l, r) <= std_ulogic_vector(product)
                     = std_ulogic_vector(left(63 downto 64 - WIDTHS(l)) * right(63 downto 64 - WIDTHS(r)));

    end generate g_right;

  end generate g_left;

  p_check : process is

    variable seed_1 : positive;
    variable seed_2 : positive;
    variable checks : natural;

    -- A random operand, every fourth one extreme in its first bits, some with a bit of any value.

    impure function operand return signed is

      variable value : real;
      variable word  : signed(63 downto 0);
      variable place : natural;

    begin

      for index in word'range loop

        uniform(seed_1, seed_2, value);
        word(index) := '1' when value > 0.5 else '0';

      end loop;

      uniform(seed_1, seed_2, value);

      if (value < 0.25) then
        word     := (others => word(2));
        word(63) := not word(2);
      elsif (value < 0.3) then
        place            := integer(floor(value * 1000.0)) mod 50;
        word(63 - place) := std_ulogic'val(place mod 9);
      end if;

      return word;

    end function operand;

  begin

    seed_1 := 1;
    seed_2 := 2;
    checks := 0;

    for i in 1 to LENGTH loop

      left  <= operand;
      right <= operand;
      wait until falling_edge(clk);

      for l in WIDTHS'range loop

        for r in WIDTHS'range loop

          check(checks, "product of " & integer'image(WIDTHS(l)) & " and " & integer'image(WIDTHS(r)) & " bits", equal(l, r));

        end loop;

      end loop;

    end loop;

    print("checks " & integer'image(checks));
    finish;

  end process p_check;

end architecture bench;
