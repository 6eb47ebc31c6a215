-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library std;
  use std.textio.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Prints the ports of a host and of output memories as timing diagrams, which xtask timing puts into docs/hardware.md: a
-- column for each clock, as it is just before the clock's rising edge. Two PEs of 16 control words per step are replaced
-- by what they do with the ports: their base memories hold 5 and 7, and each shows two words per step. Checks that a
-- state is there after its clocks, that all new words are taken, and that an output read in time is of the step before.

entity host_ports_tb is
  generic (
    SHOWN  : string   := "read"; -- `read` or `replace` states, `restart`, `outputs`
    DEEP   : boolean  := false;  -- pipeline
    CLOCKS : positive := 56;     -- columns
    FIRST  : positive := 1       -- clock of the first column
  );
end entity host_ports_tb;

architecture bench of host_ports_tb is

  constant PERIOD  : positive := 16;
  constant PAUSE   : positive := pause_word(1, DEEP);
  constant LATENCY : positive := 6;

  -- Initial word, PE, control word
  constant ORDER : word_array_t(0 to 1)(12 downto 0) := (0 => b"00000101_0_0011", 1 => b"00000111_1_0101");

  -- Output memory, and the place there
  constant PLACES : word_array_t(0 to 3)(1 downto 0) := (0 => b"0_0", 1 => b"1_0", 2 => b"0_1", 3 => b"1_1");

  signal clk       : std_ulogic                     := '0';
  signal step      : std_ulogic                     := '0';
  signal restart   : std_ulogic                     := '0';
  signal request   : std_ulogic                     := '0';
  signal granted   : std_ulogic;
  signal address   : std_ulogic_vector(1 downto 0)  := (others => '0');
  signal state     : std_ulogic_vector(7 downto 0);
  signal new_state : std_ulogic_vector(7 downto 0)  := x"03";
  signal valid     : std_ulogic                     := '0';
  signal ready     : std_ulogic;
  signal busy      : std_ulogic;
  signal done      : std_ulogic;
  signal advance   : std_ulogic;
  signal settle    : std_ulogic;
  signal publish   : std_ulogic;
  signal index     : std_ulogic_vector(3 downto 0);
  signal waiting   : std_ulogic;
  signal filling   : std_ulogic;
  signal following : std_ulogic_vector(3 downto 0);
  signal hold      : std_ulogic;
  signal refill    : std_ulogic;
  signal replace   : std_ulogic;
  signal pace      : std_ulogic;
  signal look      : std_ulogic;
  signal here      : std_ulogic_vector(1 downto 0);
  signal place     : std_ulogic_vector(0 downto 0);
  signal words     : std_ulogic_vector(15 downto 0) := (others => '0');
  signal behind    : std_ulogic_vector(15 downto 0) := (others => '0');
  signal counts    : std_ulogic_vector(7 downto 0)  := (others => '0');

  -- Outputs
  signal output_address : std_ulogic_vector(1 downto 0) := (others => '0');
  signal output         : std_ulogic_vector(7 downto 0);
  signal output_here    : std_ulogic_vector(1 downto 0);
  signal output_place   : std_ulogic_vector(0 downto 0);
  signal output_words   : std_ulogic_vector(15 downto 0);
  signal shown_word     : std_ulogic_vector(15 downto 0);
  signal show           : std_ulogic_vector(1 downto 0);
  signal shows          : unsigned(5 downto 0)          := "000001";
  signal ended          : boolean                       := false;

begin

  clk <= not clk after 5 ns when not ended else
         '0';

  u_sequencer : entity pe_lib.pe_sequencer
    generic map (
      PERIOD     => PERIOD,
      ROUNDS     => 1,
      PAUSE_WORD => PAUSE,
      ACCESSED   => true,
      DEEP       => DEEP
    )
    port map (
      clk_i     => clk,
      ce_i      => '1',
      step_i    => step,
      hold_i    => hold,
      refill_i  => refill,
      replace_i => replace,
      pace_i    => pace,
      fetch_o   => open,
      address_o => open,
      repeat_o  => open,
      round_o   => open,
      advance_o => advance,
      index_o   => index,
      parity_o  => open,
      last_o    => open,
      settle_o  => settle,
      sample_o  => open,
      arrive_o  => open,
      publish_o => publish,
      busy_o    => busy,
      waiting_o => waiting,
      filling_o => filling,
      next_o    => following,
      done_o    => done
    );

  u_access : entity pe_lib.pe_access
    generic map (
      WORD_BITS    => 8,
      DATA_BITS    => 8,
      PE_COUNT     => 2,
      TICK_COUNT   => 0,
      PERIOD       => PERIOD,
      PAUSE_WORD   => PAUSE,
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
      state_address_i => address,
      state_o         => state,
      state_i         => new_state,
      state_valid_i   => valid,
      state_ready_o   => ready,
      waiting_i       => waiting,
      filling_i       => filling,
      next_i          => following,
      hold_o          => hold,
      refill_o        => refill,
      replace_o       => replace,
      pace_o          => pace,
      look_o          => look,
      here_o          => here,
      place_o         => place,
      word_o          => open,
      words_i         => words,
      counts_i        => counts
    );

  -- Base memories, as far as they are read.
  p_bases : process (clk) is

    variable read : std_ulogic_vector(15 downto 0);

  begin

    if rising_edge(clk) then
      read := (others => '0');

      if (look = '1' and here(0) = '1') then
        read(7 downto 0) := x"05";
      end if;

      if (look = '1' and here(1) = '1') then
        read(15 downto 8) := x"07";
      end if;

      behind <= read;
      words  <= read;

      if (DEEP) then
        words <= behind;
      end if;

      -- The step that a word is shown of, in tens.
      if (publish = '1') then
        shows <= shows + 1;
      end if;
    end if;

  end process p_bases;

  g_outputs : for i in 0 to 1 generate

    signal shown_value : unsigned(7 downto 0);

  begin

    -- In words 11 and 13 each PE shows what tells step and output.
    show(i)     <= advance when unsigned(index) = 11 or unsigned(index) = 13 else
                   '0';
    shown_value <= resize(shows * 4, 8) + i when unsigned(index) = 11 else
                   resize(shows * 4, 8) + i + 2;

    shown_word((i + 1) * 8 - 1 downto i * 8) <= std_ulogic_vector(shown_value);

    u_memory : entity pe_lib.pe_output_memory
      generic map (
        WORDS      => 2,
        SHOWN_BITS => 8,
        DATA_BITS  => 8
      )
      port map (
        clk_i     => clk,
        write_i   => show(i),
        word_i    => shown_word((i + 1) * 8 - 1 downto i * 8),
        settle_i  => settle,
        publish_i => publish,
        here_i    => output_here(i),
        place_i   => output_place,
        word_o    => output_words((i + 1) * 8 - 1 downto i * 8)
      );

  end generate g_outputs;

  u_reader : entity pe_lib.pe_output_reader
    generic map (
      STORAGE_BITS => 8,
      WORD_BITS    => 8,
      DATA_BITS    => 8,
      SHOWN_BITS   => 8,
      MEMORIES     => 2,
      PLACE_BITS   => 1,
      OUTPUTS      => 4,
      PLACES       => PLACES
    )
    port map (
      clk_i     => clk,
      address_i => output_address,
      here_o    => output_here,
      place_o   => output_place,
      words_i   => output_words,
      value_o   => output
    );

  p_watch : process is

    subtype row_t is string(1 to CLOCKS);

    type rows_t is array (natural range <>) of row_t;

    variable rows   : rows_t(0 to 9);
    variable tens   : row_t;
    variable ones   : row_t;
    variable text   : line;
    variable column : integer;
    variable checks : natural := 0;
    variable taken  : natural := 0;
    variable dones  : natural := 0;
    variable since  : natural := 99;
    variable number : natural;
    variable held   : natural := 0;

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
      value : natural
    ) return character is
    begin

      return character'val(character'pos('0') + value mod 10);

    end function digit;

    procedure put (
      name : string;
      row  : row_t
    ) is
    begin

      write(text, name, left, 18);
      write(text, row);
      writeline(std.textio.output, text);

    end procedure put;

    procedure record_columns (
      clock : positive
    ) is
    begin

      column := clock - FIRST + 1;

      if (column < 1) then
        return;
      end if;

      ones(column)    := digit(clock - 1);
      tens(column)    := ' ';
      rows(0)(column) := level(step);
      rows(1)(column) := level(busy);
      rows(2)(column) := level(restart);
      rows(3)(column) := level(request);
      rows(4)(column) := level(granted);
      rows(5)(column) := digit(to_integer(unsigned(address)));
      rows(6)(column) := digit(to_integer(unsigned(state)));
      rows(7)(column) := level(valid);
      rows(8)(column) := level(ready);
      rows(9)(column) := level(done);

      if ((clock - 1) mod 10 = 0) then
        tens(column) := digit((clock - 1) / 10);
      end if;

      if (SHOWN = "outputs") then
        -- The output that is read, the one that is there, and its step.
        rows(2)(column) := digit(to_integer(unsigned(output_address)));
        number          := to_integer(unsigned(output));
        rows(3)(column) := digit(number mod 4);
        rows(4)(column) := digit(number / 4);
      end if;

    end procedure record_columns;

  begin

    for clock in 1 to CLOCKS + FIRST - 1 loop

      wait for 3 ns;
      record_columns(clock);

      if (ready = '1' and valid = '1') then
        taken := taken + 1;
      end if;

      wait until falling_edge(clk);
      since := since + 1;

      if (done = '1') then
        dones := dones + 1;
        since := 0;
      end if;

      if (SHOWN = "outputs") then
        step <= '1';
        -- One output after the other, from done_o on.
        output_address <= std_ulogic_vector(to_unsigned(since mod 4, 2));

        -- All but those of the last two addresses before done_o.
        if (dones > 1 and since >= LATENCY) then
          assert to_integer(unsigned(output)) / 4 = dones
            report "host_ports_tb: an output is of another step"
            severity failure;
          checks := checks + 1;
        end if;
      elsif (SHOWN = "restart") then
        restart <= '1' when clock = 12 else
                   '0';
      else
        if (granted = '1') then
          held := held + 1;
        end if;

        request <= '1' when clock > 12 and (SHOWN = "replace" or held < 11) else
                   '0';

        if (SHOWN = "read") then
          if (held = 3) then
            address <= "10";
          end if;
        else
          valid <= '1' when clock > 17 and taken < 2 else
                   '0';
        end if;
      end if;

      wait for 1 ns;

    end loop;

    if (SHOWN = "read") then
      assert to_integer(unsigned(state)) = 7
        report "host_ports_tb: another state was read"
        severity failure;
      checks := checks + 1;
    elsif (SHOWN = "replace") then
      assert taken = 2
        report "host_ports_tb: not all new words were taken"
        severity failure;
      checks := checks + 1;
    elsif (SHOWN = "restart") then
      assert busy = '0' and dones = 0
        report "host_ports_tb: the network is not where a step can begin"
        severity failure;
      checks := checks + 1;
    end if;

    put("clock", tens);
    put("", ones);

    if (SHOWN = "outputs") then
      put("step_i", rows(0));
      put("busy_o", rows(1));
      put("done_o", rows(9));
      put("output_address_i", rows(2));
      put("output_o", rows(3));
      put("of step", rows(4));
    else
      put("busy_o", rows(1));

      if (SHOWN = "restart") then
        put("restart_i", rows(2));
      else
        put("access_i", rows(3));
        put("access_o", rows(4));
      end if;

      if (SHOWN = "read") then
        put("state_address_i", rows(5));
        put("state_o", rows(6));
      elsif (SHOWN = "replace") then
        put("state_valid_i", rows(7));
        put("state_ready_o", rows(8));
      end if;
    end if;

    write(text, string'("checks "));
    write(text, checks);
    writeline(std.textio.output, text);

    assert checks > 0
      report "host_ports_tb: nothing was checked"
      severity failure;

    ended <= true;
    wait;

  end process p_watch;

end architecture bench;
