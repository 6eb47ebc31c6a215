-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

package smoothing_pkg is

  constant GUARD : natural := 2 * 2;

end package smoothing_pkg;

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;
  use work.smoothing_pkg.all;

-- Purpose:  A user's filter: y follows x by 1/2**SHIFT of the difference, in a step of two clocks. Its outputs depend on its
--           inputs without a register, so they are those of a step only while these stand still.
-- Timing:   A synchronous reset under the clock enable.

entity smoothing is
  generic (
    WIDTH   : positive := 16;
    SHIFT   : natural  := 3;
    INVERTS : boolean  := false
  );
  port (
    clk      : in    std_logic;
    rst_n    : in    std_logic;
    ce       : in    std_logic;
    x        : in    signed(WIDTH - 1 downto 0);
    gain     : in    unsigned(0 to 3);
    mode     : in    std_logic_vector(1 downto 0);
    slow     : in    std_logic_vector(7 downto 0);
    is_above : out   std_logic;
    y        : out   signed(WIDTH + GUARD - 1 downto 0);
    sum      : out   unsigned(WIDTH - 1 downto 0);
    count    : out   std_logic_vector(31 downto 0);
    \a slow\ : out   std_ulogic_vector(7 downto 0);
    spare    : out   std_logic_vector(3 downto 0)
  );
end entity smoothing;

architecture rtl of smoothing is

  signal state  : signed(y'range);
  signal second : std_logic;
  signal ticks  : unsigned(31 downto 0);

begin

  p_state : process (clk) is

    variable wide : signed(y'range);

  begin

    if rising_edge(clk) then
      if (ce = '1') then
        ticks  <= ticks + 1;
        second <= not second;

        if (second = '1') then
          wide  := shift_left(resize(x, wide'length), GUARD);
          state <= state + shift_right(wide - state, SHIFT);
        end if;

        if (rst_n = '0') then
          state  <= (others => '0');
          second <= '0';
          ticks  <= (others => '0');
        end if;
      end if;
    end if;

  end process p_state;

  -- Of the inputs that stand still, and of the state
  y        <= -state when INVERTS else
              state;
  is_above <= '1' when shift_left(resize(x, state'length), GUARD) > state else
              '0';
  sum      <= resize(unsigned(x) + gain, WIDTH) when mode = "10" else
              (others => '0');
  count    <= std_logic_vector(ticks);
  \a slow\ <= std_ulogic_vector(slow);
  spare    <= mode & mode;

end architecture rtl;
