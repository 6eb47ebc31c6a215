-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_style_pkg.all;

-- Purpose:  Signed product of a data operand and a coefficient, both registered by the memories. The data operand
--           arrives as two words that the pre-adder of a multiplier block adds. Where at most one is not 0 this saves a
--           multiplexer; PRE_ADDER allows both, as long as their sum fits the operand. May be replaced by a vendor's
--           multiplier of the same behaviour.
-- Generics: Operands have 2 bits or more; LATENCY is 1, one multiplier block, or 3, four blocks and two additions.
-- Timing:   The product register is loaded LATENCY clocks after the operands, with DEEP one later: their sum and the
--           coefficient are registered then, and parts have at most 18 bits. All registers hold without ce_i.

entity pe_multiplier is
  generic (
    DATA_BITS        : positive;        -- width of the data operand
    COEFFICIENT_BITS : positive;        -- width of the coefficient operand
    LATENCY          : positive;        -- 1 or 3
    PRE_ADDER        : boolean;         -- both operands at once; otherwise at most one is not 0
    DEEP             : boolean := false -- a register in front of the multiplication
  );
  port (
    clk_i         : in    std_ulogic;                                       -- clock
    ce_i          : in    std_ulogic;                                       -- clock enable
    own_i         : in    signed(DATA_BITS - 1 downto 0);                   -- operand of the own memory, or 0
    imported_i    : in    signed(DATA_BITS - 1 downto 0);                   -- operand of the imported memory, or 0
    coefficient_i : in    signed(COEFFICIENT_BITS - 1 downto 0);            -- coefficient operand
    product_o     : out   signed(DATA_BITS + COEFFICIENT_BITS - 1 downto 0) -- product register
  );
end entity pe_multiplier;

architecture rtl of pe_multiplier is

  constant PRODUCT_BITS : positive := DATA_BITS + COEFFICIENT_BITS;

  -- What is multiplied.
  signal own         : signed(DATA_BITS - 1 downto 0)        := (others => '0');
  signal imported    : signed(DATA_BITS - 1 downto 0)        := (others => '0');
  signal coefficient : signed(COEFFICIENT_BITS - 1 downto 0) := (others => '0');
  signal product     : signed(PRODUCT_BITS - 1 downto 0)     := (others => '0');

  -- Low bits that a second block multiplies, unsigned: at most 24 on a block's wide port, 17 on the narrow one.

  function low_bits (
    width : positive;
    block_bits : positive
  ) return natural is
  begin

    if (width <= block_bits + 1) then
      return 0;
    end if;

    return block_bits;

  end function low_bits;

  -- A block's wide port takes so many unsigned bits; one of 18 bits on both sides is enough with DEEP.

  function wide_bits return positive is
  begin

    if (DEEP) then
      return 17;
    end if;

    return 24;

  end function wide_bits;

  -- synthesis translate_off
  -- Digits of a simulated product: their products and sums fit an integer.
  constant DIGIT_BITS : positive := 13;
  constant DIGIT      : positive := 2 ** DIGIT_BITS;

  type digits_t is array (natural range <>) of integer;

  type weights_t is array (std_ulogic) of integer;

  -- A digit with anything but 0 and 1 is out of range, whatever its other bits are.
  constant WEIGHTS : weights_t := ('1' | 'H' => 1, '0' | 'L' => 0, others => 2 * DIGIT);

  -- Digits of a number, the least significant one first; the last one has the sign.

  function digits (
    number : signed
  ) return digits_t is

    constant TOP : natural := number'length - 1;

    alias bits : signed(TOP downto 0) is number;

    variable found : digits_t(0 to TOP / DIGIT_BITS);

  begin

    for place in found'range loop

      found(place) := 0;

      for index in minimum(TOP, (place + 1) * DIGIT_BITS - 1) downto place * DIGIT_BITS loop

        if (index = TOP) then
          found(place) := -WEIGHTS(bits(index));
        else
          found(place) := 2 * found(place) + WEIGHTS(bits(index));
        end if;

      end loop;

    end loop;

    return found;

  end function digits;

  -- The product by long multiplication of integers, which simulates in a tenth of the time that numeric_std takes.

  function simulated_product (
    left  : signed;
    right : signed
  ) return signed is

    constant LEFT_DIGITS  : digits_t := digits(left);
    constant RIGHT_DIGITS : digits_t := digits(right);

    variable result : signed(left'length + right'length - 1 downto 0);
    variable sum    : integer;
    variable rest   : natural;

  begin

    for place in LEFT_DIGITS'range loop

      if (LEFT_DIGITS(place) < -DIGIT or LEFT_DIGITS(place) >= DIGIT) then
        return (result'range => 'X');
      end if;

    end loop;

    for place in RIGHT_DIGITS'range loop

      if (RIGHT_DIGITS(place) < -DIGIT or RIGHT_DIGITS(place) >= DIGIT) then
        return (result'range => 'X');
      end if;

    end loop;

    sum := 0;

    for place in 0 to (result'length - 1) / DIGIT_BITS loop

      for other in maximum(0, place - RIGHT_DIGITS'high) to minimum(place, LEFT_DIGITS'high) loop

        sum := sum + LEFT_DIGITS(other) * RIGHT_DIGITS(place - other);

      end loop;

      rest := sum mod DIGIT;
      sum  := (sum - rest) / DIGIT;

      for index in place * DIGIT_BITS to minimum(result'high, (place + 1) * DIGIT_BITS - 1) loop

        if (rest mod 2 = 1) then
          result(index) := '1';
        else
          result(index) := '0';
        end if;

        rest := rest / 2;

      end loop;

    end loop;

    return result;

  end function simulated_product;

  -- synthesis translate_on

  -- The product of two operands.

  function product_of (
    left  : signed;
    right : signed
  ) return signed is
  begin

    -- synthesis translate_off
    return simulated_product(left, right);
    -- synthesis translate_on

    return left * right;

  end function product_of;

begin

  assert LATENCY = 1 or LATENCY = 3
    report "pe_multiplier: LATENCY must be 1 or 3"
    severity failure;

  assert DATA_BITS > 1 and COEFFICIENT_BITS > 1
    report "pe_multiplier: operands are signed and have 2 bits or more"
    severity failure;

  g_direct : if not DEEP generate

    own         <= own_i;
    imported    <= imported_i;
    coefficient <= coefficient_i;

  end generate g_direct;

  g_operands : if DEEP generate

    p_operands : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (ce_i = '1') then
          -- Without a carry where one of them is 0.
          if (PRE_ADDER) then
            own <= own_i + imported_i;
          else
            own <= own_i or imported_i;
          end if;

          coefficient <= coefficient_i;
        end if;
      end if;

    end process p_operands;

    imported <= (others => '0');

  end generate g_operands;

  g_single : if LATENCY = 1 generate

    signal whole : signed(PRODUCT_BITS - 1 downto 0) := (others => '0');

    attribute use_dsp of whole       : signal is "yes";
    attribute use_dsp48 of whole     : signal is "yes";
    attribute multstyle of whole     : signal is "dsp";
    attribute syn_multstyle of whole : signal is "block_mult";
    attribute syn_dspstyle of whole  : signal is "dsp";

  begin

    p_multiply : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (ce_i = '1') then
          whole <= product_of(own + imported, coefficient);
        end if;
      end if;

    end process p_multiply;

    product <= whole;

  end generate g_single;

  -- Four partial products of one block each, joined by two registered additions.

  g_split : if LATENCY /= 1 generate

    constant DATA_SPLIT        : natural := low_bits(DATA_BITS, wide_bits);
    constant COEFFICIENT_SPLIT : natural := low_bits(COEFFICIENT_BITS, 17);
    constant OUTER_SPLIT       : natural := DATA_SPLIT + COEFFICIENT_SPLIT;

    subtype data_high_t is signed(DATA_BITS - DATA_SPLIT - 1 downto 0);

    subtype data_low_t is signed(DATA_SPLIT downto 0);

    subtype coefficient_high_t is signed(COEFFICIENT_BITS - COEFFICIENT_SPLIT - 1 downto 0);

    subtype coefficient_low_t is signed(COEFFICIENT_SPLIT downto 0);

    signal high_high : signed(PRODUCT_BITS - OUTER_SPLIT - 1 downto 0)        := (others => '0');
    signal high_low  : signed(DATA_BITS - DATA_SPLIT + COEFFICIENT_SPLIT downto 0) := (others => '0');
    signal low_high  : signed(COEFFICIENT_BITS - COEFFICIENT_SPLIT + DATA_SPLIT downto 0) := (others => '0');
    signal low_low   : signed(OUTER_SPLIT + 1 downto 0)                       := (others => '0');
    signal outer     : signed(PRODUCT_BITS - 1 downto 0)                       := (others => '0');
    signal inner     : signed(PRODUCT_BITS - 1 downto 0)                       := (others => '0');

    attribute use_dsp of high_high, high_low, low_high, low_low       : signal is "yes";
    attribute use_dsp48 of high_high, high_low, low_high, low_low     : signal is "yes";
    attribute multstyle of high_high, high_low, low_high, low_low     : signal is "dsp";
    attribute syn_multstyle of high_high, high_low, low_high, low_low : signal is "block_mult";
    attribute syn_dspstyle of high_high, high_low, low_high, low_low  : signal is "dsp";

  begin

    p_multiply : process (clk_i) is

      variable data             : signed(DATA_BITS - 1 downto 0);
      variable data_high        : data_high_t;
      variable data_low         : data_low_t;
      variable coefficient_high : coefficient_high_t;
      variable coefficient_low  : coefficient_low_t;

    begin

      if rising_edge(clk_i) then
        if (ce_i = '1') then
          if (PRE_ADDER) then
            data      := own + imported;
            data_high := data(DATA_BITS - 1 downto DATA_SPLIT);
            data_low  := '0' & data(DATA_SPLIT - 1 downto 0);
          else
            -- Without a carry from the lower part to the upper one.
            data_high := own(DATA_BITS - 1 downto DATA_SPLIT) + imported(DATA_BITS - 1 downto DATA_SPLIT);
            data_low  := ('0' & own(DATA_SPLIT - 1 downto 0)) + ('0' & imported(DATA_SPLIT - 1 downto 0));
          end if;

          coefficient_high := coefficient(COEFFICIENT_BITS - 1 downto COEFFICIENT_SPLIT);
          coefficient_low  := '0' & coefficient(COEFFICIENT_SPLIT - 1 downto 0);
          high_high        <= product_of(data_high, coefficient_high);
          high_low         <= product_of(data_high, coefficient_low);
          low_high         <= product_of(data_low, coefficient_high);
          low_low          <= product_of(data_low, coefficient_low);

          -- The outer products do not overlap.
          outer   <= high_high & low_low(OUTER_SPLIT - 1 downto 0);
          inner   <= shift_left(resize(high_low, PRODUCT_BITS), DATA_SPLIT)
                     + shift_left(resize(low_high, PRODUCT_BITS), COEFFICIENT_SPLIT);
          product <= outer + inner;
        end if;
      end if;

    end process p_multiply;

  end generate g_split;

  product_o <= product;

end architecture rtl;
