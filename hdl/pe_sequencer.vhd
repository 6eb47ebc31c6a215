-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Broadcasts the word index to all PEs and runs the step handshake. The first pass over the words before the pause
-- word only fills the pipelines (settle). A step has one or more rounds of equal length.

entity pe_sequencer is
  generic (
    PERIOD     : positive;        -- control words per step
    ROUNDS     : positive;        -- rounds per step
    PAUSE_WORD : positive;        -- the network waits before it
    DEEP       : boolean := false -- PEs follow three clocks later
  );
  port (
    clk_i     : in    std_ulogic;                                                             -- clock
    ce_i      : in    std_ulogic;                                                             -- clock enable
    step_i    : in    std_ulogic;                                                             -- lets the next step begin
    fetch_o   : out   std_ulogic;                                                             -- reads the programs
    load_o    : out   std_ulogic_vector(2 downto 1);                                          -- loads the registers behind, with DEEP
    address_o : out   std_ulogic_vector(larger(index_bits(PERIOD), 1) - 1 downto 0);          -- control word to load
    repeat_o  : out   std_ulogic_vector(larger(index_bits(PERIOD / ROUNDS), 1) - 1 downto 0); -- the same within a round
    round_o   : out   std_ulogic_vector(larger(index_bits(ROUNDS), 1) - 1 downto 0);          -- round of that word
    advance_o : out   std_ulogic;                                                             -- executes the control words
    index_o   : out   std_ulogic_vector(larger(index_bits(PERIOD), 1) - 1 downto 0);          -- word that is executed
    parity_o  : out   std_ulogic;                                                             -- 1 in odd rounds
    last_o    : out   std_ulogic;                                                             -- writes belong to the last round
    settle_o  : out   std_ulogic;                                                             -- first pass
    sample_o  : out   std_ulogic;                                                             -- inputs load their registers
    arrive_o  : out   std_ulogic;                                                             -- inputs load their operands, with DEEP
    publish_o : out   std_ulogic;                                                             -- outputs load their ports
    busy_o    : out   std_ulogic;                                                             -- not waiting for step_i
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
  signal done    : std_ulogic                                                := '0';
  signal fetch   : std_ulogic;
  signal publish : std_ulogic;

begin

  assert ROUND_WORDS > PAUSE_WORD and ROUND_WORDS * ROUNDS = PERIOD
    report "pe_sequencer: a round needs more than PAUSE_WORD control words, and all rounds as many"
    severity failure;

  fetch <= ce_i and (step_i or not waiting);

  p_publish : process (fetch, settle, address) is
  begin

    publish <= '0';

    if (address = PAUSE_WORD) then
      publish <= fetch and not settle;
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

        -- Writes before this place in a round finish the round before.
        if (place = PAUSE_WORD) then
          last <= '0';

          if (address >= PERIOD - ROUND_WORDS) then
            last <= '1';
          end if;
        end if;
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
    load_o    <= "00";
    arrive_o  <= '0';
    address_o <= std_ulogic_vector(address);
    repeat_o  <= std_ulogic_vector(place);
    advance_o <= fetch and valid;
    index_o   <= std_ulogic_vector(index);
    parity_o  <= parity;
    last_o    <= last;
    settle_o  <= settle;
    publish_o <= publish;

  end generate g_direct;

  -- Addresses have a register on their way to the programs, and control words two on theirs to the PEs. All stand
  -- still without ce_i, so PEs and outputs see the same three enabled clocks later.

  g_late : if DEEP generate

    signal fetches        : std_ulogic_vector(3 downto 1)                              := (others => '0');
    signal advances       : std_ulogic_vector(3 downto 1)                              := (others => '0');
    signal parities       : std_ulogic_vector(3 downto 1)                              := (others => '0');
    signal lasts          : std_ulogic_vector(3 downto 1)                              := (others => '0');
    signal settles        : std_ulogic_vector(3 downto 1)                              := (others => '1');
    signal arrivals       : std_ulogic_vector(3 downto 1)                              := (others => '0');
    signal publishes      : std_ulogic_vector(3 downto 1)                              := (others => '0');
    signal address_late   : unsigned(address'range)                                    := (others => '0');
    signal place_late     : unsigned(place'range)                                      := (others => '0');
    signal index_read     : unsigned(index'range)                                      := (others => '0');
    signal index_loaded   : unsigned(index'range)                                      := (others => '0');
    signal index_executed : unsigned(index'range)                                      := (others => '0');

  begin

    p_late : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (ce_i = '1') then
          fetches        <= fetches(2 downto 1) & fetch;
          advances       <= advances(2 downto 1) & (fetch and valid);
          parities       <= parities(2 downto 1) & parity;
          lasts          <= lasts(2 downto 1) & last;
          settles        <= settles(2 downto 1) & settle;
          arrivals       <= arrivals(2 downto 1) & (fetch and waiting);
          publishes      <= publishes(2 downto 1) & publish;
          address_late   <= address;
          place_late     <= place;
          index_read     <= index;
          index_loaded   <= index_read;
          index_executed <= index_loaded;
          done           <= publishes(3);
        end if;
      end if;

    end process p_late;

    fetch_o   <= fetches(1) and ce_i;
    load_o(1) <= fetches(2) and ce_i;
    load_o(2) <= fetches(3) and ce_i;
    address_o <= std_ulogic_vector(address_late);
    repeat_o  <= std_ulogic_vector(place_late);
    advance_o <= advances(3) and ce_i;
    index_o   <= std_ulogic_vector(index_executed);
    parity_o  <= parities(3);
    last_o    <= lasts(3);
    settle_o  <= settles(3);
    arrive_o  <= arrivals(3) and ce_i;
    publish_o <= publishes(3) and ce_i;

  end generate g_late;

  -- Programs behind more registers have no variants, so the round is that of the address without them.
  round_o  <= std_ulogic_vector(round);
  sample_o <= fetch and waiting;
  busy_o   <= not waiting;
  done_o   <= done;

end architecture rtl;
