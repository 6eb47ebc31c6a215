-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_register_pkg.all;

-- Purpose:  Runs steps of a network for a host: so many or without end, at their own pace or a given one, within a limit
--           of clocks, or clock by clock.
-- Timing:   A step begins in an enabled clock with busy_i = 0 and step_o = 1, and ends in one with done_i = 1. In a run
--           step_o is 1 until the last step has begun, so a step may begin before the one before has ended: in the same
--           clock, or a few earlier in a deep pipeline. At most two steps are under way. Modes that say how a run goes
--           are taken by start. No order needs another one to have been obeyed.

entity pe_synchronizer is
  port (
    clk_i       : in    std_ulogic;  -- clock
    order_i     : in    run_order_t; -- what the host wants
    accessing_i : in    std_ulogic;  -- the host wants to read or replace states
    fed_i       : in    std_ulogic;  -- a stream lets a step begin
    room_i      : in    std_ulogic;  -- the window of outputs does
    settled_i   : in    std_ulogic;  -- it shows all that it will of the steps that have ended
    ce_o        : out   std_ulogic;  -- clock enable of the network
    step_o      : out   std_ulogic;  -- lets a step begin
    busy_i      : in    std_ulogic;  -- no step can begin
    done_i      : in    std_ulogic;  -- outputs are new
    restart_o   : out   std_ulogic;  -- brings back the initial state
    capture_o   : out   std_ulogic;  -- outputs are new, in this clock
    renew_o     : out   std_ulogic;  -- there are outputs of the initial state, counters begin anew
    run_o       : out   run_state_t  -- what has come of it
  );
end entity pe_synchronizer;

architecture rtl of pe_synchronizer is

  -- Clocks until `busy_i` shows a restart.
  constant HEARING : natural := 7;

  -- Room for any period, and for the clocks by which a step comes late.
  constant TIMER_BITS : positive := 34;

  constant NO_STEPS : unsigned(1 downto 0) := "00";

  -- Bit by bit: GHDL 2.0 writes wide constants as character strings into Verilog.

  function is_latest (
    clocks : signed
  ) return boolean is
  begin

    return clocks(clocks'high) = '1' and (or clocks(clocks'high - 1 downto 0)) = '0';

  end function is_latest;

  -- The run
  signal running  : std_ulogic            := '0';
  signal endless  : std_ulogic            := '0';
  signal paced    : std_ulogic            := '0';
  signal streams  : std_ulogic            := '0';
  signal goes_on  : std_ulogic            := '0';
  signal aborting : std_ulogic            := '0';
  signal left     : unsigned(31 downto 0) := (others => '0');

  -- Steps that have begun and not ended, and enabled clocks since the older and the younger one began
  signal under_way : unsigned(1 downto 0)  := NO_STEPS;
  signal age       : unsigned(31 downto 0) := (others => '0');
  signal age_next  : unsigned(31 downto 0) := (others => '0');
  signal spent     : unsigned(31 downto 0) := (others => '0');
  signal earlier   : unsigned(1 downto 0)  := NO_STEPS; -- of these, begun in an earlier run
  signal frozen    : std_ulogic            := '0';

  -- Clocks until the next step is due, and until the older step under way was due to end
  signal timer   : signed(TIMER_BITS - 1 downto 0) := (others => '0');
  signal slack   : signed(TIMER_BITS - 1 downto 0) := (others => '0');
  signal pacing  : std_ulogic                      := '0';
  signal clocks  : unsigned(31 downto 0)           := (others => '0');
  signal restart : std_ulogic                      := '0';
  signal heard   : natural range 0 to HEARING      := 0;

  signal ce       : std_ulogic;
  signal more     : std_ulogic;
  signal fed      : std_ulogic;
  signal due      : std_ulogic;
  signal late     : std_ulogic;
  signal step     : std_ulogic;
  signal begins   : std_ulogic;
  signal ends     : std_ulogic;
  signal exceeds  : std_ulogic;
  signal finishes : std_ulogic;

begin

  -- Between two steps, states are within reach although the network is halted.
  ce <= restart or (accessing_i and not (or under_way)) when frozen = '1' or (order_i.halt = '1' and clocks = 0) else
        '1';

  fed  <= (fed_i or not streams) and room_i;
  more <= running and (endless or (or left));

  -- The clock in which the next step should begin: then the one before must be done.
  p_late : process (timer, pacing, under_way, ends, more, ce, busy_i, fed) is
  begin

    late <= '0';

    if (pacing = '1' and timer = 0) then
      late <= ((or under_way) and not (under_way(0) and ends)) or (more and (busy_i or not ce or not fed));
    end if;

  end process p_late;

  due    <= '1' when paced = '0' or timer <= 0 else
            '0';
  step   <= more and due and fed and (goes_on or not late) and not accessing_i;
  begins <= ce and step and not busy_i and not restart;
  ends   <= ce and done_i and (or under_way);

  exceeds <= ce and (or under_way) and not ends when order_i.budget /= 0 and spent >= order_i.budget else
             '0';

  finishes <= running and not more and settled_i when under_way = NO_STEPS or (under_way = 1 and ends = '1') else
              '0';

  p_run : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (begins = '1' and endless = '0') then
        left <= left - 1;
      end if;

      if (begins = '1' and ends = '0') then
        under_way <= under_way + 1;
      elsif (begins = '0' and ends = '1') then
        under_way <= under_way - 1;
      end if;

      if (ends = '1' and earlier /= NO_STEPS) then
        earlier <= earlier - 1;
      end if;

      if (finishes = '1') then
        running  <= '0';
        aborting <= '0';
      end if;

      if (order_i.start = '1') then
        running <= '1';
        frozen  <= '0';
        endless <= order_i.free_run;
        paced   <= order_i.pace;
        streams <= order_i.stream;
        goes_on <= order_i.go_on;
        pacing  <= '0';
        earlier <= under_way;
        left    <= order_i.steps - under_way;

        -- A step that was stopped in the middle is the first one.
        if (order_i.steps < under_way) then
          left <= (others => '0');
        end if;
      end if;

      if (order_i.abort = '1' and running = '1' and finishes = '0') then
        aborting <= '1';
        endless  <= '0';
        left     <= (others => '0');
      end if;

      if (late = '1' and goes_on = '0') then
        endless <= '0';
        left    <= (others => '0');
      end if;

      if (begins = '1') then
        pacing <= paced;
      end if;

      if (exceeds = '1') then
        frozen   <= '1';
        running  <= '0';
        aborting <= '0';
      end if;

      if (order_i.restart = '1') then
        running   <= '0';
        aborting  <= '0';
        frozen    <= '0';
        under_way <= NO_STEPS;
        earlier   <= NO_STEPS;
        pacing    <= '0';
      end if;
    end if;

  end process p_run;

  -- Counters rest when nothing asks for them: they take most of the time of a simulation that waits for its host.
  p_age : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (ce = '1' and (or under_way) = '1') then
        age   <= age + 1;
        spent <= spent + 1;

        if (under_way(1) = '1') then
          age_next <= age_next + 1;
        end if;

        if (ends = '1') then
          age   <= age_next + 1;
          spent <= age_next + 1;
        end if;
      end if;

      if (begins = '1') then
        age_next <= to_unsigned(1, 32);

        if (under_way = NO_STEPS or (under_way = 1 and ends = '1')) then
          age   <= to_unsigned(1, 32);
          spent <= to_unsigned(1, 32);
        end if;
      end if;

      if (order_i.start = '1') then
        spent <= to_unsigned(1, 32);
      end if;
    end if;

  end process p_age;

  p_pace : process (clk_i) is

    variable next_timer : signed(TIMER_BITS - 1 downto 0);

  begin

    if rising_edge(clk_i) then
      next_timer := timer;

      if (paced = '1' and not is_latest(timer)) then
        next_timer := timer - 1;
      end if;

      if (paced = '1' and not is_latest(slack)) then
        slack <= slack - 1;
      end if;

      if (ends = '1') then
        slack <= next_timer;
      end if;

      if (begins = '1') then
        next_timer := signed(resize(order_i.period, TIMER_BITS)) - 1;

        if (under_way = NO_STEPS or (under_way = 1 and ends = '1')) then
          slack <= next_timer;
        end if;
      end if;

      if (order_i.start = '1') then
        next_timer := (others => '0');
      end if;

      timer <= next_timer;
    end if;

  end process p_pace;

  p_clocks : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (clocks /= 0) then
        clocks <= clocks - 1;
      end if;

      if (order_i.give_clocks = '1') then
        clocks <= order_i.clocks;
      end if;

      if (order_i.halt = '0') then
        clocks <= (others => '0');
      end if;
    end if;

  end process p_clocks;

  p_restart : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (heard /= 0) then
        heard <= heard - 1;
      elsif (busy_i = '0') then
        restart <= '0';
      end if;

      if (order_i.restart = '1') then
        restart <= '1';
        heard   <= HEARING;
      end if;
    end if;

  end process p_restart;

  ce_o      <= ce;
  step_o    <= step and not restart;
  restart_o <= '1' when restart = '1' and heard = HEARING else
               '0';
  capture_o <= ends;
  renew_o   <= order_i.restart;

  run_o.busy       <= running or restart;
  run_o.finished   <= finishes or exceeds;
  run_o.exceeded   <= exceeds;
  run_o.overrun    <= late;
  run_o.aborted    <= finishes and aborting;
  run_o.unfinished <= frozen;
  run_o.stepping   <= or under_way;
  run_o.clocks     <= clocks;
  run_o.enabled    <= ce and (or under_way);
  run_o.done       <= ends;
  run_o.latency    <= age;
  run_o.streaming  <= streams and running;
  run_o.more       <= more;
  run_o.begins     <= begins;
  run_o.paced      <= paced when earlier = NO_STEPS else
                      '0';
  run_o.slack      <= slack;

end architecture rtl;
