-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_register_pkg.all;

-- Purpose:  The registers of a wrapper, as docs/wrapper.md lists them: decodes accesses and keeps what a host sets.
-- Generics: What the wrapper has is said once, and what it lacks is answered by an error.
-- Timing:   An access is answered in its clock, but for a state whose word is still on its way.

entity pe_registers is
  generic (
    ADDRESS_BITS       : positive;                        -- byte address
    HASH               : std_ulogic_vector(127 downto 0); -- of the design, the first digits in front
    MAP_VERSION        : natural;                         -- of the map
    STEP_CLOCKS        : natural;                         -- clocks of a step, at first
    INPUT_WORDS        : natural;                         -- words in the window of inputs
    OUTPUT_WORDS       : natural;                         -- words in the window of outputs
    PARAMETER_WORDS    : natural;                         -- words in the window of parameters
    RESTART            : boolean;                         -- the network can be restarted
    STATES             : boolean;                         -- states can be read and replaced
    FLAGS              : boolean;                         -- there is a flag per cause
    STREAM             : boolean;                         -- there are streams
    FOREIGN            : boolean;                         -- it is a foreign entity
    TELLS_READY        : boolean;                         -- which tells when a step has ended
    STATE_BITS         : natural;                         -- stored word
    STATE_ADDRESS_BITS : positive                         -- address of a state
  );
  port (
    clk_i           : in    std_ulogic;                                         -- clock
    request_i       : in    std_ulogic;                                         -- an access
    write_i         : in    std_ulogic;                                         -- it writes
    address_i       : in    std_ulogic_vector(ADDRESS_BITS - 1 downto 2);       -- word that it reads or writes
    data_i          : in    std_ulogic_vector(31 downto 0);                     -- data to write
    strobe_i        : in    std_ulogic_vector(3 downto 0);                      -- bytes of it that count
    ready_o         : out   std_ulogic;                                         -- it is done
    data_o          : out   std_ulogic_vector(31 downto 0);                     -- data that was read
    error_o         : out   std_ulogic;                                         -- it cannot be done, and had no effect
    order_o         : out   run_order_t;                                        -- what the host wants of a run
    run_i           : in    run_state_t;                                        -- what has come of it
    counters_i      : in    counters_t;                                         -- counters
    clear_o         : out   std_ulogic;                                         -- counters begin anew
    step_clocks_o   : out   std_ulogic_vector(31 downto 0);                     -- clocks of a step of a foreign entity
    overflow_i      : in    std_ulogic;                                         -- a flag is up
    saturated_i     : in    std_ulogic;                                         -- a word saturated; each time for a clock
    operand_i       : in    std_ulogic;                                         -- an operand was too large
    input_i         : in    std_ulogic;                                         -- an input was too large
    wrong_i         : in    std_ulogic;                                         -- a frame was dropped
    take_o          : out   std_ulogic;                                         -- inputs act from now on
    hold_o          : out   std_ulogic;                                         -- outputs stay
    input_write_o   : out   std_ulogic;                                         -- writes a word of the inputs
    input_data_i    : in    std_ulogic_vector(31 downto 0);                     -- word of the inputs
    is_input_i      : in    std_ulogic;                                         -- there is one
    output_data_i   : in    std_ulogic_vector(31 downto 0);                     -- word of the outputs
    is_output_i     : in    std_ulogic;                                         -- there is one
    all_outputs_i   : in    std_ulogic;                                         -- all of them can be read
    sample_i        : in    std_ulogic_vector(63 downto 0);                     -- step whose outputs these are
    param_write_o   : out   std_ulogic;                                         -- writes a word of the parameters
    param_data_i    : in    std_ulogic_vector(31 downto 0);                     -- word of the parameters
    is_param_i      : in    std_ulogic;                                         -- there is one
    tune_o          : out   std_ulogic;                                         -- parameters act from now on
    tuning_i        : in    std_ulogic;                                         -- they are on their way
    want_o          : out   std_ulogic;                                         -- the host wants states
    state_address_o : out   std_ulogic_vector(STATE_ADDRESS_BITS - 1 downto 0); -- state to read
    state_new_o     : out   std_ulogic;                                         -- another one
    state_give_o    : out   std_ulogic;                                         -- a new word
    state_given_o   : out   std_ulogic_vector(63 downto 0);                     -- it
    state_word_i    : in    std_ulogic_vector(63 downto 0);                     -- word that was read
    state_settled_i : in    std_ulogic;                                         -- it is that of the address
    granted_i       : in    std_ulogic;                                         -- there is access to states
    free_i          : in    std_ulogic;                                         -- a new word can be given
    replacing_i     : in    std_ulogic                                          -- some words were given
  );
end entity pe_registers;

architecture rtl of pe_registers is

  subtype word_t is std_ulogic_vector(31 downto 0);

  type words_t is array (0 to REGISTER_COUNT - 1) of word_t;

  constant NOTHING : word_t := (others => '0');

  -- One bit of a register that is there on a condition.

  function bit_if (
    present : boolean;
    place   : natural
  ) return word_t is

    variable word : word_t;

  begin

    word := (others => '0');

    if (present) then
      word(place) := '1';
    end if;

    return word;

  end function bit_if;

  -- Registers that are there, of some that all wrappers have and some that only others have.

  function present (
    all_have   : std_ulogic_vector(0 to REGISTER_COUNT - 1);
    states_has : std_ulogic_vector(0 to REGISTER_COUNT - 1);
    flags_has  : std_ulogic_vector(0 to REGISTER_COUNT - 1)
  ) return std_ulogic_vector is

    variable mask : std_ulogic_vector(0 to REGISTER_COUNT - 1);

  begin

    mask := all_have;

    if (not STATES) then
      mask := mask and not states_has;
    end if;

    if (not FLAGS) then
      mask := mask and not flags_has;
    end if;

    return mask;

  end function present;

  -- Registers that can be written where everything else is there.

  function writes (
    is_foreign : boolean
  ) return std_ulogic_vector is
  begin

    if (is_foreign) then
      return WRITE_REGISTERS or FOREIGN_WRITES;
    end if;

    return WRITE_REGISTERS;

  end function writes;

  -- A register after a write of some bytes.

  function merged (
    old  : word_t;
    bits : word_t;
    ones : word_t
  ) return word_t is
  begin

    return (old and not bits) or ones;

  end function merged;

  constant READ_HERE  : std_ulogic_vector(0 to REGISTER_COUNT - 1) := present(READ_REGISTERS, STATES_REGISTERS, FLAGS_REGISTERS);
  constant WRITE_HERE : std_ulogic_vector(0 to REGISTER_COUNT - 1) := present(writes(FOREIGN), STATES_REGISTERS, FLAGS_REGISTERS);

  -- Bits that may be written as 1
  constant COMMANDS : word_t := bit_if(true, COMMAND_START) or bit_if(true, COMMAND_ABORT) or bit_if(true, COMMAND_INPUTS)
                                or bit_if(true, COMMAND_CLEAR) or bit_if(RESTART, COMMAND_RESTART)
                                or bit_if(PARAMETER_WORDS > 0, COMMAND_PARAMETERS);
  constant MODES    : word_t := bit_if(true, MODE_FREE_RUN) or bit_if(true, MODE_PACE) or bit_if(true, MODE_CONTINUE)
                                or bit_if(true, MODE_HALT) or bit_if(true, MODE_HOLD) or bit_if(STATES, MODE_ACCESS)
                                or bit_if(STREAM, MODE_STREAM);

  constant CAPS : word_t := bit_if(RESTART, CAPS_RESTART) or bit_if(STATES, CAPS_STATES) or bit_if(FLAGS, CAPS_FLAGS)
                            or bit_if(STREAM, CAPS_STREAM) or bit_if(PARAMETER_WORDS > 0, CAPS_PARAMETERS)
                            or bit_if(FOREIGN, CAPS_FOREIGN) or bit_if(TELLS_READY, CAPS_READY)
                            or std_ulogic_vector(shift_left(to_unsigned(ADDRESS_BITS - 12, 32), CAPS_WINDOW))
                            or std_ulogic_vector(shift_left(to_unsigned(STATE_BITS, 32), CAPS_STATE_BITS));

  -- What a host has set
  signal mode          : word_t := (others => '0');
  signal steps         : word_t := (0 => '1', others => '0');
  signal budget        : word_t := (others => '0');
  signal period        : word_t := (others => '0');
  signal run_clocks    : word_t := std_ulogic_vector(to_unsigned(STEP_CLOCKS, 32));
  signal state_address : word_t := (others => '0');
  signal state_high    : word_t := (others => '0');

  -- Upper halves of what was read in part
  signal steps_high  : word_t := (others => '0');
  signal clocks_high : word_t := (others => '0');
  signal sample_high : word_t := (others => '0');

  -- What has happened: bits of `status` that stay
  signal happened : word_t := (others => '0');
  signal events   : word_t;
  signal status   : word_t;

  -- The access
  signal window   : unsigned(1 downto 0);
  signal word     : unsigned(ADDRESS_BITS - 5 downto 0);        -- within its window
  signal chosen   : std_ulogic_vector(0 to REGISTER_COUNT - 1);
  signal bits     : word_t;                                     -- bits that are written
  signal ones     : word_t;                                     -- bits that are written as 1
  signal possible : std_ulogic;
  signal ready    : std_ulogic;
  signal writing  : std_ulogic_vector(0 to REGISTER_COUNT - 1); -- a write that has an effect
  signal reading  : std_ulogic_vector(0 to REGISTER_COUNT - 1); -- a read that is answered
  signal readable : std_ulogic_vector(0 to REGISTER_COUNT - 1);
  signal writable : std_ulogic_vector(0 to REGISTER_COUNT - 1);
  signal command  : word_t;
  signal shown    : words_t;

begin

  g_bits : for i in bits'range generate

    bits(i) <= strobe_i(i / 8);

  end generate g_bits;

  window <= unsigned(address_i(ADDRESS_BITS - 1 downto ADDRESS_BITS - 2));
  word   <= unsigned(address_i(ADDRESS_BITS - 3 downto 2));
  ones   <= data_i and bits;

  -- Bit by bit: GHDL 2.0 writes wide constants as character strings into Verilog.

  g_here : for i in chosen'range generate

    readable(i) <= READ_HERE(i);
    writable(i) <= WRITE_HERE(i);

  end generate g_here;

  g_chosen : for i in chosen'range generate

    chosen(i) <= request_i when window = REGISTER_WINDOW and word = i else
                 '0';

  end generate g_chosen;

  -- Whether what is asked can be done now.
  p_possible : process (all) is
  begin

    possible <= '0';

    if (window = INPUT_WINDOW) then
      possible <= is_input_i;
    elsif (window = OUTPUT_WINDOW) then
      possible <= is_output_i and not write_i;
    elsif (window = PARAMETER_WINDOW) then
      possible <= is_param_i and not (write_i and tuning_i);
    elsif (write_i = '1') then
      possible <= or (chosen and writable);

      if (chosen(COMMAND_REGISTER) = '1') then
        if ((ones and not COMMANDS) /= NOTHING) then
          possible <= '0';
        elsif (ones(COMMAND_START) = '1') then
          possible <= not (run_i.busy or mode(MODE_ACCESS) or replacing_i or ones(COMMAND_RESTART)
                           or ones(COMMAND_ABORT));

          if (mode(MODE_PACE) = '1' and period = NOTHING) then
            possible <= '0';
          end if;
        elsif (ones(COMMAND_INPUTS) = '1') then
          possible <= not run_i.streaming;
        end if;

        if (ones(COMMAND_PARAMETERS) = '1'
            and (tuning_i = '1' or mode(MODE_ACCESS) = '1' or replacing_i = '1' or ones(COMMAND_RESTART) = '1')) then
          possible <= '0';
        end if;
      elsif (chosen(MODE_REGISTER) = '1' and (ones and not MODES) /= NOTHING) then
        possible <= '0';
      elsif (chosen(SINGLE_CLOCKS_REGISTER) = '1' and mode(MODE_HALT) = '0') then
        possible <= '0';
      elsif (chosen(STEP_CLOCKS_REGISTER) = '1' and not TELLS_READY and merged(run_clocks, bits, ones) = NOTHING) then
        possible <= '0';
      elsif (chosen(STATE_LOW_REGISTER) = '1' and free_i = '0') then
        possible <= '0';
      end if;
    else
      possible <= or (chosen and readable);

      if ((chosen(STATE_LOW_REGISTER) = '1' or chosen(STATE_HIGH_REGISTER) = '1') and granted_i = '0') then
        possible <= '0';
      end if;
    end if;

  end process p_possible;

  -- A state that can be read but has not come yet.
  ready <= request_i when state_settled_i = '1' or possible = '0' or write_i = '1' else
           request_i and not (chosen(STATE_LOW_REGISTER) or chosen(STATE_HIGH_REGISTER));

  writing <= chosen when possible = '1' and write_i = '1' else
             (others => '0');
  reading <= chosen when possible = '1' and write_i = '0' and ready = '1' else
             (others => '0');
  command <= ones when writing(COMMAND_REGISTER) = '1' else
             (others => '0');

  p_set : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (writing(MODE_REGISTER) = '1') then
        mode <= merged(mode, bits, ones);
      end if;

      if (writing(RUN_STEPS_REGISTER) = '1') then
        steps <= merged(steps, bits, ones);
      end if;

      if (writing(CLOCK_BUDGET_REGISTER) = '1') then
        budget <= merged(budget, bits, ones);
      end if;

      if (writing(PACE_PERIOD_REGISTER) = '1') then
        period <= merged(period, bits, ones);
      end if;

      if (FOREIGN and writing(STEP_CLOCKS_REGISTER) = '1') then
        run_clocks <= merged(run_clocks, bits, ones);
      end if;

      if (writing(STATE_ADDRESS_REGISTER) = '1') then
        state_address <= merged(state_address, bits, ones);
      end if;

      if (writing(STATE_HIGH_REGISTER) = '1') then
        state_high <= merged(state_high, bits, ones);
      end if;

      if (reading(STEP_COUNT_LOW_REGISTER) = '1') then
        steps_high <= std_ulogic_vector(counters_i.steps(63 downto 32));
      end if;

      if (reading(CLOCK_COUNT_LOW_REGISTER) = '1') then
        clocks_high <= std_ulogic_vector(counters_i.clocks(63 downto 32));
      end if;

      if (reading(OUTPUT_STEP_LOW_REGISTER) = '1') then
        sample_high <= sample_i(63 downto 32);
      end if;

      if (command(COMMAND_RESTART) = '1') then
        mode(MODE_ACCESS) <= '0';
      end if;
    end if;

  end process p_set;

  p_events : process (run_i, wrong_i, saturated_i, operand_i, input_i) is
  begin

    events                       <= (others => '0');
    events(STATUS_DONE)          <= run_i.finished;
    events(STATUS_TIME_EXCEEDED) <= run_i.exceeded;
    events(STATUS_OVERRUN)       <= run_i.overrun;
    events(STATUS_ABORTED)       <= run_i.aborted;
    events(STATUS_FRAME)         <= wrong_i;

    if (FLAGS) then
      events(STATUS_SATURATED) <= saturated_i;
      events(STATUS_OPERAND)   <= operand_i;
      events(STATUS_INPUT)     <= input_i;
    end if;

  end process p_events;

  p_happened : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      happened <= happened or events;

      if (writing(STATUS_REGISTER) = '1') then
        happened <= (happened and not ones) or events;
      end if;
    end if;

  end process p_happened;

  p_status : process (happened, run_i, overflow_i, all_outputs_i, granted_i, free_i, replacing_i, tuning_i) is
  begin

    status                     <= happened;
    status(STATUS_BUSY)        <= run_i.busy;
    status(STATUS_OUTPUTS)     <= all_outputs_i;
    status(STATUS_UNFINISHED)  <= run_i.unfinished;
    status(STATUS_CLOCKING)    <= or run_i.clocks;
    status(STATUS_ACCESS)      <= granted_i;
    status(STATUS_STATE_READY) <= free_i;
    status(STATUS_REPLACING)   <= replacing_i;
    status(STATUS_TUNING)      <= tuning_i;
    status(STATUS_OVERFLOW)    <= overflow_i;

    if (FLAGS) then
      status(STATUS_OVERFLOW) <= happened(STATUS_SATURATED) or happened(STATUS_OPERAND) or happened(STATUS_INPUT);
    end if;

  end process p_status;

  shown(ID_REGISTER)               <= ID_WORD;
  shown(VERSION_REGISTER)          <= std_ulogic_vector(to_unsigned(MAP_VERSION, 16) & to_unsigned(REGISTER_VERSION, 16));
  shown(HASH_0_REGISTER)           <= HASH(127 downto 96);
  shown(HASH_1_REGISTER)           <= HASH(95 downto 64);
  shown(HASH_2_REGISTER)           <= HASH(63 downto 32);
  shown(HASH_3_REGISTER)           <= HASH(31 downto 0);
  shown(CAPS_REGISTER)             <= CAPS;
  shown(STEP_CLOCKS_REGISTER)      <= run_clocks;
  shown(COMMAND_REGISTER)          <= (others => '0');
  shown(STATUS_REGISTER)           <= status;
  shown(MODE_REGISTER)             <= mode;
  shown(RUN_STEPS_REGISTER)        <= steps;
  shown(CLOCK_BUDGET_REGISTER)     <= budget;
  shown(PACE_PERIOD_REGISTER)      <= period;
  shown(STEP_COUNT_LOW_REGISTER)   <= std_ulogic_vector(counters_i.steps(31 downto 0));
  shown(STEP_COUNT_HIGH_REGISTER)  <= steps_high;
  shown(CLOCK_COUNT_LOW_REGISTER)  <= std_ulogic_vector(counters_i.clocks(31 downto 0));
  shown(CLOCK_COUNT_HIGH_REGISTER) <= clocks_high;
  shown(CLOCKS_LAST_REGISTER)      <= std_ulogic_vector(counters_i.last);
  shown(CLOCKS_MAX_REGISTER)       <= std_ulogic_vector(counters_i.longest);
  shown(CLOCKS_MIN_REGISTER)       <= std_ulogic_vector(counters_i.shortest);
  shown(SLACK_MIN_REGISTER)        <= std_ulogic_vector(counters_i.slack);
  shown(OVERRUNS_REGISTER)         <= std_ulogic_vector(counters_i.overruns);
  shown(SATURATED_STEPS_REGISTER)  <= std_ulogic_vector(counters_i.flagged);
  shown(SINGLE_CLOCKS_REGISTER)    <= std_ulogic_vector(run_i.clocks);
  shown(INPUT_WORDS_REGISTER)      <= std_ulogic_vector(to_unsigned(INPUT_WORDS, 32));
  shown(OUTPUT_WORDS_REGISTER)     <= std_ulogic_vector(to_unsigned(OUTPUT_WORDS, 32));
  shown(PARAMETER_WORDS_REGISTER)  <= std_ulogic_vector(to_unsigned(PARAMETER_WORDS, 32));
  shown(STATE_ADDRESS_REGISTER)    <= state_address;
  shown(STATE_LOW_REGISTER)        <= state_word_i(31 downto 0);
  shown(STATE_HIGH_REGISTER)       <= state_word_i(63 downto 32);
  shown(OUTPUT_STEP_LOW_REGISTER)  <= sample_i(31 downto 0);
  shown(OUTPUT_STEP_HIGH_REGISTER) <= sample_high;

  p_data : process (request_i, possible, window, chosen, shown, input_data_i, output_data_i, param_data_i) is

    variable any : word_t;

  begin

    any := (others => '0');

    if (request_i = '1' and possible = '1') then

      for i in chosen'range loop

        if (chosen(i) = '1') then
          any := any or shown(i);
        end if;

      end loop;

      if (window = INPUT_WINDOW) then
        any := input_data_i;
      elsif (window = OUTPUT_WINDOW) then
        any := output_data_i;
      elsif (window = PARAMETER_WINDOW) then
        any := param_data_i;
      end if;
    end if;

    data_o <= any;

  end process p_data;

  ready_o <= ready;
  error_o <= not possible;

  order_o.start       <= command(COMMAND_START);
  order_o.abort       <= command(COMMAND_ABORT);
  order_o.restart     <= command(COMMAND_RESTART);
  order_o.give_clocks <= writing(SINGLE_CLOCKS_REGISTER);
  order_o.free_run    <= mode(MODE_FREE_RUN);
  order_o.pace        <= mode(MODE_PACE);
  order_o.stream      <= mode(MODE_STREAM);
  order_o.go_on       <= mode(MODE_CONTINUE);
  order_o.halt        <= mode(MODE_HALT);
  order_o.steps       <= unsigned(steps);
  order_o.budget      <= unsigned(budget);
  order_o.period      <= unsigned(period);
  order_o.clocks      <= unsigned(merged(std_ulogic_vector(run_i.clocks), bits, ones));

  clear_o         <= command(COMMAND_CLEAR);
  step_clocks_o   <= run_clocks;
  take_o          <= (command(COMMAND_START) and not mode(MODE_STREAM)) or command(COMMAND_INPUTS);
  hold_o          <= mode(MODE_HOLD);
  input_write_o   <= possible and request_i and write_i when window = INPUT_WINDOW else
                     '0';
  param_write_o   <= possible and request_i and write_i when window = PARAMETER_WINDOW else
                     '0';
  tune_o          <= command(COMMAND_PARAMETERS);
  want_o          <= mode(MODE_ACCESS);
  state_address_o <= state_address(state_address_o'range);
  state_new_o     <= writing(STATE_ADDRESS_REGISTER);
  state_give_o    <= writing(STATE_LOW_REGISTER);
  state_given_o   <= state_high & merged(NOTHING, bits, ones);

end architecture rtl;
