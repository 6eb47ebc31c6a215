-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_register_pkg.all;

-- Purpose:  Counts steps and clocks of a network, and keeps the longest and the shortest step.
-- Timing:   Counters follow a clock after the event; `flagged` two clocks after the end of a step, when its last word has
--           shown in the flags. All counters but that of the overruns, which stays at its end, wrap.

entity pe_counters is
  port (
    clk_i      : in    std_ulogic;  -- clock
    renew_i    : in    std_ulogic;  -- all begin anew
    clear_i    : in    std_ulogic;  -- all but `steps` begin anew
    run_i      : in    run_state_t; -- what happens
    flag_i     : in    std_ulogic;  -- a flag is up; each time for one clock
    counters_o : out   counters_t   -- what there was
  );
end entity pe_counters;

architecture rtl of pe_counters is

  constant MOST_SLACK  : signed(31 downto 0) := (31 => '0', others => '1');
  constant LEAST_SLACK : signed(31 downto 0) := (31 => '1', others => '0');

  signal steps    : unsigned(63 downto 0) := (others => '0');
  signal clocks   : unsigned(63 downto 0) := (others => '0');
  signal last     : unsigned(31 downto 0) := (others => '0');
  signal longest  : unsigned(31 downto 0) := (others => '0');
  signal shortest : unsigned(31 downto 0) := (others => '1');
  signal slack    : signed(31 downto 0)   := MOST_SLACK;
  signal overruns : unsigned(31 downto 0) := (others => '0');
  signal flagged  : unsigned(31 downto 0) := (others => '0');
  signal seen     : std_ulogic            := '0';
  signal ended    : std_ulogic            := '0';

  signal less_by : signed(34 downto 0);
  signal is_less : std_ulogic;

begin

  -- The sign of a difference: GHDL 2.0 writes comparisons of signed numbers of two widths into Verilog without signs.
  less_by <= resize(run_i.slack, 35) - resize(slack, 35);
  is_less <= less_by(34);

  p_count : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      ended <= run_i.done;
      seen  <= seen or flag_i;

      if (run_i.enabled = '1') then
        clocks <= clocks + 1;
      end if;

      if (run_i.done = '1') then
        steps <= steps + 1;
        last  <= run_i.latency;

        if (run_i.latency > longest) then
          longest <= run_i.latency;
        end if;

        if (run_i.latency < shortest) then
          shortest <= run_i.latency;
        end if;

        -- What is less than the least number is that one.
        if (run_i.paced = '1' and is_less = '1') then
          slack <= run_i.slack(31 downto 0);

          if (run_i.slack(33 downto 31) /= "000" and run_i.slack(33 downto 31) /= "111") then
            slack <= LEAST_SLACK;
          end if;
        end if;
      end if;

      if (run_i.overrun = '1' and overruns /= x"FFFFFFFF") then
        overruns <= overruns + 1;
      end if;

      if (ended = '1') then
        seen <= '0';

        if (seen = '1' or flag_i = '1') then
          flagged <= flagged + 1;
        end if;
      end if;

      if (clear_i = '1' or renew_i = '1') then
        clocks   <= (others => '0');
        last     <= (others => '0');
        longest  <= (others => '0');
        shortest <= (others => '1');
        slack    <= MOST_SLACK;
        overruns <= (others => '0');
        flagged  <= (others => '0');
        seen     <= '0';
      end if;

      if (renew_i = '1') then
        steps <= (others => '0');
        ended <= '0';
      end if;
    end if;

  end process p_count;

  counters_o.steps    <= steps;
  counters_o.clocks   <= clocks;
  counters_o.last     <= last;
  counters_o.longest  <= longest;
  counters_o.shortest <= shortest;
  counters_o.slack    <= slack;
  counters_o.overruns <= overruns;
  counters_o.flagged  <= flagged;

end architecture rtl;
