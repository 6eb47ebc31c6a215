//! Kinds of damage.

/// Classes from rows of a table: the class, its name, and what is damaged.
macro_rules! classes {
    ($($class:ident, $name:literal, $what:literal;)*) => {
        /// A kind of damage.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[allow(missing_docs)]
        pub enum Class {
            $($class,)*
        }

        impl Class {
            /// All classes, in the order of the table.
            pub const ALL: &[Class] = &[$(Class::$class),*];

            /// Name in the table and in JSON.
            pub fn name(self) -> &'static str {
                match self {
                    $(Class::$class => $name,)*
                }
            }

            /// What is damaged, for the guide and JSON.
            pub fn what(self) -> &'static str {
                match self {
                    $(Class::$class => $what,)*
                }
            }
        }
    };
}

classes! {
    ProgramLoop, "program-loop", "a bit of a loop memory";
    ProgramStream, "program-stream", "a bit of a stream memory";
    ProgramVariants, "program-variants", "a bit of a variant memory";
    ImageOwn, "image-own", "a bit of an own memory's image";
    ImageBase, "image-base", "a bit of a base memory's image";
    ImageCoefficient, "image-coefficient", "a bit of a coefficient memory's image";
    ImageImported, "image-imported", "a bit of an imported memory's image";
    ImageIndex, "image-index", "the image of the index memories";
    Links, "links", "ports of a PE swapped, wired to another source, or counted wrongly";
    Wiring, "wiring", "a port of an instance tied or wired to another signal";
    Shifts, "shifts", "shift positions and their choice";
    Multiplier, "multiplier", "bits of the multiplier's operands, partial products";
    Latency, "latency", "a register more or less";
    Register, "register", "registers, enables and clears that are gone";
    Address, "address", "addresses: a stuck bit, off by one";
    Saturation, "saturation", "saturation of words and outputs";
    InputClamp, "input-clamp", "the clamp of inputs";
    Rounding, "rounding", "rounding of inputs, words and outputs";
    ClockEnable, "clock-enable", "registers that ignore the clock enable";
    StepHandshake, "step-handshake", "`step_i` ignored, inputs sampled at another time";
    Busy, "busy", "`busy_o`";
    Done, "done", "`done_o` and when outputs are published";
    PauseWord, "pause-word", "the pause word and the length of a step";
    Settle, "settle", "the first pass";
    Parity, "parity", "roles of buffers, rounds";
    Flags, "flags", "sticky flags";
    OverflowPort, "overflow-port", "`overflow_o`";
    Outputs, "outputs", "capture and publication of outputs";
    OutputPlaces, "output-places", "a bit of the places of outputs in memories";
    Ticks, "ticks", "period, phase and value of ticks";
    Lookup, "lookup", "segments, octaves, indices";
}
