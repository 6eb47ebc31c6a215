-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library std;
  use std.textio.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Prints the handshake as timing diagrams, which xtask timing puts into docs/hardware.md: a column for each clock, as it
-- is just before the clock's rising edge. Steps are numbered from 1; an input that follows the outputs takes
-- RESPONSE clocks after done_o. Checks what the datasheet says: a step begins in enabled clocks with busy_o = 0 and
-- step_i = 1 only, done_o stays for one enabled clock, and with step_i gated no input is taken before done_o.

entity handshake_tb is
  generic (
    DEEP   : boolean  := false; -- pipeline
    GATED  : boolean  := false; -- step_i waits for done_o
    GAPS   : boolean  := false; -- clocks with ce_i = 0
    CLOCKS : positive := 56     -- columns
  );
end entity handshake_tb;

architecture bench of handshake_tb is

  constant PERIOD   : positive := 16;
  constant PAUSE    : positive := pause_word(1, DEEP);
  constant RESPONSE : positive := 3;

  signal clk     : std_ulogic := '0';
  signal ce      : std_ulogic := '1';
  signal step    : std_ulogic := '1';
  signal sample  : std_ulogic;
  signal publish : std_ulogic;
  signal busy    : std_ulogic;
  signal done    : std_ulogic;
  signal ended   : boolean    := false;

begin

  clk <= not clk after 5 ns when not ended else
         '0';

  u_sequencer : entity pe_lib.pe_sequencer
    generic map (
      PERIOD     => PERIOD,
      ROUNDS     => 1,
      PAUSE_WORD => PAUSE,
      DEEP       => DEEP
    )
    port map (
      clk_i     => clk,
      ce_i      => ce,
      step_i    => step,
      fetch_o   => open,
      address_o => open,
      repeat_o  => open,
      round_o   => open,
      advance_o => open,
      index_o   => open,
      parity_o  => open,
      last_o    => open,
      settle_o  => open,
      sample_o  => sample,
      arrive_o  => open,
      publish_o => publish,
      busy_o    => busy,
      done_o    => done
    );

  p_watch : process is

    subtype row_t is string(1 to CLOCKS);

    variable row_ce    : row_t;
    variable row_step  : row_t;
    variable row_busy  : row_t;
    variable row_done  : row_t;
    variable row_taken : row_t;
    variable row_ports : row_t;
    variable tens      : row_t;
    variable ones      : row_t;
    variable taken     : natural    := 0;
    variable ports     : natural    := 0;
    variable told      : natural    := 0;
    variable wait_for  : natural    := 0;
    variable late      : std_ulogic := '0';
    variable began     : std_ulogic := '0';
    variable seen      : std_ulogic := '0';
    variable text      : line;

    function level (
      bit_value : std_ulogic
    ) return character is
    begin

      if (bit_value = '1') then
        return '-';
      end if;

      return '_';

    end function level;

    function digit (
      number : natural
    ) return character is
    begin

      return character'val(character'pos('0') + number mod 10);

    end function digit;

    procedure put (
      name : string;
      row  : row_t
    ) is
    begin

      write(text, name, left, 10);
      write(text, row);
      writeline(output, text);

    end procedure put;

  begin

    for clock in 1 to CLOCKS loop

      wait for 3 ns;
      ones(clock) := digit(clock - 1);
      tens(clock) := ' ';

      if ((clock - 1) mod 10 = 0) then
        tens(clock) := digit((clock - 1) / 10);
      end if;

      row_ce(clock)   := level(ce);
      row_step(clock) := level(step);
      row_busy(clock) := level(busy);
      row_done(clock) := level(done);
      assert sample = (ce and step and not busy)
        report "handshake_tb: a step begins where it must not, or does not where it must"
        severity failure;

      if (done = '1' and ce = '1') then
        told := told + 1;
      end if;

      row_taken(clock) := '.';

      if (sample = '1') then
        assert not GATED or taken = told
          report "handshake_tb: an input was taken before the outputs that it follows"
          severity failure;
        taken            := taken + 1;
        row_taken(clock) := digit(taken);
      end if;

      row_ports(clock) := digit(ports);
      -- The step's outputs are on the ports a clock after publish_o, in a deep pipeline two.
      if ((not DEEP and publish = '1') or (DEEP and late = '1')) then
        ports := ports + 1;
      end if;

      late  := publish;
      began := sample;
      seen  := done and ce;
      wait until falling_edge(clk);

      if (GATED) then
        if (began = '1') then
          step <= '0';
        end if;

        if (seen = '1') then
          wait_for := RESPONSE;
        elsif (wait_for > 0) then
          wait_for := wait_for - 1;

          if (wait_for = 0) then
            step <= '1';
          end if;
        end if;
      end if;

      if (GAPS) then
        ce <= '1';

        if (clock mod 7 = 0 or clock mod 7 = 1 or clock mod 11 = 5) then
          ce <= '0';
        end if;
      end if;

      wait for 1 ns;

    end loop;

    put("clock", tens);
    put("", ones);
    put("ce_i", row_ce);
    put("step_i", row_step);
    put("busy_o", row_busy);
    put("inputs", row_taken);
    put("outputs", row_ports);
    put("done_o", row_done);
    write(text, string'("checks "));
    write(text, CLOCKS);
    writeline(output, text);
    assert told >= 2
      report "handshake_tb: too few steps"
      severity failure;
    ended <= true;
    wait;

  end process p_watch;

end architecture bench;
