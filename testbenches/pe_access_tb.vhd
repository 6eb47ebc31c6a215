-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library std;
  use std.textio.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- A restart at any time, in both pipelines: while the network computes steps, while another restart is under way, while a
-- host replaces states, only has access, or asks for it and goes away. No step begins before all states are the initial ones, but for those that
-- begin before the restart can be heard; and none is replaced by another word afterwards.

entity pe_access_tb is
end entity pe_access_tb;

architecture bench of pe_access_tb is

  constant PERIOD : positive := 16;

  -- Initial word, PE, control word
  constant ORDER : word_array_t(0 to 1)(12 downto 0) := (0 => b"00000101_0_0011", 1 => b"00000111_1_0101");

  -- Clocks from the first demand to the restart
  constant LONGEST : positive := 220;

  type counts_t is array (0 to 1) of natural;

  signal checks : counts_t                  := (others => 0);
  signal ended  : std_ulogic_vector(0 to 1) := "00";

begin

  g_pipeline : for depth in 0 to 1 generate

    constant DEEP : boolean := depth = 1;

    signal clk       : std_ulogic := '0';
    signal restart   : std_ulogic := '0';
    signal request   : std_ulogic := '0';
    signal valid     : std_ulogic := '0';
    signal ready     : std_ulogic;
    signal granted   : std_ulogic;
    signal busy      : std_ulogic;
    signal waiting   : std_ulogic;
    signal filling   : std_ulogic;
    signal following : std_ulogic_vector(3 downto 0);
    signal hold      : std_ulogic;
    signal refill    : std_ulogic;
    signal replace   : std_ulogic;
    signal pace      : std_ulogic;
    signal here      : std_ulogic_vector(1 downto 0);
    signal word      : std_ulogic_vector(8 downto 0);

  begin

    clk <= not clk after 5 ns when ended(depth) = '0' else
           '0';

    u_sequencer : entity pe_lib.pe_sequencer
      generic map (
        PERIOD     => PERIOD,
        ROUNDS     => 1,
        PAUSE_WORD => pause_word(1, DEEP),
        ACCESSED   => true,
        DEEP       => DEEP
      )
      port map (
        clk_i     => clk,
        ce_i      => '1',
        step_i    => '1',
        hold_i    => hold,
        refill_i  => refill,
        replace_i => replace,
        pace_i    => pace,
        fetch_o   => open,
        address_o => open,
        repeat_o  => open,
        round_o   => open,
        advance_o => open,
        index_o   => open,
        parity_o  => open,
        last_o    => open,
        settle_o  => open,
        sample_o  => open,
        arrive_o  => open,
        publish_o => open,
        busy_o    => busy,
        waiting_o => waiting,
        filling_o => filling,
        next_o    => following,
        done_o    => open
      );

    u_access : entity pe_lib.pe_access
      generic map (
        WORD_BITS    => 8,
        DATA_BITS    => 8,
        PE_COUNT     => 2,
        TICK_COUNT   => 0,
        PERIOD       => PERIOD,
        PAUSE_WORD   => pause_word(1, DEEP),
        PLACE_BITS   => 1,
        ADDRESS_BITS => 2,
        STATES       => true,
        INITIAL      => true,
        ORDER        => ORDER,
        DEEP         => DEEP
      )
      port map (
        clk_i           => clk,
        ce_i            => '1',
        restart_i       => restart,
        access_i        => request,
        access_o        => granted,
        state_address_i => "00",
        state_o         => open,
        state_i         => x"03",
        state_valid_i   => valid,
        state_ready_o   => ready,
        waiting_i       => waiting,
        filling_i       => filling,
        next_i          => following,
        hold_o          => hold,
        refill_o        => refill,
        replace_o       => replace,
        pace_o          => pace,
        look_o          => open,
        here_o          => here,
        place_o         => open,
        word_o          => word,
        words_i         => (others => '0'),
        counts_i        => (others => '0')
      );

    p_try : process is

      type words_t is array (0 to 1) of integer;

      variable last    : words_t;
      variable since   : integer;
      variable begins  : natural;
      variable taken   : natural;
      variable was     : std_ulogic;
      variable initial : boolean;
      variable held    : boolean;

      -- What is there just before the rising edge, and then the edge.

      procedure tick is
      begin

        wait for 4 ns;

        for pe in 0 to 1 loop

          if (replace = '1' and here(pe) = '1') then
            last(pe) := to_integer(signed(word));
          end if;

        end loop;

        -- The step that replaced states is over.
        if (was = '1' and replace = '0' and last = (5, 7)) then
          initial := true;
        end if;

        assert was = '1' or replace = '0' or waiting = '1'
          report "pe_access_tb: states are replaced in the middle of a step"
          severity failure;

        was := replace;

        if (ready = '1' and valid = '1') then
          taken := taken + 1;
        end if;

        if (since >= 0) then
          since := since + 1;
        end if;

        if (busy = '0') then
          begins := begins + 1;

          assert replace = '0' and refill = '0' and granted = '0'
            report "pe_access_tb: a step begins while states are replaced"
            severity failure;

          -- The restart is heard two clocks after it, unless the network is held already.
          if (since > 2 or (since > 0 and held)) then
            assert initial
              report "pe_access_tb: a step begins before a restart"
              severity failure;
          end if;
        end if;

        wait until falling_edge(clk);

      end procedure tick;

    begin

      wait until falling_edge(clk);

      for kind in 0 to 5 loop

        for gap in 1 to LONGEST loop

          begins  := 0;
          since   := -1;
          taken   := 0;
          was     := replace;
          initial := false;
          last    := (0, 0);

          while (begins < 2) loop

            tick;

          end loop;

          -- Nothing, a restart, new states, access for a while, for a clock, or for short again and again
          for clock in 1 to gap loop

            restart <= '1' when kind = 1 and clock = 1 else
                       '0';
            request <= '1' when kind = 2 or (kind = 3 and clock < 60) or (kind = 4 and clock = gap / 2) else
                       '1' when kind = 5 and clock mod 37 < 2 else
                       '0';
            valid   <= '1' when kind = 2 and taken < 2 else
                       '0';
            tick;

          end loop;

          -- Words of a restart that was done before do not count.
          initial := false;
          restart <= '1';
          held    := hold = '1';
          since   := 0;
          tick;
          restart <= '0';
          request <= '0';
          valid   <= '0';
          begins  := 0;

          while (begins < 2) loop

            tick;

          end loop;

          assert initial
            report "pe_access_tb: a restart was forgotten"
            severity failure;
          checks(depth) <= checks(depth) + 1;

        end loop;

      end loop;

      ended(depth) <= '1';
      wait;

    end process p_try;

  end generate g_pipeline;

  p_tell : process is

    variable text : line;

  begin

    wait until ended = "11";
    write(text, string'("checks "));
    write(text, checks(0) + checks(1));
    writeline(std.textio.output, text);
    wait;

  end process p_tell;

end architecture bench;
