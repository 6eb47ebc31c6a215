-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library std;
  use std.env.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_trace_pkg.all;

library work;
  use work.check_pkg.all;

-- Word order, pause, settle, parity and handshake of the sequencer, in free run and with waits; with
-- DEEP the same three clocks later, enabled or not.

entity pe_sequencer_tb is
end entity pe_sequencer_tb;

architecture bench of pe_sequencer_tb is

  constant PERIOD : positive := 22;
  constant ROUNDS : positive := 2;
  constant PAUSE  : positive := 7;

  signal clk     : std_ulogic := '0';
  signal ce      : std_ulogic := '1';
  signal step    : std_ulogic := '1';
  signal fetch   : std_ulogic;
  signal address : std_ulogic_vector(4 downto 0);
  signal place   : std_ulogic_vector(3 downto 0);
  signal advance : std_ulogic;
  signal index   : std_ulogic_vector(4 downto 0);
  signal parity  : std_ulogic;
  signal last    : std_ulogic;
  signal settle  : std_ulogic;
  signal sample  : std_ulogic;
  signal publish : std_ulogic;
  signal busy    : std_ulogic;
  signal done    : std_ulogic;

  -- Of a deep pipeline.
  signal late_address : std_ulogic_vector(4 downto 0);
  signal late_place   : std_ulogic_vector(3 downto 0);
  signal late_advance : std_ulogic;
  signal late_index   : std_ulogic_vector(4 downto 0);
  signal late_parity  : std_ulogic;
  signal late_last    : std_ulogic;
  signal late_settle  : std_ulogic;
  signal late_sample  : std_ulogic;
  signal late_arrive  : std_ulogic;
  signal late_publish : std_ulogic;
  signal late_busy    : std_ulogic;
  signal late_done    : std_ulogic;

begin

  clk <= not clk after 5 ns;

  u_sequencer : entity pe_lib.pe_sequencer
    generic map (
      PERIOD     => PERIOD,
      ROUNDS     => ROUNDS,
      PAUSE_WORD => PAUSE
    )
    port map (
      clk_i     => clk,
      ce_i      => ce,
      step_i    => step,
      fetch_o   => fetch,
      address_o => address,
      repeat_o  => place,
      advance_o => advance,
      index_o   => index,
      parity_o  => parity,
      last_o    => last,
      settle_o  => settle,
      sample_o  => sample,
      publish_o => publish,
      busy_o    => busy,
      done_o    => done
    );

  u_late : entity pe_lib.pe_sequencer
    generic map (
      PERIOD     => PERIOD,
      ROUNDS     => ROUNDS,
      PAUSE_WORD => PAUSE,
      DEEP       => true
    )
    port map (
      clk_i     => clk,
      ce_i      => ce,
      step_i    => step,
      fetch_o   => open,
      address_o => late_address,
      repeat_o  => late_place,
      advance_o => late_advance,
      index_o   => late_index,
      parity_o  => late_parity,
      last_o    => late_last,
      settle_o  => late_settle,
      sample_o  => late_sample,
      arrive_o  => late_arrive,
      publish_o => late_publish,
      busy_o    => late_busy,
      done_o    => late_done
    );

  p_late : process is

    type history_t is array (0 to 5) of std_ulogic_vector(10 downto 0);

    -- The short pipeline's signals in this and the last clocks, enabled or not.
    variable history   : history_t;
    variable clocks    : natural;
    variable published : natural;
    variable seen      : natural;

  begin

    history   := (others => (others => '0'));
    clocks    := 0;
    published := 0;
    seen      := 0;

    loop

      wait until rising_edge(clk);
      history(1 to 5) := history(0 to 4);
      history(0)      := advance & index & parity & last & settle & sample & publish;

      assert late_sample = sample and late_busy = busy
        report "the handshake is not that of the short pipeline"
        severity failure;

      assert late_address = index and to_integer(unsigned(late_place)) = to_integer(unsigned(index)) mod (PERIOD / ROUNDS)
        report "programs are not read at the word that is next"
        severity failure;

      if (clocks >= 3) then
        assert late_advance & late_index & late_parity & late_last & late_settle & late_arrive & late_publish = history(3)
          report "PEs are not told the same three clocks later"
          severity failure;
      end if;

      if (history(5)(0) = '1') then
        published := published + 1;

        assert late_done = '1'
          report "outputs are new and nobody is told"
          severity failure;
      end if;

      if (late_done = '1' and ce = '1') then
        seen := seen + 1;

        assert seen = published
          report "a step is done twice, or one is missing"
          severity failure;
      end if;

      clocks := clocks + 1;

    end loop;

  end process p_late;

  p_check : process is

    variable checks   : natural;
    variable executed : natural;
    variable samples  : natural;
    variable finished : natural;
    variable round    : natural;

  begin

    checks   := 0;
    executed := 0;
    samples  := 0;
    finished := 0;

    for clock in 0 to 1999 loop

      wait until rising_edge(clk);

      if (advance = '1') then
        round    := executed / (PERIOD / ROUNDS);
        check(checks, "word index", to_integer(unsigned(index)) = executed mod PERIOD);
        check(checks, "next word", to_integer(unsigned(address)) = (executed + 1) mod PERIOD);
        check(checks, "parity", (parity = '1') = (round mod 2 = 1));
        check(checks, "word within the round", to_integer(unsigned(place)) = (executed + 1) mod (PERIOD / ROUNDS));
        check(checks, "last", (last = '1') = (executed >= PAUSE and (executed - PAUSE) / (PERIOD / ROUNDS) mod ROUNDS = ROUNDS - 1));
        check(checks, "settle", (settle = '1') = (executed < PAUSE));
        check(checks, "sample at the pause point", (sample = '1') = (executed mod PERIOD = PAUSE));
        check(checks, "publish before it", (publish = '1') = (executed mod PERIOD = PAUSE - 1 and executed > PAUSE));
        check(checks, "idle only at the pause point", (busy = '0') = (executed mod PERIOD = PAUSE));
        check(checks, "enabled", ce = '1');
        executed := executed + 1;

        if (sample = '1') then
          samples := samples + 1;
        end if;
      else
        check(checks, "nothing sampled", sample = '0');
      end if;

      if (ce = '1' and done = '1') then
        finished := finished + 1;
        check(checks, "one step finished per sample", finished = samples or finished = samples - 1);
        check(checks, "at the pause point", busy = '0');
      end if;

      -- Free run, then pseudo-random enable and step.
      if (clock > 200) then
        if (clock * 7919 mod 13 < 9) then
          ce <= '1';
        else
          ce <= '0';
        end if;

        if (clock * 104729 mod 11 < 3) then
          step <= '1';
        else
          step <= '0';
        end if;
      end if;

    end loop;

    check(checks, "steps were made", finished > 30);
    print("checks " & integer'image(checks));
    finish;

  end process p_check;

end architecture bench;
