//! Damages of the hand-written VHDL: texts that occur once in a file of `hdl/`, and their replacements.

use super::class::Class;
use super::datasheet::{Design, Rules};

/// Designs in which a text has a meaning at all; elsewhere it is in a branch that is not generated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// Everywhere.
    Always,
    /// With the deep pipeline.
    Deep,
    /// With the short one.
    Short,
    /// With products of one block.
    Single,
    /// With products of several.
    Split,
    /// With tables.
    Tables,
    /// With indices that count octaves.
    Octaves,
    /// With several output memories.
    Memories,
    /// With an output memory that a step does not fill.
    Room,
    /// With several words in an output memory.
    Places,
    /// With rings of past words.
    Rings,
}

impl When {
    /// Whether a design is one of these.
    pub fn holds(self, design: &Design) -> bool {
        match self {
            When::Always => true,
            When::Deep => design.deep,
            When::Short => !design.deep,
            When::Single => design.multiplier == 1,
            When::Split => design.multiplier == 3,
            When::Tables => design.pes.iter().any(|pe| pe.features.index_words > 0),
            When::Memories => design.pes.iter().filter(|pe| pe.features.shown_words > 0).count() > 1,
            When::Room => design.pes.iter().any(|pe| (1..pe.features.shown_words as usize).contains(&pe.shown())),
            When::Places => design.pes.iter().any(|pe| pe.features.shown_words > 0 && pe.shown() > 1),
            When::Rings => design.pes.iter().any(|pe| pe.features.ring_bits > 0),
            When::Octaves => design.pes.iter().any(|pe| pe.features.octave_width > 0),
        }
    }
}

/// File below `hdl/`, text, what takes its place.
pub type Replacement = (Class, When, &'static str, &'static str, &'static str);

use Class::*;
use When::*;

/// A damage that is another rule of the datasheet: file, text, what takes its place, and the rule.
pub type Ruled = (&'static str, &'static str, &'static str, fn(&mut Rules));

/// Those of [`REPLACEMENTS`] that are.
pub const RULED: &[Ruled] = &[
    ("pe_sequencer.vhd", "settle_o  <= settles(3);", "settle_o  <= settles(2);", |rules| rules.settled_early = 1),
    (
        "pe.vhd",
        "write_own    <= flag(control_i, LAYOUT.write_own) and not settle;",
        "write_own    <= flag(control_i, LAYOUT.write_own);",
        |rules| rules.waits[0] = false,
    ),
    (
        "pe.vhd",
        "write_base   <= flag(control_i, LAYOUT.write_base) and not settle and base_round;",
        "write_base   <= flag(control_i, LAYOUT.write_base) and base_round;",
        |rules| rules.waits[1] = false,
    ),
    (
        "pe.vhd",
        "flag(control_i, LAYOUT.write_factor) and not settle;",
        "flag(control_i, LAYOUT.write_factor);",
        |rules| rules.waits[2] = false,
    ),
    (
        "pe.vhd",
        "flag(control_i, LAYOUT.receive.enable) and not settle;",
        "flag(control_i, LAYOUT.receive.enable);",
        |rules| rules.waits[3] = false,
    ),
    (
        "pe.vhd",
        "flag(control_i, LAYOUT.write_index) and not settle when",
        "flag(control_i, LAYOUT.write_index) when",
        |rules| rules.waits[4] = false,
    ),
    ("pe.vhd", "and (write_own = '1' or write_base = '1'", "and (write_own = '1'", |rules| rules.flagged[1] = false),
    ("pe.vhd", "if (FLAGGED and too_large = '1' and settle = '0') then", "if (false) then", |rules| {
        rules.sums_flagged = false
    }),
    ("pe.vhd", "base_round <= last when BASE_LAST else", "base_round <= '1' when BASE_LAST else", |rules| {
        rules.last_round = false
    }),
    ("pe_output.vhd", "if (SATURATE and sum(WORD_BITS) /= sum(WORD_BITS - 1)) then", "if (false) then", |rules| {
        rules.outputs_clamp = false
    }),
    ("pe.vhd", "write_plain(BASE_BITS - 1 downto 0)", "write_address(BASE_BITS - 1 downto 0)", |rules| {
        rules.bases_plain = false
    }),
    ("pe_scale.vhd", "read_enable_i   => based,", "read_enable_i   => '1',", |rules| rules.bases_enabled = false),
    (
        "pe.vhd",
        "if (advance = '1') then\n          if (flag(control_i, LAYOUT.send)",
        "if (true) then\n          if (flag(control_i, LAYOUT.send)",
        |rules| rules.links_wait = false,
    ),
];

/// The damages.
pub const REPLACEMENTS: &[Replacement] = &[
    // Memories.
    (
        Address,
        Always,
        "pe_ram.vhd",
        "read_data <= memory(to_integer(unsigned(read_address_i)));",
        "read_data <= memory(to_integer(unsigned(read_address_i)) / 2 * 2);",
    ),
    (
        Address,
        Always,
        "pe_ram.vhd",
        "read_data <= memory(to_integer(unsigned(read_address_i)));",
        "read_data <= memory((to_integer(unsigned(read_address_i)) + 1) mod WORDS);",
    ),
    (
        Address,
        Always,
        "pe_ram.vhd",
        "memory(to_integer(unsigned(write_address_i))) := write_data_i;",
        "memory(to_integer(unsigned(write_address_i)) / 2 * 2) := write_data_i;",
    ),
    (
        Address,
        Always,
        "pe_ram.vhd",
        "memory(to_integer(unsigned(write_address_i))) := write_data_i;",
        "memory((to_integer(unsigned(write_address_i)) + 1) mod WORDS) := write_data_i;",
    ),
    (Register, Always, "pe_ram.vhd", "if (write_enable_i = '1') then", "if (true) then"),
    (Register, Short, "pe_ram.vhd", "read_data <= default_i;", "null;"),
    (Register, Short, "pe_ram.vhd", "if (read_enable_i = '1' or DEEP) then", "if (true) then"),
    (
        ClockEnable,
        Always,
        "pe_ram.vhd",
        "if (ce_i = '1') then\n        if (read_enable_i",
        "if (true) then\n        if (read_enable_i",
    ),
    (Latency, Short, "pe_ram.vhd", "read_data_o <= read_data;", "read_data_o <= read_data when rising_edge(clk_i);"),
    (Register, Deep, "pe_ram.vhd", "enabled <= read_enable_i;", "enabled <= '1';"),
    (Register, Deep, "pe_ram.vhd", "second <= (others => '0');", "second <= second;"),
    (Rounding, Deep, "pe_ram.vhd", "second or default_i;", "second;"),
    (ClockEnable, Deep, "pe_ram.vhd", "if (ce_i = '1') then\n          enabled", "if (true) then\n          enabled"),
    // Program memories.
    (
        Address,
        Always,
        "pe_rom.vhd",
        "fetched <= ROM(to_integer(unsigned(address)));",
        "fetched <= ROM(to_integer(unsigned(address)) / 2 * 2);",
    ),
    (
        Address,
        Always,
        "pe_rom.vhd",
        "fetched <= ROM(to_integer(unsigned(address)));",
        "fetched <= ROM((to_integer(unsigned(address)) + 1) mod DEPTH);",
    ),
    (ClockEnable, Short, "pe_rom.vhd", "if (fetch_i = '1') then", "if (true) then"),
    (Latency, Short, "pe_rom.vhd", "control_o <= fetched;", "control_o <= fetched when rising_edge(clk_i);"),
    (Latency, Deep, "pe_rom.vhd", "control_o <= follower;", "control_o <= fetched;"),
    // Multiplier.
    (Multiplier, Always, "pe_multiplier.vhd", "product_o <= product;", "product_o <= (others => '0');"),
    (Latency, Always, "pe_multiplier.vhd", "product_o <= product;", "product_o <= product when rising_edge(clk_i);"),
    (
        Multiplier,
        Single,
        "pe_multiplier.vhd",
        "whole <= product_of(own + imported, coefficient);",
        "whole <= product_of(shift_left(shift_right(own + imported, 1), 1), coefficient);",
    ),
    (
        Multiplier,
        Single,
        "pe_multiplier.vhd",
        "whole <= product_of(own + imported, coefficient);",
        "whole <= product_of(own + imported, shift_left(shift_right(coefficient, 1), 1));",
    ),
    (
        Multiplier,
        Single,
        "pe_multiplier.vhd",
        "whole <= product_of(own + imported, coefficient);",
        "whole <= product_of(shift_right(shift_left(own + imported, 1), 1), coefficient);",
    ),
    (
        Multiplier,
        Single,
        "pe_multiplier.vhd",
        "whole <= product_of(own + imported, coefficient);",
        "whole <= product_of(own + imported, shift_right(shift_left(coefficient, 1), 1));",
    ),
    (
        ClockEnable,
        Single,
        "pe_multiplier.vhd",
        "if (ce_i = '1') then\n          whole",
        "if (true) then\n          whole",
    ),
    (Multiplier, Split, "pe_multiplier.vhd", "low_low          <= product_of(data_low, coefficient_low);", ""),
    (Multiplier, Split, "pe_multiplier.vhd", "high_high        <= product_of(data_high, coefficient_high);", ""),
    (Multiplier, Split, "pe_multiplier.vhd", "low_high         <= product_of(data_low, coefficient_high);", ""),
    (Multiplier, Split, "pe_multiplier.vhd", "product <= outer + inner;", "product <= outer + shift_left(inner, 1);"),
    (
        Multiplier,
        Split,
        "pe_multiplier.vhd",
        "data_low  := ('0' & own(DATA_SPLIT - 1 downto 0)) + ('0' & imported(DATA_SPLIT - 1 downto 0));",
        "data_low  := ('0' & own(DATA_SPLIT - 1 downto 0));",
    ),
    (
        Multiplier,
        Split,
        "pe_multiplier.vhd",
        "coefficient_low  := '0' & coefficient(COEFFICIENT_SPLIT - 1 downto 0);",
        "coefficient_low  := '0' & coefficient(COEFFICIENT_SPLIT - 1 downto 1) & '0';",
    ),
    // Write side.
    (Saturation, Always, "pe_scale.vhd", "if (SATURATE and differs = '1') then", "if (false) then"),
    (Saturation, Always, "pe_scale.vhd", "CEILING_BITS : positive := 8;", "CEILING_BITS : positive := 7;"),
    (
        Saturation,
        Always,
        "pe_scale.vhd",
        "word(WORD_BITS - 1) <= sum(SUM_BITS - 1);",
        "word(WORD_BITS - 1) <= sum(WORD_BITS);",
    ),
    (Saturation, Always, "pe_scale.vhd", "(others => not sum(SUM_BITS - 1));", "(others => '1');"),
    (Flags, Always, "pe_scale.vhd", "saturated <= differs;", "saturated <= '0';"),
    (
        Rounding,
        Always,
        "pe_scale.vhd",
        "resize(signed(base & '0'), SUM_BITS) - not extended;",
        "resize(signed(base & '0'), SUM_BITS) + extended;",
    ),
    (
        Rounding,
        Always,
        "pe_scale.vhd",
        "'1' when i = WORD_BITS - DATA_BITS - 1 else",
        "'1' when i = WORD_BITS - DATA_BITS else",
    ),
    (Shifts, Always, "pe_scale.vhd", "position <= index;", "position <= index xor to_unsigned(1, index'length);"),
    (Shifts, Always, "pe_scale.vhd", "          use_mid <= '1';", "          use_mid <= '0';"),
    (Shifts, Always, "pe_scale.vhd", "          use_high <= '1';", "          use_high <= '0';"),
    (Latency, Always, "pe_scale.vhd", "word_o      <= word;", "word_o      <= word when rising_edge(clk_i);"),
    (Latency, Deep, "pe_scale.vhd", "addend <= shifted_sum;", "addend <= increment;"),
    (
        ClockEnable,
        Always,
        "pe_scale.vhd",
        "if (advance_i = '1') then\n        differs := '0';",
        "if (true) then\n        differs := '0';",
    ),
    (
        ClockEnable,
        Always,
        "pe_scale.vhd",
        "if (advance_i = '1') then\n        extended",
        "if (true) then\n        extended",
    ),
    (
        ClockEnable,
        Always,
        "pe_scale.vhd",
        "if (advance_i = '1') then\n        index    :=",
        "if (true) then\n        index    :=",
    ),
    (Register, Always, "pe_scale.vhd", "read_enable_i   => based,", "read_enable_i   => '1',"),
    (
        Lookup,
        Tables,
        "pe_scale.vhd",
        "or std_ulogic_vector(resize(unsigned(index), BASE_BITS));",
        "or (BASE_BITS - 1 downto 0 => '0');",
    ),
    (Lookup, Tables, "pe_scale.vhd", "write_enable_i  => write_index_i,", "write_enable_i  => '0',"),
    (
        Shifts,
        Always,
        "pe_write_pkg.vhd",
        "entries(entry * width + i) := value(value'high);",
        "entries(entry * width + i) := '0';",
    ),
    (Lookup, Tables, "pe_write_pkg.vhd", "index(index_width - 1) := not index(index_width - 1);", ""),
    (Lookup, Octaves, "pe_write_pkg.vhd", "if ((and octave) = '0') then", "if (true) then"),
    (Lookup, Octaves, "pe_write_pkg.vhd", "(rest'range => not word(word'high))", "(rest'range => '1')"),
    (Lookup, Octaves, "pe_write_pkg.vhd", "octave(i) := empty;", "octave(i) := not empty;"),
    (Lookup, Octaves, "pe_index.vhd", "when octave_i = '1' else", "when octave_i = '0' else"),
    (Lookup, Tables, "pe_index.vhd", "read_enable_i   => read_enable_i,", "read_enable_i   => '1',"),
    (ImageIndex, Tables, "pe_index.vhd", ":= (others => (others => '0'));", ":= (others => (others => '1'));"),
    // Processing element.
    (Register, Always, "pe.vhd", "          kept := (others => '0');", "          kept := accumulator;"),
    (Register, Always, "pe.vhd", "hold_i          => hold,", "hold_i          => accumulator,"),
    (Register, Always, "pe.vhd", "hold <= accumulator;", "hold <= kept;"),
    (
        Register,
        Always,
        "pe.vhd",
        "link_o     <= link;",
        "link_o     <= word(WORD_BITS - 1 downto WORD_BITS - DATA_BITS);",
    ),
    (Latency, Always, "pe.vhd", "link_o     <= link;", "link_o     <= link when rising_edge(clk_i);"),
    (
        Settle,
        Always,
        "pe.vhd",
        "write_own    <= flag(control_i, LAYOUT.write_own) and not settle;",
        "write_own    <= flag(control_i, LAYOUT.write_own);",
    ),
    (
        Settle,
        Always,
        "pe.vhd",
        "write_base   <= flag(control_i, LAYOUT.write_base) and not settle and base_round;",
        "write_base   <= flag(control_i, LAYOUT.write_base) and base_round;",
    ),
    (
        Settle,
        Always,
        "pe.vhd",
        "flag(control_i, LAYOUT.receive.enable) and not settle;",
        "flag(control_i, LAYOUT.receive.enable);",
    ),
    (
        Settle,
        Always,
        "pe.vhd",
        "flag(control_i, LAYOUT.write_factor) and not settle;",
        "flag(control_i, LAYOUT.write_factor);",
    ),
    (
        Settle,
        Tables,
        "pe.vhd",
        "flag(control_i, LAYOUT.write_index) and not settle when",
        "flag(control_i, LAYOUT.write_index) when",
    ),
    (Parity, Always, "pe.vhd", "base_round <= last when BASE_LAST else", "base_round <= '1' when BASE_LAST else"),
    (
        Parity,
        Always,
        "pe.vhd",
        "xor (flag(control_i, LAYOUT.write.swap) and parity);",
        "xor (flag(control_i, LAYOUT.write.swap) and '0');",
    ),
    (Parity, Always, "pe.vhd", "write_plain(BASE_BITS - 1 downto 0)", "write_address(BASE_BITS - 1 downto 0)"),
    (
        Parity,
        Always,
        "pe.vhd",
        "steered(control_i, LAYOUT.imported, IMPORTED_BITS, parity)",
        "steered(control_i, LAYOUT.imported, IMPORTED_BITS, '0')",
    ),
    (
        Parity,
        Always,
        "pe.vhd",
        "steered(control_i, LAYOUT.receive, IMPORTED_BITS, parity)",
        "steered(control_i, LAYOUT.receive, IMPORTED_BITS, '1')",
    ),
    (
        Parity,
        Always,
        "pe.vhd",
        "steered(control_i, LAYOUT.own, OWN_BITS, parity)",
        "steered(control_i, LAYOUT.own, OWN_BITS, '0')",
    ),
    (Flags, Always, "pe.vhd", "overflow_o <= overflow;", "overflow_o <= '0';"),
    (Flags, Always, "pe.vhd", "if (FLAGGED and saturated = '1'", "if (FLAGGED and saturated = '0'"),
    (Flags, Always, "pe.vhd", "and (write_own = '1' or write_base = '1'", "and (write_own = '1'"),
    (Flags, Always, "pe.vhd", "if (FLAGGED and too_large = '1' and settle = '0') then", "if (false) then"),
    (
        ClockEnable,
        Always,
        "pe.vhd",
        "if (advance = '1') then\n        -- The feedback",
        "if (true) then\n        -- The feedback",
    ),
    (
        ClockEnable,
        Always,
        "pe.vhd",
        "if (advance = '1') then\n          if (flag(control_i, LAYOUT.send)",
        "if (true) then\n          if (flag(control_i, LAYOUT.send)",
    ),
    (ClockEnable, Short, "pe.vhd", "advance <= advance_i;", "advance <= '1';"),
    (
        Address,
        Always,
        "pe.vhd",
        "write_plain <= bits(control_i, LAYOUT.write.address, WRITE_BITS);",
        "write_plain <= bits(control_i, LAYOUT.write.address, WRITE_BITS) or (WRITE_BITS - 1 downto 1 => '0') & '1';",
    ),
    (
        Links,
        Always,
        "pe.vhd",
        "chosen(ports_i, bits(control_i, LAYOUT.port_index, PORT_BITS), DATA_BITS);",
        "chosen(ports_i, not bits(control_i, LAYOUT.port_index, PORT_BITS), DATA_BITS);",
    ),
    (Address, Always, "pe_pkg.vhd", "place   := place + 1;", "place   := place;"),
    (PauseWord, Short, "pe_pkg.vhd", "return latency + 6;", "return latency + 7;"),
    (PauseWord, Short, "pe_pkg.vhd", "return latency + 6;", "return latency + 5;"),
    (PauseWord, Deep, "pe_pkg.vhd", "return latency + 9;", "return latency + 10;"),
    (PauseWord, Deep, "pe_pkg.vhd", "return latency + 9;", "return latency + 8;"),
    // Sequencer.
    (StepHandshake, Always, "pe_sequencer.vhd", "fetch <= ce_i and (step_i or not waiting);", "fetch <= ce_i;"),
    (
        StepHandshake,
        Always,
        "pe_sequencer.vhd",
        "fetch <= ce_i and (step_i or not waiting);",
        "fetch <= ce_i and step_i;",
    ),
    (
        StepHandshake,
        Always,
        "pe_sequencer.vhd",
        "sample_o  <= fetch and waiting and not replace_i;",
        "sample_o <= fetch and not waiting;",
    ),
    (
        StepHandshake,
        Always,
        "pe_sequencer.vhd",
        "sample_o  <= fetch and waiting and not replace_i;",
        "sample_o <= fetch;",
    ),
    (
        ClockEnable,
        Always,
        "pe_sequencer.vhd",
        "fetch <= ce_i and (step_i or not waiting);",
        "fetch <= step_i or not waiting;",
    ),
    (ClockEnable, Short, "pe_sequencer.vhd", "advance_o <= fetch and valid;", "advance_o <= valid;"),
    (Settle, Short, "pe_sequencer.vhd", "advance_o <= fetch and valid;", "advance_o <= fetch;"),
    (Settle, Always, "pe_sequencer.vhd", ":= '1';\n  signal parity", ":= '0';\n  signal parity"),
    (Settle, Always, "pe_sequencer.vhd", "settle  <= '0';", "settle  <= '1';"),
    (PauseWord, Always, "pe_sequencer.vhd", "waiting <= '1';", "waiting <= '0';"),
    (
        PauseWord,
        Always,
        "pe_sequencer.vhd",
        "if (address = PERIOD - 1) then\n          address",
        "if (address = PERIOD - 2) then\n          address",
    ),
    (Parity, Always, "pe_sequencer.vhd", "if (place = 0 and valid = '1') then", "if (place = 0) then"),
    (Parity, Always, "pe_sequencer.vhd", "parity <= not parity;", "parity <= parity;"),
    (Address, Rings, "pe_sequencer.vhd", "turn <= turn + 1;", "turn <= turn;"),
    (
        Address,
        Rings,
        "pe_sequencer.vhd",
        "if (RING_BITS > 0 and address = 0 and valid = '1') then",
        "if (RING_BITS > 0 and address = 0) then",
    ),
    (
        Address,
        Rings,
        "pe.vhd",
        "turned(write_steered, flag(control_i, LAYOUT.write.ring), turn_i, OWN_RING_BITS)",
        "turned(write_steered, '0', turn_i, OWN_RING_BITS)",
    ),
    (Address, Rings, "pe_write_pkg.vhd", ":= turn and (turn'range => ring);", ":= turn;"),
    (
        Parity,
        Always,
        "pe_sequencer.vhd",
        "if (address >= PERIOD - ROUND_WORDS) then",
        "if (address > PERIOD - ROUND_WORDS + PAUSE_WORD) then",
    ),
    (Done, Always, "pe_sequencer.vhd", "publish <= fetch and not settle and not replace_i;", "publish <= fetch;"),
    (Done, Always, "pe_sequencer.vhd", "publish <= fetch and not settle and not replace_i;", "publish <= not settle;"),
    (
        Done,
        Short,
        "pe_sequencer.vhd",
        "if (ce_i = '1') then\n          done <= publish;",
        "if (true) then\n          done <= publish;",
    ),
    (
        Done,
        Deep,
        "pe_sequencer.vhd",
        "if (ce_i = '1') then\n          done <= '0';",
        "if (true) then\n          done <= '0';",
    ),
    (Done, Always, "pe_sequencer.vhd", "done_o    <= done;", "done_o   <= '0';"),
    (Done, Always, "pe_sequencer.vhd", "done_o    <= done;", "done_o   <= publish;"),
    (Busy, Always, "pe_sequencer.vhd", "busy_o    <= hold_i or not waiting;", "busy_o   <= '1';"),
    (Busy, Always, "pe_sequencer.vhd", "busy_o    <= hold_i or not waiting;", "busy_o   <= waiting;"),
    // The short pipeline is at the pause point as long as done_o is 1.
    (Busy, Short, "pe_sequencer.vhd", "busy_o    <= hold_i or not waiting;", "busy_o   <= not waiting or done;"),
    (Busy, Deep, "pe_sequencer.vhd", "busy_o    <= hold_i or not waiting;", "busy_o   <= not waiting and not done;"),
    (Latency, Deep, "pe_sequencer.vhd", "advance_o <= advances(3);", "advance_o <= advances(2);"),
    (Latency, Deep, "pe_sequencer.vhd", "settle_o  <= settles(3);", "settle_o  <= settles(2);"),
    (Latency, Deep, "pe_sequencer.vhd", "publish_o <= publishes(3);", "publish_o <= publishes(2);"),
    (Latency, Deep, "pe_sequencer.vhd", "arrive_o  <= arrivals(3);", "arrive_o  <= arrivals(2);"),
    (Latency, Deep, "pe_replica.vhd", "value_o <= value;", "value_o <= value_i;"),
    // Inputs, outputs, ticks.
    (InputClamp, Always, "pe_input.vhd", "if (word(WORD_BITS) /= word(WORD_BITS - 1)) then", "if (false) then"),
    (InputClamp, Always, "pe_input.vhd", "operand  <= most;", "operand  <= not most;"),
    (Flags, Always, "pe_input.vhd", "overflow <= '1';", "overflow <= '0';"),
    (Rounding, Always, "pe_input.vhd", "GUARD_BITS) + half;", "GUARD_BITS);"),
    (StepHandshake, Always, "pe_input.vhd", "if (arrive = '1') then", "if (true) then"),
    (Outputs, Always, "pe_output.vhd", "if (publish = '1') then", "if (false) then"),
    (Outputs, Always, "pe_output.vhd", "if (publish = '1') then", "if (true) then"),
    (
        Outputs,
        Always,
        "pe_output.vhd",
        "advance_i = '1' and unsigned(index_i) = CAPTURE_WORD)",
        "advance_i = '1' and unsigned(index_i) = CAPTURE_WORD + 1)",
    ),
    (Outputs, Always, "pe_output.vhd", "value_o <= value;", "value_o <= captured(WORD_BITS - 1 downto GUARD_BITS);"),
    (
        Rounding,
        Always,
        "pe_output.vhd",
        "resize(signed(captured), WORD_BITS + 1) + round_by;",
        "resize(signed(captured), WORD_BITS + 1);",
    ),
    (
        Saturation,
        Always,
        "pe_output.vhd",
        "if (SATURATE and sum(WORD_BITS) /= sum(WORD_BITS - 1)) then",
        "if (false) then",
    ),
    (Outputs, Places, "pe_output_memory.vhd", "place <= place + 1;", "place <= place + 2;"),
    (Outputs, Always, "pe_output_memory.vhd", "if (write_i = '1') then", "if (true) then"),
    (Outputs, Always, "pe_output_memory.vhd", "write_enable_i  => write_i,", "write_enable_i  => '0',"),
    (Outputs, Room, "pe_output_memory.vhd", "if (publish = '1' or settle = '1') then", "if (settle = '1') then"),
    (Outputs, Always, "pe_output_memory.vhd", "published <= published xor publish;", "published <= published;"),
    (
        Outputs,
        Always,
        "pe_output_memory.vhd",
        "write_address <= not published & std",
        "write_address <= published & std",
    ),
    (Outputs, Memories, "pe_output_memory.vhd", "read_enable_i   => here_i,", "read_enable_i   => '1',"),
    (Outputs, Always, "pe_output_reader.vhd", "here(i) <= '1';", "here(i) <= '0';"),
    (Outputs, Memories, "pe_output_reader.vhd", "if (k < BELOW) then", "if (k < BELOW - 1) then"),
    (Latency, Places, "pe_output_reader.vhd", "place_o   <= place;", "place_o   <= row(PLACE_BITS - 1 downto 0);"),
    (Ticks, Always, "pe_tick.vhd", "if (count = 0) then", "if (count = STEPS - 1) then"),
    (Ticks, Always, "pe_tick.vhd", "if (count = STEPS - 1) then", "if (count + 1 >= STEPS - 1) then"),
    (Ticks, Always, "pe_tick.vhd", "if (load = '1') then", "if (true) then"),
    (
        Ticks,
        Always,
        "pe_tick.vhd",
        "operand_o(i) <= tick when i = ONE_BIT else",
        "operand_o(i) <= tick when i = ONE_BIT - 1 else",
    ),
];
