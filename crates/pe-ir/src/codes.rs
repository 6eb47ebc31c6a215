//! The diagnostic codes of all compiler stages, in one table, and their long explanations.

/// The reference with one section per code, embedded so that the program can print it.
const REFERENCE: &str = include_str!("diagnostics.md");

/// A code and what it stands for in a few words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    /// `E0xxx` or `W0xxx`.
    pub code: &'static str,
    /// Title of its section in `docs/diagnostics.md`.
    pub title: &'static str,
}

/// Declares each code once: a constant for the code that reports it, and a row of the table.
macro_rules! codes {
    ($($name:ident = $code:literal, $title:literal;)*) => {
        $(#[doc = $title] pub const $name: &str = $code;)*

        /// All codes in ascending order, errors before warnings.
        pub const CODES: &[Code] = &[$(Code { code: $code, title: $title },)*];
    };
}

codes! {
    SYNTAX = "E0101", "syntax error";
    BAD_CHARACTER = "E0102", "unexpected character";
    BRACKETS = "E0103", "bracket or text not closed";
    TOO_DEEP = "E0104", "nested too deeply";
    FILE_TOO_LARGE = "E0105", "file too large";
    KEYWORD_AS_NAME = "E0106", "keyword used as a name";
    BAD_LITERAL = "E0107", "number or name too large";
    TOO_MANY_ERRORS = "E0108", "too many errors";
    NOT_TEXT = "E0109", "file is not text";
    BAD_PATH = "E0110", "path not allowed";
    NO_FILE = "E0111", "file cannot be read";
    INCLUDE_CYCLE = "E0112", "files include each other";
    MISPLACED = "E0113", "statement belongs in the main file";
    BAD_BLOCK = "E0114", "block not well formed";
    SIGNAL_PLACE = "E0115", "signal out of place";
    SIGNAL_TOO_LONG = "E0116", "samples that fit no table";
    SIGNAL_IN_LIST = "E0117", "played signal with a list of steps";
    SIGNAL_DRIFTS = "E0118", "period that drifts against the steps";

    UNKNOWN_NAME = "E0201", "unknown name";
    UNKNOWN_FUNCTION = "E0202", "unknown function or waveform";
    DUPLICATE = "E0203", "defined twice";
    UNKNOWN_UNIT = "E0204", "unknown or unsuitable unit";
    UNKNOWN_SOLVER = "E0205", "unknown solver";
    UNBOUND_INDEX = "E0206", "index without a value here";
    SUBSCRIPT_COUNT = "E0207", "wrong number of subscripts";
    WRONG_KIND = "E0208", "name cannot be used here";
    OVERRIDE = "E0209", "value from the command line does not fit";
    ANGLE_AS_NUMBER = "E0210", "angle used as a number";
    BAD_COMPONENT = "E0211", "component that does not fit";

    MISSING_SECTION = "E0301", "missing section";
    NO_STATE = "E0302", "no state variable";
    NO_OUTPUT = "E0303", "no output";
    NO_EQUATION = "E0304", "state without equation";
    DEFINED_TWICE = "E0305", "two equations for one element";
    BAD_LEFT_SIDE = "E0306", "left-hand side cannot be defined";
    ALGEBRAIC_LOOP = "E0307", "algebraic loop";
    CIRCULAR_CONSTANT = "E0308", "constant defined by itself";
    RECURSION = "E0309", "function that calls itself";

    ARGUMENT_COUNT = "E0401", "wrong number of arguments";
    NUMBER_OR_CONDITION = "E0402", "number and condition mixed up";
    BAD_POWER = "E0404", "power too large";
    VARIABLE_CONDITION = "E0405", "condition on a variable";
    NOT_CONSTANT = "E0407", "constant expected";
    NOT_INTEGER = "E0408", "integer expected";
    EVENT_TARGET = "E0409", "what an event cannot change";
    EVENT_MODEL = "E0410", "event in a model that cannot have it";
    EVENT_DELAY = "E0412", "delay that is no whole number of steps";
    EVENT_REFINE = "E0413", "event whose time within the step cannot be found";
    UNSUITABLE_MECHANISM = "E0416", "equation that makes no mechanism";
    INCONSISTENT_START = "E0417", "inconsistent initial values";
    NO_MASS = "E0418", "mass matrix not positive";
    NO_DERIVATIVE = "E0419", "no derivative of the closures";
    BAD_DELAY = "E0421", "delay that is no positive constant";
    DELAY_MODEL = "E0422", "delay in a model that cannot have it";

    OUT_OF_RANGE = "E0501", "subscript out of range";
    NO_SUCH_ELEMENT = "E0502", "element without equation";
    NOT_FINITE = "E0503", "value not finite";
    NOT_POSITIVE = "E0504", "step or span not positive";
    BAD_STEP_COUNT = "E0505", "span and step do not fit together";
    BAD_BOUNDS = "E0506", "empty range of values";
    BAD_WAVEFORM = "E0507", "waveform argument out of range";
    BAD_TABLE = "E0508", "data file does not fit";
    BAD_CELL = "E0509", "cell that holds no number";
    BAD_SHAPE = "E0510", "table of another shape";
    SHAPES = "E0511", "shapes do not fit";

    TOO_MANY_ELEMENTS = "E0601", "too many elements";
    TOO_MUCH_WORK = "E0602", "model too large";

    UNIT_ERROR = "E0701", "units do not agree";

    TOO_MANY_PRODUCTS = "E0801", "equation expands to too many products";
    NO_FORMAT = "E0802", "no number format fits";
    ACCUMULATOR = "E0803", "products do not fit the accumulator";
    IN_DEGREE = "E0804", "more input ports than a PE may have";
    UNSUITABLE_FORM = "E0805", "the model has no step of this form";
    UNSUITABLE_SOLVER = "E0806", "the solver does not suit the model";
    UNSUITABLE_PERIOD = "E0807", "period and step do not fit together";
    BAD_MAPPING = "E0808", "mapping file does not fit";
    BAD_STAGE_TEXT = "E0809", "text of a compiler stage cannot be read";
    NOT_SYMMETRIC = "E0820", "matrix not symmetric";
    SINGULAR_MATRIX = "E0821", "matrix singular whatever its numbers";
    NO_PIVOT = "E0822", "matrix without a pivot";
    BAD_SYSTEM = "E0823", "arguments that make no linear system";
    ZERO_PIVOT = "E0824", "pivot of a linear system close to zero";
    OUT_OF_REACH = "E0825", "no design meets the goals";

    DIVERGED = "E0901", "value not finite during the run";
    SATURATED = "E0902", "value saturates however wide its range";
    STEP_TOO_LARGE = "E0903", "step too large";
    OUTSIDE_DOMAIN = "E0904", "function outside its domain";
    SMALL_PIVOT = "E0905", "pivot of the step close to zero";
    SOLUTION_ENDS = "E0906", "solution ends within the span";
    WORD_TOO_SHORT = "E0907", "word too short";
    POLE_MOVED = "E0908", "rounding makes a pole unstable";
    INPUT_UNSEEN = "E0913", "step too large for an input";
    INPUT_ALIASED = "E0914", "input faster than the steps";
    PULSE_MISSED = "E0915", "pulse between two steps";
    TOO_STEEP = "E0916", "function too steep for a table";
    TOO_SMALL = "E0917", "number too small for double precision";
    INDETERMINATE = "E0918", "0/0 of two variables";
    ANGLE_TOO_FAST = "E0919", "angle too fast for the step";
    EVENT_LOST = "E0920", "event that finds no place to wait in";
    PENALTY_SMALL = "E0924", "penalty too small for the step";
    PENALTY_LARGE = "E0925", "penalty too large for the word";
    COMES_APART = "E0926", "mechanism comes apart";
    BRANCH_LEFT = "E0927", "mechanism leaves its branch";
    CONTRADICTION = "E0928", "closures that contradict each other";
    EVENT_ORDER = "E0929", "too many events whose order changes";
    DELAY_STEPS = "E0930", "delay and step do not fit together";
    NO_EVENTS = "E0931", "no events to judge by";
    EVENTS_DIFFER = "E0932", "events come at another rate";

    VHDL_SYNTAX = "E1001", "VHDL that cannot be read";
    NO_ENTITY = "E1002", "no such entity";
    SEVERAL_ENTITIES = "E1003", "entity there more than once";
    ARCHITECTURES = "E1004", "not one architecture";
    NO_CLOCK = "E1005", "no clock";
    NO_CLOCK_ENABLE = "E1006", "no clock enable";
    BAD_MODE = "E1007", "port that is neither input nor output";
    BAD_TYPE = "E1008", "port of another type";
    UNCONSTRAINED = "E1009", "port without a range";
    BAD_WIDTH = "E1010", "width unknown or too large";
    BAD_GENERIC = "E1011", "generic without a value";
    NAME_TAKEN = "E1012", "name that the wrapper has";
    BAD_ENTITY_MAP = "E1013", "map of an entity cannot be read";
    MAP_DIFFERS = "E1014", "map of another entity";
    BAD_ROLE = "E1015", "role that does not suit the port";
    BAD_ENTRY = "E1016", "value that does not suit the port";
    NOTHING_TO_READ = "E1017", "nothing to read";
    VHDL_LIMITS = "E1018", "VHDL file too large or too deep";

    IMPORT_SYNTAX = "E1101", "model file that cannot be read";
    IMPORT_LIMIT = "E1102", "model file too large or too deep";
    IMPORT_UNSUPPORTED = "E1103", "construct that a spec cannot express";
    IMPORT_UNKNOWN = "E1104", "reference to what is not there";
    IMPORT_DUPLICATE = "E1105", "id there or determined twice";
    IMPORT_NO_VALUE = "E1106", "quantity without a value";
    IMPORT_NUMBER = "E1107", "number that is none";
    IMPORT_LOOP = "E1108", "quantity that needs itself";
    IMPORT_MATH = "E1109", "expression that cannot be read";

    UNUSED = "W0001", "name never used";
    LEFT_OUT = "W0002", "no output depends on it";
    OUTSIDE_BOUNDS = "W0003", "value outside the stated range";
    REPEATED_OUTPUT = "W0004", "output asked for twice";
    REPEATED_INCLUDE = "W0005", "file included twice";
    EMPTY_RANGE = "W0006", "empty range";
    COMMENTED_QUOTIENT = "W0007", "comment that looks like a divisor";
    UNIT_MISMATCH = "W0701", "units do not agree";
    UNREAD_UNIT = "W0702", "unknown unit";
    DOES_NOT_FIT = "W0801", "design larger than the device";
    FEWER_PES = "W0802", "fewer PEs than asked for";
    MANY_PORTS = "W0803", "more input ports than usual";
    HOPS = "W0804", "values travel over other PEs";
    STEP_LARGE = "W0903", "step large for the accuracy";
    NO_REFERENCE = "W0904", "no reference solution";
    WORD_SHORT = "W0905", "word short for the accuracy";
    NEAR_LIMIT = "W0906", "step near the limit of stability";
    METHOD_GROWTH = "W0907", "method or coefficients let the solution grow";
    DEAD_BAND = "W0908", "increments below one LSB";
    CHAOTIC = "W0909", "chaotic over this span";
    STEP_SPAN = "W0910", "span is no whole number of steps";
    STILL = "W0911", "no state moves";
    POLE = "W0912", "pole on or near the unit circle";
    INPUT_RANGE = "W0913", "input outside its stated range";
    REFERENCES_DIFFER = "W0914", "reference methods differ";
    RINGING = "W0915", "sampled part does not come to rest";
    INPUT_HELD = "W0920", "held input large for the accuracy";
    INPUT_JUMPS = "W0921", "input jumps within a step";
    INPUT_NEARLY_ALIASED = "W0922", "input faster than the steps";
    SHORT_PULSE_MISSED = "W0923", "pulse between two steps";
    CHATTERING = "W0925", "chattering at a jump";
    LIMIT_TAKEN = "W0926", "limit taken where a function is 0/0";
    QUOTIENT_SHORT = "W0927", "quotient with few bits";
    GUARD_LEFT_OUT = "W0928", "choice against 0/0 left out";
    START_MOVED = "W0932", "initial values moved";
    CLOSURES_OPEN = "W0933", "closures open";
    ROWS_STAY = "W0935", "past words that move on with every step";
    EVENTS_APART = "W0937", "rates of events differ";
    BY_EVENTS = "W0938", "judged by events";
    ROLE_UNKNOWN = "W1001", "role still to be told";
    GENERIC_UNSET = "W1002", "generic still without a value";
    SIGN_DIFFERS = "W1003", "sign other than that of the type";
    NO_RESET = "W1004", "entity without a reset";
    IMPORT_LEFT_OUT = "W1101", "part of a model file left out";
}

/// Groups of codes: the two digits after the letter, and what their codes are about.
pub const GROUPS: &[(&str, &str)] = &[
    ("00", "Warnings about the spec"),
    ("01", "Text and files"),
    ("02", "Names"),
    ("03", "Structure"),
    ("04", "Expressions"),
    ("05", "Values"),
    ("06", "Limits"),
    ("07", "Units"),
    ("08", "Number formats"),
    ("09", "Runs over the span"),
    ("10", "Foreign entities"),
    ("11", "Imported models"),
];

/// Errors that the user may turn into warnings, for their result is only doubtful.
pub const PERMITTABLE: [&str; 8] =
    [STEP_TOO_LARGE, WORD_TOO_SHORT, POLE_MOVED, INPUT_UNSEEN, INPUT_ALIASED, PULSE_MISSED, BRANCH_LEFT, EVENTS_DIFFER];

/// The long explanation of a code: its section of `docs/diagnostics.md`, heading included. Case does not matter.
pub fn explain(code: &str) -> Option<&'static str> {
    let known = CODES.iter().find(|known| known.code.eq_ignore_ascii_case(code))?;
    let start = sections().find(|(_, title)| title.starts_with(known.code))?.0;
    let body = &REFERENCE[start..];
    let end = body[2..].find("\n## ").map_or(body.len(), |at| at + 2);
    Some(body[..end].trim_end())
}

/// Byte offset and title of each section of the reference.
fn sections() -> impl Iterator<Item = (usize, &'static str)> {
    REFERENCE.match_indices("\n## ").map(|(at, mark)| {
        let title = REFERENCE[at + mark.len()..].lines().next().unwrap_or("");
        (at + 1, title)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_has_a_section_and_every_section_a_code() {
        let documented: Vec<String> = sections().map(|(_, title)| title.to_owned()).collect();
        let declared: Vec<String> = CODES.iter().map(|code| format!("{}: {}", code.code, code.title)).collect();
        assert_eq!(documented, declared);
    }

    #[test]
    fn the_index_lists_every_code_in_its_group() {
        let mut index = String::new();
        for (number, title) in GROUPS {
            index += &format!("**{title}**\n\n");
            for Code { code, title } in CODES.iter().filter(|code| &code.code[1..3] == *number) {
                let words = title.replace(|c: char| !c.is_ascii_alphanumeric() && c != ' ' && c != '-', "");
                let anchor = format!("{code}-{words}").to_lowercase().replace(' ', "-");
                index += &format!("- [{code}](#{anchor}) {title}\n");
            }
            index += "\n";
        }
        assert_eq!(index.matches("- [").count(), CODES.len(), "a code has no group");
        assert!(REFERENCE.contains(&index), "docs/diagnostics.md has another index than\n{index}");
    }

    #[test]
    fn a_section_holds_meaning_example_and_remedy() {
        for code in CODES {
            let text = explain(code.code).expect(code.code);
            assert!(text.starts_with(&format!("## {}", code.code)), "{text}");
            assert!(text.contains("\n```text\n") && text.contains("**Remedy:**"), "{} is incomplete", code.code);
        }
    }

    #[test]
    fn explain_ignores_case_and_knows_nothing_else() {
        assert_eq!(explain("e0101"), explain("E0101"));
        assert_eq!(explain("E9999"), None);
    }
}
