-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

-- Purpose:  A user's generator of numbers without a reset and without start: it goes on while it is enabled, and shows a
--           number each time last is 1, in one clock of one to four. Names that other languages reserve.

entity \wire\ is
  port (
    clock       : in    std_ulogic;
    enable      : in    std_ulogic;
    int         : in    signed(62 downto 0);
    \class\     : in    std_ulogic;
    last        : out   std_ulogic;
    \begin\     : out   signed(63 downto 0);
    \else "if"\ : out   std_ulogic_vector(62 downto 0)
  );
end entity \wire\;

architecture rtl of \wire\ is

  signal phase : unsigned(1 downto 0)  := "00";
  signal turns : unsigned(1 downto 0)  := "00";
  signal sum   : signed(63 downto 0)   := (others => '0');
  signal steps : unsigned(62 downto 0) := (others => '0');

begin

  p_phase : process (clock) is
  begin

    if rising_edge(clock) then
      if (enable = '1') then
        phase <= phase + 1;

        if (phase = turns) then
          phase <= "00";
          turns <= turns + 1;
          sum   <= sum + int;
          steps <= steps + 1;
        end if;
      end if;
    end if;

  end process p_phase;

  last        <= '1' when phase = turns else
                 '0';
  \begin\     <= sum + int when \class\ = '1' else
                 sum;
  \else "if"\ <= std_ulogic_vector(steps);

end architecture rtl;
