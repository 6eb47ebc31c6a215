-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;

-- Purpose:  A register of its own for one of many that are told the same, so that what tells them drives a register of each
--           and not all that they do with it. Synthesis must not make one of those that are alike: the attribute tells
--           Vivado so, `xtask measure-clock` tells yosys.
-- Generics: Any WIDTH.
-- Timing:   A clock late, and it never stops.

entity pe_replica is
  generic (
    WIDTH : positive -- bits
  );
  port (
    clk_i   : in    std_ulogic;                            -- clock
    value_i : in    std_ulogic_vector(WIDTH - 1 downto 0); -- what all are told
    value_o : out   std_ulogic_vector(WIDTH - 1 downto 0)  -- the same a clock later
  );
end entity pe_replica;

architecture rtl of pe_replica is

  signal value : std_ulogic_vector(WIDTH - 1 downto 0) := (others => '0');

  attribute keep : string;

  attribute keep of value : signal is "true";

begin

  p_replica : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      value <= value_i;
    end if;

  end process p_replica;

  value_o <= value;

end architecture rtl;
