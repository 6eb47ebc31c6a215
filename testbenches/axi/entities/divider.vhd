-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

-- Purpose:  A user's divider: one bit of the quotient in each clock, leading zeros at once, so its time varies.
-- Timing:   start begins a division, done is 1 until the next one. An asynchronous reset.

entity divider is
  generic (
    WIDTH : positive := 40
  );
  port (
    clk       : in    std_logic;
    rst       : in    std_logic;
    en        : in    std_logic;
    start     : in    std_logic;
    dividend  : in    std_logic_vector(WIDTH - 1 downto 0);
    divisor   : in    std_logic_vector(WIDTH - 1 downto 0);
    done      : out   std_logic;
    quotient  : out   std_logic_vector(WIDTH - 1 downto 0);
    remainder : out   std_logic_vector(WIDTH - 1 downto 0)
  );
end entity divider;

architecture rtl of divider is

  signal busy : std_logic;
  signal left : natural range 0 to WIDTH;
  signal rest : unsigned(WIDTH downto 0);
  signal down : unsigned(WIDTH - 1 downto 0);
  signal by   : unsigned(WIDTH - 1 downto 0);
  signal bits : unsigned(WIDTH - 1 downto 0);

  function length_of (
    number : std_logic_vector
  ) return natural is

    variable result : natural range 0 to WIDTH;

  begin

    result := 0;

    for i in 0 to WIDTH - 1 loop

      if (number(i) = '1') then
        result := i + 1;
      end if;

    end loop;

    return result;

  end function length_of;

begin

  p_divide : process (clk, rst) is

    variable next_rest : unsigned(WIDTH downto 0);

  begin

    if (rst = '1') then
      busy <= '0';
      left <= 0;
      rest <= (others => '0');
      down <= (others => '0');
      by   <= (others => '0');
      bits <= (others => '0');
    elsif rising_edge(clk) then
      if (en = '1') then
        if (start = '1') then
          busy <= '1';
          left <= length_of(dividend);
          rest <= (others => '0');
          down <= shift_left(unsigned(dividend), WIDTH - length_of(dividend));
          by   <= unsigned(divisor);
          bits <= (others => '0');
        elsif (left /= 0) then
          next_rest    := shift_left(rest, 1);
          next_rest(0) := down(WIDTH - 1);
          bits         <= shift_left(bits, 1);

          if (next_rest >= by) then
            next_rest := next_rest - by;
            bits(0)   <= '1';
          end if;

          rest <= next_rest;
          down <= shift_left(down, 1);
          left <= left - 1;
        else
          busy <= '0';
        end if;
      end if;
    end if;

  end process p_divide;

  done      <= not busy;
  quotient  <= std_logic_vector(bits);
  remainder <= std_logic_vector(rest(WIDTH - 1 downto 0));

end architecture rtl;
