-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;

-- Purpose:  Duplicated register for one receiver of a broadcast signal. It limits the fan-out: the source drives one
--           register per receiver and not the logic behind them. Synthesis must not merge equal registers: the
--           attribute tells Vivado so, `xtask measure-clock` tells yosys.
-- Generics: Any WIDTH.
-- Timing:   One clock of delay; it never holds.

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
