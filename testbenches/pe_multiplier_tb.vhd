-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;
  use ieee.math_real.all;

library std;
  use std.env.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_trace_pkg.all;

library work;
  use work.check_pkg.all;

-- Products of both latencies and pipelines against the operator, with clock enable and extreme operands.

entity pe_multiplier_tb is
end entity pe_multiplier_tb;

architecture bench of pe_multiplier_tb is

  constant LENGTH : positive := 2000;

  signal clk         : std_ulogic          := '0';
  signal ce          : std_ulogic          := '1';
  signal own         : signed(31 downto 0) := (others => '0');
  signal imported    : signed(31 downto 0) := (others => '0');
  signal coefficient : signed(31 downto 0) := (others => '0');
  signal narrow      : signed(42 downto 0);
  signal wide        : signed(63 downto 0);

  -- Operands whose sums fit.
  signal own_half      : signed(31 downto 0) := (others => '0');
  signal imported_half : signed(31 downto 0) := (others => '0');
  signal joined        : signed(63 downto 0);
  signal deep          : signed(63 downto 0);
  signal deep_narrow   : signed(42 downto 0);

begin

  clk <= not clk after 5 ns;

  u_narrow : entity pe_lib.pe_multiplier
    generic map (
      DATA_BITS        => 25,
      COEFFICIENT_BITS => 18,
      LATENCY          => 1,
      PRE_ADDER        => true
    )
    port map (
      clk_i         => clk,
      ce_i          => ce,
      own_i         => own(31 downto 7),
      imported_i    => imported(31 downto 7),
      coefficient_i => coefficient(31 downto 14),
      product_o     => narrow
    );

  u_wide : entity pe_lib.pe_multiplier
    generic map (
      DATA_BITS        => 32,
      COEFFICIENT_BITS => 32,
      LATENCY          => 3,
      PRE_ADDER        => false
    )
    port map (
      clk_i         => clk,
      ce_i          => ce,
      own_i         => own,
      imported_i    => imported,
      coefficient_i => coefficient,
      product_o     => wide
    );

  u_joined : entity pe_lib.pe_multiplier
    generic map (
      DATA_BITS        => 32,
      COEFFICIENT_BITS => 32,
      LATENCY          => 3,
      PRE_ADDER        => true
    )
    port map (
      clk_i         => clk,
      ce_i          => ce,
      own_i         => own_half,
      imported_i    => imported_half,
      coefficient_i => coefficient,
      product_o     => joined
    );

  u_deep : entity pe_lib.pe_multiplier
    generic map (
      DATA_BITS        => 32,
      COEFFICIENT_BITS => 32,
      LATENCY          => 3,
      PRE_ADDER        => true,
      DEEP             => true
    )
    port map (
      clk_i         => clk,
      ce_i          => ce,
      own_i         => own_half,
      imported_i    => imported_half,
      coefficient_i => coefficient,
      product_o     => deep
    );

  u_deep_narrow : entity pe_lib.pe_multiplier
    generic map (
      DATA_BITS        => 25,
      COEFFICIENT_BITS => 18,
      LATENCY          => 1,
      PRE_ADDER        => false,
      DEEP             => true
    )
    port map (
      clk_i         => clk,
      ce_i          => ce,
      own_i         => own(31 downto 7),
      imported_i    => imported(31 downto 7),
      coefficient_i => coefficient(31 downto 14),
      product_o     => deep_narrow
    );

  p_check : process is

    type products_t is array (0 to 3) of signed(63 downto 0);

    variable wide_products   : products_t;
    variable joined_products : products_t;
    variable narrow_products : products_t;
    variable seed_1          : positive;
    variable seed_2          : positive;
    variable checks          : natural;

    -- A random operand, every fourth one extreme.

    impure function operand return signed is

      variable value : real;
      variable word  : signed(31 downto 0);

    begin

      uniform(seed_1, seed_2, value);
      word := to_signed(integer(floor((value - 0.5) * 4294967295.0)), 32);

      if (word(1 downto 0) = 0) then
        word     := (others => word(2));
        word(31) := not word(2);
      end if;

      return word;

    end function operand;

  begin

    seed_1          := 1;
    seed_2          := 2;
    checks          := 0;
    wide_products   := (others => (others => '0'));
    joined_products := (others => (others => '0'));
    narrow_products := (others => (others => '0'));

    for i in 1 to LENGTH loop

      -- One of the data operands is 0.
      own         <= operand;
      imported    <= (others => '0');
      coefficient <= operand;

      own_half      <= shift_right(operand, 1);
      imported_half <= shift_right(operand, 1);

      if (i mod 2 = 0) then
        own      <= (others => '0');
        imported <= operand;
      end if;

      wait until rising_edge(clk);
      wide_products(1 to 3)   := wide_products(0 to 2);
      wide_products(0)        := (own + imported) * coefficient;
      joined_products(1 to 3) := joined_products(0 to 2);
      joined_products(0)      := (own_half + imported_half) * coefficient;
      narrow_products(1 to 3) := narrow_products(0 to 2);
      narrow_products(0)      := resize((own(31 downto 7) + imported(31 downto 7)) * coefficient(31 downto 14), 64);
      ce                      <= '0';

      -- Without clock enable nothing moves.
      wait until falling_edge(clk);
      wait until falling_edge(clk);

      check(checks, "25x18 product", narrow = (own(31 downto 7) + imported(31 downto 7)) * coefficient(31 downto 14));
      check(checks, "32x32 product", wide = wide_products(2));
      check(checks, "32x32 product of a sum", joined = joined_products(2));
      check(checks, "32x32 product of a deep pipeline", deep = joined_products(3));
      check(checks, "25x18 product of a deep pipeline", deep_narrow = narrow_products(1));

      ce <= '1';

    end loop;

    print("checks " & integer'image(checks));
    finish;

  end process p_check;

end architecture bench;
