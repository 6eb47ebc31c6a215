-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Addresses and bits of the registers, from docs/wrapper.md, and what registers and synchronizer tell each other.

package pe_register_pkg is

  -- Registers

  constant REGISTER_COUNT   : natural                        := 33;
  constant REGISTER_VERSION : natural                        := 1;
  constant ID_WORD          : std_ulogic_vector(31 downto 0) := x"50455348";
  constant READ_REGISTERS   : std_ulogic_vector(0 to 32)     := b"111111110111111111111111111111111";
  constant WRITE_REGISTERS  : std_ulogic_vector(0 to 32)     := b"000000001111110000000000100011100";
  constant FOREIGN_WRITES   : std_ulogic_vector(0 to 32)     := b"000000010000000000000000000000000";
  constant STATES_REGISTERS : std_ulogic_vector(0 to 32)     := b"000000000000000000000000000011100";
  constant FLAGS_REGISTERS  : std_ulogic_vector(0 to 32)     := b"000000000000000000000001000000000";

  -- Windows: the upper two bits of an address
  constant REGISTER_WINDOW  : natural := 0;
  constant PARAMETER_WINDOW : natural := 1;
  constant INPUT_WINDOW     : natural := 2;
  constant OUTPUT_WINDOW    : natural := 3;

  -- Registers: words from the beginning of their window
  constant ID_REGISTER               : natural := 0;
  constant VERSION_REGISTER          : natural := 1;
  constant HASH_0_REGISTER           : natural := 2;
  constant HASH_1_REGISTER           : natural := 3;
  constant HASH_2_REGISTER           : natural := 4;
  constant HASH_3_REGISTER           : natural := 5;
  constant CAPS_REGISTER             : natural := 6;
  constant STEP_CLOCKS_REGISTER      : natural := 7;
  constant COMMAND_REGISTER          : natural := 8;
  constant STATUS_REGISTER           : natural := 9;
  constant MODE_REGISTER             : natural := 10;
  constant RUN_STEPS_REGISTER        : natural := 11;
  constant CLOCK_BUDGET_REGISTER     : natural := 12;
  constant PACE_PERIOD_REGISTER      : natural := 13;
  constant STEP_COUNT_LOW_REGISTER   : natural := 14;
  constant STEP_COUNT_HIGH_REGISTER  : natural := 15;
  constant CLOCK_COUNT_LOW_REGISTER  : natural := 16;
  constant CLOCK_COUNT_HIGH_REGISTER : natural := 17;
  constant CLOCKS_LAST_REGISTER      : natural := 18;
  constant CLOCKS_MAX_REGISTER       : natural := 19;
  constant CLOCKS_MIN_REGISTER       : natural := 20;
  constant SLACK_MIN_REGISTER        : natural := 21;
  constant OVERRUNS_REGISTER         : natural := 22;
  constant SATURATED_STEPS_REGISTER  : natural := 23;
  constant SINGLE_CLOCKS_REGISTER    : natural := 24;
  constant INPUT_WORDS_REGISTER      : natural := 25;
  constant OUTPUT_WORDS_REGISTER     : natural := 26;
  constant PARAMETER_WORDS_REGISTER  : natural := 27;
  constant STATE_ADDRESS_REGISTER    : natural := 28;
  constant STATE_LOW_REGISTER        : natural := 29;
  constant STATE_HIGH_REGISTER       : natural := 30;
  constant OUTPUT_STEP_LOW_REGISTER  : natural := 31;
  constant OUTPUT_STEP_HIGH_REGISTER : natural := 32;

  -- Lowest bits of their fields
  constant VERSION_REGISTERS    : natural := 0;
  constant VERSION_MAP          : natural := 16;
  constant CAPS_RESTART         : natural := 0;
  constant CAPS_STATES          : natural := 1;
  constant CAPS_FLAGS           : natural := 2;
  constant CAPS_STREAM          : natural := 3;
  constant CAPS_FOREIGN         : natural := 4;
  constant CAPS_PARAMETERS      : natural := 5;
  constant CAPS_READY           : natural := 6;
  constant CAPS_WINDOW          : natural := 8;
  constant CAPS_STATE_BITS      : natural := 16;
  constant COMMAND_START        : natural := 0;
  constant COMMAND_ABORT        : natural := 1;
  constant COMMAND_INPUTS       : natural := 2;
  constant COMMAND_CLEAR        : natural := 3;
  constant COMMAND_RESTART      : natural := 4;
  constant COMMAND_PARAMETERS   : natural := 5;
  constant STATUS_BUSY          : natural := 0;
  constant STATUS_DONE          : natural := 1;
  constant STATUS_TIME_EXCEEDED : natural := 2;
  constant STATUS_OVERRUN       : natural := 3;
  constant STATUS_ABORTED       : natural := 4;
  constant STATUS_OVERFLOW      : natural := 5;
  constant STATUS_SATURATED     : natural := 6;
  constant STATUS_OPERAND       : natural := 7;
  constant STATUS_INPUT         : natural := 8;
  constant STATUS_OUTPUTS       : natural := 9;
  constant STATUS_UNFINISHED    : natural := 10;
  constant STATUS_CLOCKING      : natural := 11;
  constant STATUS_ACCESS        : natural := 12;
  constant STATUS_STATE_READY   : natural := 13;
  constant STATUS_REPLACING     : natural := 14;
  constant STATUS_FRAME         : natural := 15;
  constant STATUS_TUNING        : natural := 16;
  constant MODE_FREE_RUN        : natural := 0;
  constant MODE_PACE            : natural := 1;
  constant MODE_CONTINUE        : natural := 2;
  constant MODE_HALT            : natural := 3;
  constant MODE_HOLD            : natural := 4;
  constant MODE_ACCESS          : natural := 5;
  constant MODE_STREAM          : natural := 6;

  -- End of registers

  -- Bytes of a window at least
  constant WINDOW_BYTES : positive := 16#400#;

  -- What a host wants of a run. Orders are 1 for one clock.

  type run_order_t is record
    start       : std_ulogic;            -- order: begin a run
    abort       : std_ulogic;            -- order: end it with the step under way
    restart     : std_ulogic;            -- order: bring back the initial state
    give_clocks : std_ulogic;            -- order: let `clocks` enabled clocks pass
    free_run    : std_ulogic;            -- a run has no last step
    pace        : std_ulogic;            -- steps begin `period` clocks apart
    stream      : std_ulogic;            -- steps take their inputs from a stream
    go_on       : std_ulogic;            -- a run goes on after an overrun
    halt        : std_ulogic;            -- no clock is enabled that was not given
    steps       : unsigned(31 downto 0); -- steps of a run
    budget      : unsigned(31 downto 0); -- most enabled clocks of a step; 0 is no limit
    period      : unsigned(31 downto 0); -- clocks from step to step
    clocks      : unsigned(31 downto 0); -- enabled clocks to give
  end record run_order_t;

  -- What has come of it. Events are 1 for one clock.

  type run_state_t is record
    busy       : std_ulogic;            -- a run or a restart is under way
    finished   : std_ulogic;            -- event: a run has ended
    exceeded   : std_ulogic;            -- event: because a step took too long
    aborted    : std_ulogic;            -- event: because the host wanted it
    overrun    : std_ulogic;            -- event: a step was not ready in time
    begins     : std_ulogic;            -- event: a step begins
    done       : std_ulogic;            -- event: a step has ended
    enabled    : std_ulogic;            -- an enabled clock with a step under way
    unfinished : std_ulogic;            -- a step was stopped in the middle
    stepping   : std_ulogic;            -- a step is under way
    streaming  : std_ulogic;            -- steps take their inputs from a stream
    more       : std_ulogic;            -- there are steps to begin
    paced      : std_ulogic;            -- the run is paced
    clocks     : unsigned(31 downto 0); -- given clocks that are left
    latency    : unsigned(31 downto 0); -- at `done`: enabled clocks since the step began
    slack      : signed(33 downto 0);   -- at `done`: clocks by which the step was early
  end record run_state_t;

  -- What counters show

  type counters_t is record
    steps    : unsigned(63 downto 0); -- steps that have ended
    clocks   : unsigned(63 downto 0); -- enabled clocks with a step under way
    last     : unsigned(31 downto 0); -- enabled clocks of the last step
    longest  : unsigned(31 downto 0); -- of the longest
    shortest : unsigned(31 downto 0); -- of the shortest
    slack    : signed(31 downto 0);   -- least slack
    overruns : unsigned(31 downto 0); -- steps that were not ready in time
    flagged  : unsigned(31 downto 0); -- steps in which a flag rose
  end record counters_t;

  -- A memory's content before it is written.

  function zeros (
    words : positive;
    bits  : positive
  ) return word_array_t;

end package pe_register_pkg;

package body pe_register_pkg is

  function zeros (
    words : positive;
    bits  : positive
  ) return word_array_t is

    variable image : word_array_t(0 to words - 1)(bits - 1 downto 0);

  begin

    image := (others => (others => '0'));
    return image;

  end function zeros;

end package body pe_register_pkg;
