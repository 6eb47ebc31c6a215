-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Purpose:  Reads and replaces the states of a network between two steps, and brings back its initial state. To read a
--           word it borrows the read port of a base memory. To replace states it runs one step in which all products and
--           bases are 0, and adds each replacement as the word of its state is computed: the program itself then takes
--           the words to all memories that hold them. Since words before the pause point have read states already, it
--           empties the pipelines, by a first pass without operands, and fills them anew before that step and at the end.
-- Generics: ORDER has a row per state and tick in the order in which they are replaced: the initial word, 0 bits of it
--           without INITIAL; the number of the PE, or PE_COUNT and the number of the tick; the control word that adds it.
-- Timing:   access_o rises at the pause point after access_i, and falls with it or while states are replaced. Then
--           state_o is the word at state_address_i of some clocks before (three, or four with DEEP), and a word of
--           state_i is taken in each enabled clock with state_valid_i and state_ready_o, until all have come. restart_i is
--           kept until the network has come to the pause point, and ends a replacement that waits for words. All
--           registers hold without ce_i.

entity pe_access is
  generic (
    WORD_BITS    : positive;     -- stored word, guard bits included
    DATA_BITS    : positive;     -- data operand
    PE_COUNT     : positive;     -- PEs
    TICK_COUNT   : natural;      -- ticks
    PERIOD       : positive;     -- control words per step
    PAUSE_WORD   : positive;     -- the network waits before it
    PLACE_BITS   : positive;     -- low bits of an address: the base word
    ADDRESS_BITS : positive;     -- address; upper bits: PE, or tick behind the PEs
    STATES       : boolean;      -- a host reads and replaces states
    INITIAL      : boolean;      -- there is a restart
    ORDER        : word_array_t; -- what is replaced in which order
    DEEP         : boolean       -- PEs follow four clocks later
  );
  port (
    clk_i           : in    std_ulogic;                                                       -- clock
    ce_i            : in    std_ulogic;                                                       -- clock enable
    restart_i       : in    std_ulogic;                                                       -- brings back the initial state
    access_i        : in    std_ulogic;                                                       -- a host asks for the states
    access_o        : out   std_ulogic;                                                       -- it has access
    state_address_i : in    std_ulogic_vector(ADDRESS_BITS - 1 downto 0);                     -- state to read
    state_o         : out   std_ulogic_vector(WORD_BITS - 1 downto 0);                        -- its word
    state_i         : in    std_ulogic_vector(WORD_BITS - 1 downto 0);                        -- the next state's new word
    state_valid_i   : in    std_ulogic;                                                       -- there is one
    state_ready_o   : out   std_ulogic;                                                       -- it is taken
    waiting_i       : in    std_ulogic;                                                       -- the network is at the pause point
    filling_i       : in    std_ulogic;                                                       -- first pass
    next_i          : in    std_ulogic_vector(larger(index_bits(PERIOD), 1) - 1 downto 0);    -- word to execute
    hold_o          : out   std_ulogic;                                                       -- no step may begin
    refill_o        : out   std_ulogic;                                                       -- the first pass, again
    replace_o       : out   std_ulogic;                                                       -- the step replaces states
    pace_o          : out   std_ulogic;                                                       -- its next word
    look_o          : out   std_ulogic;                                                       -- base memories are read
    here_o          : out   std_ulogic_vector(PE_COUNT + TICK_COUNT - 1 downto 0);            -- the PE or tick in question
    place_o         : out   std_ulogic_vector(PLACE_BITS - 1 downto 0);                       -- its base word to read
    word_o          : out   std_ulogic_vector(WORD_BITS downto 0);                            -- replacement less the offset
    words_i         : in    std_ulogic_vector(PE_COUNT * WORD_BITS - 1 downto 0);             -- base words that were read
    counts_i        : in    std_ulogic_vector(larger(TICK_COUNT, 1) * WORD_BITS - 1 downto 0) -- counters of the ticks
  );
end entity pe_access;

architecture rtl of pe_access is

  -- A number that is there on a condition.

  function present (
    condition : boolean;
    count     : natural
  ) return natural is
  begin

    if (condition) then
      return count;
    end if;

    return 0;

  end function present;

  constant INITIAL_BITS : natural  := present(INITIAL, WORD_BITS);
  constant WORD_INDEX   : positive := larger(index_bits(PERIOD), 1);
  constant TARGET_BITS  : positive := larger(index_bits(PE_COUNT + TICK_COUNT), 1);
  constant ROW_BITS     : positive := INITIAL_BITS + TARGET_BITS + WORD_INDEX;
  constant ROWS         : positive := ORDER'length;
  constant COUNT_BITS   : positive := larger(index_bits(ROWS + 1), 1);

  -- Clocks until PEs have executed a word, and until what they are told has come to rest.
  constant FOLLOW : natural := present(DEEP, 7);

  type phase_t is (running, entering, granted, emptying, flushing, filling, heading, matching, giving, pacing, leaving, refilling);

  signal phase     : phase_t                                               := running;
  signal wait_for  : natural range 0 to 7                                  := 0;
  signal restart   : std_ulogic                                            := '0';
  signal fetch     : std_ulogic;
  signal host      : std_ulogic                                            := '0';
  signal stepping  : std_ulogic                                            := '0';
  signal replacing : std_ulogic                                            := '0';
  signal hold      : std_ulogic                                            := '0';
  signal replace   : std_ulogic                                            := '0';
  signal look      : std_ulogic                                            := '0';
  signal row       : unsigned(COUNT_BITS - 1 downto 0)                     := (others => '0');
  signal row_place : std_ulogic_vector(larger(index_bits(ROWS), 1) - 1 downto 0);
  signal content   : std_ulogic_vector(ROW_BITS - 1 downto 0);
  signal target    : unsigned(TARGET_BITS - 1 downto 0);
  signal here      : std_ulogic_vector(PE_COUNT + TICK_COUNT - 1 downto 0) := (others => '0');
  signal place     : std_ulogic_vector(PLACE_BITS - 1 downto 0)            := (others => '0');
  signal word      : std_ulogic_vector(WORD_BITS downto 0)                 := (others => '0');
  signal looked    : std_ulogic_vector(WORD_BITS - 1 downto 0);
  signal state     : std_ulogic_vector(WORD_BITS - 1 downto 0)             := (others => '0');
  signal is_tick   : std_ulogic;
  signal due       : std_ulogic;
  signal source    : std_ulogic_vector(WORD_BITS - 1 downto 0);
  signal offset    : signed(WORD_BITS downto 0);

begin

  -- Bit by bit: GHDL 2.0 writes wide constants as character strings into Verilog.

  g_offset : for i in 0 to WORD_BITS generate

    offset(i) <= '1' when i = WORD_BITS - DATA_BITS - 1 else
                 '0';

  end generate g_offset;

  u_order : entity pe_lib.pe_rom
    generic map (
      CONTROL_BITS => ROW_BITS,
      PERIOD       => ROWS,
      CONTENT      => ORDER
    )
    port map (
      clk_i     => clk_i,
      fetch_i   => fetch,
      address_i => row_place,
      control_o => content
    );

  fetch     <= '1' when phase = heading and ce_i = '1' else
               '0';
  row_place <= std_ulogic_vector(resize(row, row_place'length));
  target    <= unsigned(content(WORD_INDEX + TARGET_BITS - 1 downto WORD_INDEX));

  g_initial : if INITIAL generate

    source <= state_i when STATES and host = '1' else
              content(ROW_BITS - 1 downto ROW_BITS - WORD_BITS);

  end generate g_initial;

  g_host : if not INITIAL generate

    source <= state_i;

  end generate g_host;

  -- GHDL 2.0 cuts a constant that does not fit the number it is compared with, so without ticks nothing is compared.
  is_tick <= '1' when TICK_COUNT > 0 and target >= PE_COUNT else
             '0';

  -- Whether the row is for the word that is executed next. The last words of the first pass add to words that are
  -- written behind the pause point.
  p_due : process (row, is_tick, filling_i, next_i, content) is
  begin

    due <= '0';

    if (row /= ROWS) then
      if (is_tick = '1') then
        due <= '1';
      elsif (next_i = content(WORD_INDEX - 1 downto 0) and (filling_i = '0' or unsigned(next_i) >= PAUSE_WORD - 2)) then
        due <= '1';
      end if;
    end if;

  end process p_due;

  p_phase : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (ce_i = '1') then
        if (INITIAL and restart_i = '1') then
          restart <= '1';
        end if;

        here <= (others => '0');

        if (STATES and phase = granted) then

          for i in here'range loop

            if (unsigned(state_address_i(ADDRESS_BITS - 1 downto PLACE_BITS)) = i) then
              here(i) <= '1';
            end if;

          end loop;

          place <= state_address_i(PLACE_BITS - 1 downto 0);
          state <= looked;
        end if;

        if (wait_for > 0) then
          wait_for <= wait_for - 1;
        else
          -- No `case`: GHDL writes it into Verilog without a default, which yosys takes for latches.
          if (phase = running) then
            hold <= restart;

            if (STATES and access_i = '1') then
              hold <= '1';
            end if;

            -- Whoever asked may have gone away again.
            if (hold = '1' and waiting_i = '1') then
              hold     <= '1';
              phase    <= entering;
              wait_for <= FOLLOW;
            end if;
          elsif (phase = entering) then
            phase <= granted;
            host  <= not restart;

            if (STATES) then
              look <= '1';
            end if;
          elsif (phase = granted) then
            host      <= not restart;
            replacing <= restart;

            if (STATES and access_i = '1' and state_valid_i = '1') then
              replacing <= '1';
            end if;

            if (restart = '1' or not STATES or access_i = '0' or state_valid_i = '1') then
              phase    <= emptying;
              look     <= '0';
              here     <= (others => '0');
              replace  <= '1';
              stepping <= '0';
              row      <= (others => '0');
              wait_for <= FOLLOW;
            end if;
          elsif (phase = emptying) then
            phase <= flushing;
          elsif (phase = flushing) then
            if (waiting_i = '1') then
              wait_for <= FOLLOW;
              phase    <= leaving;

              if (replacing = '1') then
                phase <= filling;
              end if;
            end if;
          elsif (phase = filling) then
            phase <= heading;
          elsif (phase = heading) then
            phase <= matching;
          elsif (phase = matching) then
            if (host = '1' and restart = '1') then
              -- Whoever began to write need not come back.
              host     <= '0';
              phase    <= emptying;
              stepping <= '0';
              row      <= (others => '0');
            elsif (due = '1') then
              if (host = '0' or (STATES and state_valid_i = '1')) then

                for i in here'range loop

                  if (target = i) then
                    here(i) <= '1';
                  end if;

                end loop;

                word <= std_ulogic_vector(resize(signed(source), WORD_BITS + 1) - offset);

                if (is_tick = '1') then
                  word <= std_ulogic_vector(resize(signed(source), WORD_BITS + 1));
                end if;

                row   <= row + 1;
                phase <= giving;
              end if;
            else
              phase <= pacing;
            end if;
          elsif (phase = giving) then
            phase <= heading;
          elsif (phase = pacing) then
            phase    <= matching;
            wait_for <= FOLLOW;

            if (waiting_i = '1') then
              stepping <= '1';

              -- The second time: the step is done.
              if (stepping = '1') then
                replace  <= '0';
                phase    <= entering;
                wait_for <= FOLLOW;

                -- After the words of a host it is still to come.
                if (host = '0') then
                  restart <= '0';
                end if;
              end if;
            end if;
          elsif (phase = leaving) then
            replace <= '0';
            phase   <= refilling;
          else
            -- Refilling
            if (waiting_i = '1') then
              hold  <= restart;
              phase <= running;

              -- What was asked for meanwhile comes before another step.
              if ((INITIAL and restart_i = '1') or (STATES and access_i = '1')) then
                hold <= '1';
              end if;
            end if;
          end if;
        end if;
      end if;
    end if;

  end process p_phase;

  -- What a base memory reads without an enable is the offset.
  p_looked : process (words_i, counts_i, here, offset) is

    variable merged : std_ulogic_vector(WORD_BITS - 1 downto 0);

  begin

    merged := (others => '0');

    for i in 0 to PE_COUNT - 1 loop

      merged := merged or (words_i((i + 1) * WORD_BITS - 1 downto i * WORD_BITS)
                           xor std_ulogic_vector(offset(WORD_BITS - 1 downto 0)));

    end loop;

    looked <= merged xor std_ulogic_vector(offset(WORD_BITS - 1 downto 0));

    for i in 0 to TICK_COUNT - 1 loop

      if (here(PE_COUNT + i) = '1') then
        looked <= counts_i((i + 1) * WORD_BITS - 1 downto i * WORD_BITS);
      end if;

    end loop;

  end process p_looked;

  access_o      <= '1' when STATES and phase = granted and access_i = '1' and host = '1' and restart = '0' else
                   '0';
  state_ready_o <= '1' when STATES and phase = matching and wait_for = 0 and due = '1' and host = '1' and restart = '0' else
                   '0';
  state_o       <= state;
  hold_o        <= hold;
  refill_o      <= '1' when ce_i = '1' and wait_for = 0 and (phase = emptying or phase = filling or phase = leaving) else
                   '0';
  replace_o     <= replace;
  pace_o        <= '1' when wait_for = 0 and ((phase = pacing and (waiting_i = '0' or stepping = '0'))
                                               or (phase = flushing and waiting_i = '0')) else
                   '0';
  look_o        <= look;
  here_o        <= here;
  place_o       <= place;
  word_o        <= word;

end architecture rtl;
