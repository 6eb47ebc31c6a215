-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Purpose:  Broadcasts the word index to all PEs and runs the step handshake. A step has one or more rounds of equal
--           length.
-- Generics: PERIOD is a multiple of ROUNDS, and a round has more than PAUSE_WORD control words.
-- Timing:   A step begins, and samples the inputs, in an enabled clock with busy_o = 0 and step_i = 1; done_o is 1 for
--           one enabled clock when its outputs are valid. The first pass over the words before the pause word only
--           fills the pipelines (settle). ce_i must be 0 or 1 at every edge, step_i at every enabled one in which the
--           network waits; simulation stops otherwise.

entity pe_sequencer is
  generic (
    PERIOD     : positive;         -- control words per step
    ROUNDS     : positive;         -- rounds per step
    PAUSE_WORD : positive;         -- the network waits before it
    ACCESSED   : boolean := false; -- obeys pe_access
    RING_BITS  : natural := 0;     -- bits that count steps for rings, 0 without rings
    DEEP       : boolean := false  -- PEs follow four clocks later
  );
  port (
    clk_i     : in    std_ulogic;                                                             -- clock
    ce_i      : in    std_ulogic;                                                             -- clock enable
    step_i    : in    std_ulogic;                                                             -- lets the next step begin
    hold_i    : in    std_ulogic := '0';                                                      -- lets no step begin
    refill_i  : in    std_ulogic := '0';                                                      -- fills the pipelines again
    replace_i : in    std_ulogic := '0';                                                      -- a step that replaces states
    pace_i    : in    std_ulogic := '0';                                                      -- goes on to its next word
    fetch_o   : out   std_ulogic;                                                             -- reads the programs
    address_o : out   std_ulogic_vector(larger(index_bits(PERIOD), 1) - 1 downto 0);          -- control word to load
    repeat_o  : out   std_ulogic_vector(larger(index_bits(PERIOD / ROUNDS), 1) - 1 downto 0); -- the same within a round
    round_o   : out   std_ulogic_vector(larger(index_bits(ROUNDS), 1) - 1 downto 0);          -- round of that word
    advance_o : out   std_ulogic;                                                             -- executes the control words
    index_o   : out   std_ulogic_vector(larger(index_bits(PERIOD), 1) - 1 downto 0);          -- word that is executed
    parity_o  : out   std_ulogic;                                                             -- 1 in odd rounds
    last_o    : out   std_ulogic;                                                             -- writes belong to the last round
    turn_o    : out   std_ulogic_vector(larger(RING_BITS, 1) - 1 downto 0);                   -- number of the step
    settle_o  : out   std_ulogic;                                                             -- first pass
    sample_o  : out   std_ulogic;                                                             -- inputs load their registers
    arrive_o  : out   std_ulogic;                                                             -- inputs load their operands, with DEEP
    publish_o : out   std_ulogic;                                                             -- outputs load their ports
    busy_o    : out   std_ulogic;                                                             -- not waiting for step_i
    waiting_o : out   std_ulogic;                                                             -- at the pause point
    filling_o : out   std_ulogic;                                                             -- first pass, no replica
    next_o    : out   std_ulogic_vector(larger(index_bits(PERIOD), 1) - 1 downto 0);          -- word to execute, no replica
    done_o    : out   std_ulogic                                                              -- outputs are new
  );
end entity pe_sequencer;

architecture rtl of pe_sequencer is

  constant INDEX_WIDTH : positive := larger(index_bits(PERIOD), 1);
  constant ROUND_WORDS : positive := PERIOD / ROUNDS;

  signal address : unsigned(INDEX_WIDTH - 1 downto 0)                        := (others => '0');
  signal place   : unsigned(larger(index_bits(ROUND_WORDS), 1) - 1 downto 0) := (others => '0');
  signal round   : unsigned(larger(index_bits(ROUNDS), 1) - 1 downto 0)      := (others => '0');
  signal last    : std_ulogic                                                := '0';
  signal index   : unsigned(INDEX_WIDTH - 1 downto 0)                        := (others => '0');
  signal valid   : std_ulogic                                                := '0';
  signal waiting : std_ulogic                                                := '0';
  signal settle  : std_ulogic                                                := '1';
  signal parity  : std_ulogic                                                := '0';
  signal turn    : unsigned(turn_o'range)                                    := (others => '0');
  signal done    : std_ulogic                                                := '0';
  signal fetch   : std_ulogic;
  signal publish : std_ulogic;

begin

  assert ROUND_WORDS > PAUSE_WORD and ROUND_WORDS * ROUNDS = PERIOD
    report "pe_sequencer: a round needs more than PAUSE_WORD control words, and all rounds as many"
    severity failure;

  -- synthesis translate_off
  p_handshake : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      assert not is_x(ce_i)
        report "pe_sequencer: ce_i is undefined"
        severity failure;
      assert ce_i = '0' or waiting = '0' or not is_x(step_i)
        report "pe_sequencer: step_i is undefined while the network waits for it"
        severity failure;
    end if;

  end process p_handshake;

  -- synthesis translate_on

  g_accessed : if ACCESSED generate

    fetch <= ce_i and pace_i when replace_i = '1' else
             ce_i and ((step_i and not hold_i) or not waiting);

  end generate g_accessed;

  g_closed : if not ACCESSED generate

    fetch <= ce_i and (step_i or not waiting);

  end generate g_closed;

  p_publish : process (fetch, settle, address) is
  begin

    publish <= '0';

    if (address = PAUSE_WORD) then
      publish <= fetch and not settle and not replace_i;
    end if;

  end process p_publish;

  p_sequence : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (fetch = '1') then
        index   <= address;
        valid   <= '1';
        waiting <= '0';

        if (address = PERIOD - 1) then
          address <= (others => '0');
        else
          address <= address + 1;
        end if;

        if (place = ROUND_WORDS - 1) then
          place <= (others => '0');

          if (address = PERIOD - 1) then
            round <= (others => '0');
          else
            round <= round + 1;
          end if;
        else
          place <= place + 1;
        end if;

        if (address = PAUSE_WORD) then
          waiting <= '1';
          settle  <= '0';
        end if;

        if (place = 0 and valid = '1') then
          parity <= not parity;
        end if;

        if (RING_BITS > 0 and address = 0 and valid = '1') then
          turn <= turn + 1;
        end if;

        -- Writes before this place in a round finish the round before.
        if (place = PAUSE_WORD) then
          last <= '0';

          if (address >= PERIOD - ROUND_WORDS) then
            last <= '1';
          end if;
        end if;
      end if;

      if (ACCESSED and refill_i = '1') then
        address <= (others => '0');
        place   <= (others => '0');
        round   <= (others => '0');
        valid   <= '0';
        waiting <= '0';
        settle  <= '1';
      end if;
    end if;

  end process p_sequence;

  g_direct : if not DEEP generate

    p_done : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (ce_i = '1') then
          done <= publish;
        end if;
      end if;

    end process p_done;

    fetch_o   <= fetch;
    arrive_o  <= '0';
    address_o <= std_ulogic_vector(address);
    repeat_o  <= std_ulogic_vector(place);
    advance_o <= fetch and valid;
    index_o   <= std_ulogic_vector(index);
    parity_o  <= parity;
    last_o    <= last;
    turn_o    <= std_ulogic_vector(turn);
    settle_o  <= settle;
    publish_o <= publish;

  end generate g_direct;

  -- What the PEs are told leaves two registers later, and each of them has a replica, so they follow four clocks behind:
  -- as many as a control word takes on its way from the address to the PE. None of these registers stops. A clock
  -- without fetch is a clock later one in which nothing is executed, so a clock enable at the PEs comes from a register,
  -- and `ce_i` does not reach them.

  g_late : if DEEP generate

    signal advances   : std_ulogic_vector(3 downto 1) := (others => '0');
    signal parities   : std_ulogic_vector(3 downto 1) := (others => '0');
    signal lasts      : std_ulogic_vector(3 downto 1) := (others => '0');
    signal settles    : std_ulogic_vector(3 downto 1) := (others => '1');
    signal arrivals   : std_ulogic_vector(3 downto 1) := (others => '0');
    signal publishes  : std_ulogic_vector(4 downto 1) := (others => '0');
    signal place_next : unsigned(place'range)         := (others => '0');
    signal index_1    : unsigned(index'range)         := (others => '0');
    signal index_2    : unsigned(index'range)         := (others => '0');
    signal index_3    : unsigned(index'range)         := (others => '0');
    signal turn_1     : unsigned(turn'range)          := (others => '0');
    signal turn_2     : unsigned(turn'range)          := (others => '0');
    signal turn_3     : unsigned(turn'range)          := (others => '0');
    signal turn_4     : unsigned(turn'range)          := (others => '0');

  begin

    p_late : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        advances  <= advances(2 downto 1) & (fetch and valid);
        parities  <= parities(2 downto 1) & parity;
        lasts     <= lasts(2 downto 1) & last;
        settles   <= settles(2 downto 1) & settle;
        arrivals  <= arrivals(2 downto 1) & (fetch and waiting and not replace_i);
        publishes <= publishes(3 downto 1) & publish;
        index_1   <= index;
        index_2   <= index_1;
        index_3   <= index_2;
        turn_1    <= turn;
        turn_2    <= turn_1;
        turn_3    <= turn_2;
        turn_4    <= turn_3;

        if (fetch = '1') then
          place_next <= place;
        end if;

        -- Until an enabled clock has seen it.
        if (ce_i = '1') then
          done <= '0';
        end if;

        if (publishes(4) = '1') then
          done <= '1';
        end if;
      end if;

    end process p_late;

    fetch_o   <= '1';
    address_o <= std_ulogic_vector(index);
    repeat_o  <= std_ulogic_vector(place_next);
    advance_o <= advances(3);
    index_o   <= std_ulogic_vector(index_3);
    parity_o  <= parities(3);
    last_o    <= lasts(3);
    -- In place of a replica in each PE.
    turn_o    <= std_ulogic_vector(turn_4);
    settle_o  <= settles(3);
    arrive_o  <= arrivals(3);
    publish_o <= publishes(3);

  end generate g_late;

  -- Programs with DEEP have no variants, so the round is that of the address without it.
  round_o   <= std_ulogic_vector(round);
  sample_o  <= fetch and waiting and not replace_i;
  busy_o    <= hold_i or not waiting;
  done_o    <= done;
  waiting_o <= waiting;
  filling_o <= settle;
  next_o    <= std_ulogic_vector(index);

end architecture rtl;
