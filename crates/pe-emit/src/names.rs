//! Names from specs, made safe for identifiers and comments.

use std::collections::BTreeSet;

use pe_ir::program::Program;

use crate::access;

/// Longest identifier made from a name; suffixes for ports and collisions stay within 80 characters.
const LONGEST: usize = 64;

/// Words that must not be the name of a design unit: keywords of VHDL-2008, SystemVerilog and C++, and names that
/// the generated units use from the hand-written library and the standard packages. File names start with the design's,
/// so words that Windows keeps for devices are among them.
const RESERVED: &[&str] = &[
    "abs",
    "access",
    "address_field_t",
    "after",
    "alias",
    "all",
    "always",
    "and",
    "architecture",
    "array",
    "arrive",
    "assert",
    "assign",
    "assume",
    "attribute",
    "auto",
    "aux",
    "begin",
    "bit",
    "bits",
    "block",
    "body",
    "bool",
    "boolean",
    "break",
    "buf",
    "buffer",
    "bus",
    "byte",
    "case",
    "catch",
    "ce",
    "cell",
    "char",
    "character",
    "chosen",
    "class",
    "clk",
    "coefficient_bits",
    "component",
    "con",
    "config",
    "configuration",
    "const",
    "constant",
    "constraint",
    "context",
    "continue",
    "control_layout",
    "cover",
    "data_bits",
    "deassign",
    "deep",
    "default",
    "delete",
    "design",
    "disable",
    "disconnect",
    "do",
    "double",
    "downto",
    "edge",
    "else",
    "elsif",
    "end",
    "entity",
    "enum",
    "env",
    "event",
    "exit",
    "explicit",
    "export",
    "extern",
    "fairness",
    "false",
    "field_t",
    "file",
    "final",
    "finish",
    "flag",
    "float",
    "for",
    "force",
    "fork",
    "friend",
    "function",
    "generate",
    "generic",
    "goto",
    "group",
    "guarded",
    "hex",
    "ieee",
    "if",
    "import",
    "impure",
    "in",
    "index_bits",
    "inertial",
    "initial",
    "inline",
    "inout",
    "input",
    "int",
    "integer",
    "interface",
    "is",
    "join",
    "label",
    "larger",
    "layout_t",
    "library",
    "line",
    "linkage",
    "literal",
    "load",
    "local",
    "logic",
    "long",
    "loop",
    "main",
    "map",
    "mod",
    "module",
    "multiplier_latency",
    "namespace",
    "nand",
    "natural",
    "natural_array_t",
    "negedge",
    "network",
    "new",
    "next",
    "nmos",
    "nor",
    "not",
    "nul",
    "null",
    "numeric_std",
    "of",
    "on",
    "open",
    "operator",
    "or",
    "others",
    "out",
    "output",
    "output_address_bits",
    "output_latency",
    "output_places",
    "package",
    "parameter",
    "pause_word",
    "pe",
    "pe_access",
    "pe_coefficient",
    "pe_index",
    "pe_input",
    "pe_lib",
    "pe_multiplier",
    "pe_output",
    "pe_output_memory",
    "pe_output_reader",
    "pe_pkg",
    "pe_ram",
    "pe_replica",
    "pe_rom",
    "pe_scale",
    "pe_sequencer",
    "pe_style_pkg",
    "pe_tick",
    "pe_trace_pkg",
    "pe_write_pkg",
    "period",
    "port",
    "posedge",
    "positive",
    "postponed",
    "print",
    "print_overflow",
    "print_trace",
    "priority",
    "private",
    "prn",
    "procedure",
    "process",
    "program",
    "property",
    "protected",
    "public",
    "pull0",
    "pull1",
    "pure",
    "rand",
    "range",
    "real",
    "record",
    "reg",
    "register",
    "reject",
    "release",
    "rem",
    "repeat",
    "report",
    "restrict",
    "return",
    "rising_edge",
    "rol",
    "ror",
    "scalared",
    "select",
    "sequence",
    "severity",
    "shared",
    "short",
    "signal",
    "signed",
    "sla",
    "sll",
    "small",
    "smallest",
    "sra",
    "srl",
    "state_address_bits",
    "state_order",
    "state_place_bits",
    "static",
    "std",
    "std_logic_1164",
    "std_ulogic",
    "std_ulogic_vector",
    "steered",
    "step",
    "storage_bits",
    "string",
    "strong",
    "struct",
    "subtype",
    "supply0",
    "supply1",
    "switch",
    "table",
    "task",
    "template",
    "textio",
    "then",
    "this",
    "throw",
    "time",
    "to",
    "trace",
    "trace_address_bits",
    "trace_bits",
    "trace_imported_address",
    "trace_imported_value",
    "trace_imported_write",
    "trace_overflow",
    "trace_own_address",
    "trace_own_value",
    "trace_own_write",
    "trace_value_bits",
    "trace_width",
    "transport",
    "tri",
    "true",
    "try",
    "type",
    "typedef",
    "unaffected",
    "union",
    "units",
    "unsigned",
    "until",
    "use",
    "variable",
    "vector",
    "virtual",
    "vmode",
    "void",
    "volatile",
    "vprop",
    "vunit",
    "wait",
    "weak",
    "when",
    "while",
    "wire",
    "with",
    "word_array_t",
    "word_bits",
    "work",
    "xnor",
    "xor",
];

/// A VHDL identifier for a name of a spec.
///
/// Letters become lower case; every run of characters other than ASCII letters and digits becomes one underscore,
/// none at the ends; `v` goes before a leading digit; nothing left gives `unnamed`; at most 64 characters are kept;
/// a reserved word gets the suffix `_x`. Different names may give the same identifier: [`Names`] then numbers them.
pub fn vhdl_identifier(name: &str) -> String {
    let mut identifier = String::new();
    for character in name.chars() {
        if character.is_ascii_alphanumeric() {
            identifier.push(character.to_ascii_lowercase());
        } else if !identifier.is_empty() && !identifier.ends_with('_') {
            identifier.push('_');
        }
    }
    if identifier.starts_with(|first: char| first.is_ascii_digit()) {
        identifier.insert(0, 'v');
    }
    identifier.truncate(LONGEST);
    let identifier = identifier.trim_end_matches('_');
    if identifier.is_empty() {
        "unnamed".to_owned()
    } else if RESERVED.contains(&identifier) {
        format!("{identifier}_x")
    } else {
        identifier.to_owned()
    }
}

/// A text that can stand in a line comment of VHDL, Rust and C++: printable ASCII without backslashes, on one line.
pub fn comment_text(text: &str) -> String {
    let printable = |character: char| match character {
        '\\' => '/',
        ' '..='~' => character,
        character if character.is_control() || character.is_whitespace() => ' ',
        _ => '?',
    };
    let mut safe: String = text.chars().map(printable).take(200).collect();
    safe.truncate(safe.trim_end().len());
    // Some tools take pragmas out of comments; a name must not be one.
    for pragma in ["synthesis", "pragma", "synopsys", "verilator", "vhdl_comp_off"] {
        if safe.to_ascii_lowercase().contains(pragma) && safe.contains(' ') {
            safe = safe.replace(' ', "_");
        }
    }
    safe
}

/// Ports that read outputs in memories: the number of an output, and its word.
pub(crate) const READER: [&str; 2] = ["output_address_i", "output_o"];

/// Identifiers of a design.
pub struct Names {
    /// Design unit and start of all file names.
    pub model: String,
    /// Ports of the external inputs, `_i` included.
    pub inputs: Vec<String>,
    /// Ports of the outputs, `_o` included; none if outputs are in memories.
    pub outputs: Vec<String>,
}

impl Names {
    /// Chooses identifiers; colliding ones get `_2`, `_3` and so on before the port suffix.
    pub fn new(program: &Program) -> Names {
        let ports = ["clk_i", "ce_i", "step_i", "busy_o", "done_o", "overflow_o", "trace_o"];
        let for_host = access::port_names(program);
        let reader = program.output_memory().is_some().then_some(READER);
        let ports = ports.into_iter().chain(reader.into_iter().flatten()).map(str::to_owned);
        let mut used: BTreeSet<String> = ports.chain(for_host).collect();
        let mut unique = |name: &str, suffix: &str| {
            let base = vhdl_identifier(name);
            let mut number = 1;
            loop {
                let candidate =
                    if number == 1 { format!("{base}{suffix}") } else { format!("{base}_{number}{suffix}") };
                if used.insert(candidate.clone()) {
                    return candidate;
                }
                number += 1;
            }
        };
        Names {
            model: vhdl_identifier(&program.model),
            inputs: program.ports().map(|port| unique(&port.name, "_i")).collect(),
            outputs: match reader {
                Some(_) => Vec::new(),
                None => program.outputs.iter().map(|port| unique(&port.name, "_o")).collect(),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_legal() {
        for (name, identifier) in [
            ("V[1,2]", "v_1_2"),
            ("_x__y_", "x_y"),
            ("Signal", "signal_x"),
            ("3d", "v3d"),
            ("", "unnamed"),
            ("[]", "unnamed"),
            ("pe", "pe_x"),
            ("a\nb--", "a_b"),
            ("\u{3b1}", "unnamed"),
        ] {
            assert_eq!(vhdl_identifier(name), identifier, "{name:?}");
        }
        assert!(vhdl_identifier(&"x_".repeat(200)).len() <= LONGEST);
    }

    #[test]
    fn comments_stay_on_their_line() {
        assert_eq!(comment_text("a\nend; -- */ \"# \\"), "a end; -- */ \"# /");
        assert_eq!(comment_text("x\u{2028}\u{b5}\r"), "x ?");
        assert_eq!(comment_text("synthesis translate_off"), "synthesis_translate_off");
    }

    #[test]
    fn the_word_list_is_sorted() {
        assert!(RESERVED.is_sorted());
    }
}
