//! The map of the design, for hosts and wrappers.

use pe_ir::index::{at, number};
use std::num::NonZeroU32;

use pe_ir::program::{self, Host, InputPort, OutputPort, Program, StateRegister};
use pe_map::{
    Between, Control, EarlyStep, Format, HostRounding, Input, Map, Meaning, Output, OutputMemory, Outside, Parameter,
    Rounding, State, Tick, VERSION, sha256,
};

use crate::access;
use crate::names::{Names, READER};
use crate::options::{Driven, EmitOptions, Tunable};

/// What tells a design from others that compute other words.
pub fn hash(program: &Program, options: &EmitOptions) -> String {
    sha256(format!("{}\n{program}", generator(options)).as_bytes())
}

fn generator(options: &EmitOptions) -> String {
    format!("pe-synth {}", options.version)
}

/// The text of `<model>_map.json`.
pub fn render(program: &Program, names: &Names, options: &EmitOptions, hash: &str) -> String {
    let interface = &options.interface;
    let port = |name: &str| name.to_owned();
    let early_step = |(until, step): &(f64, f64)| EarlyStep { until: *until, step: *step };
    let inputs = program.ports().zip(&names.inputs).enumerate();
    let memory = program.output_memory();
    // The number of an output is its address.
    let output = |(index, output): (usize, _)| match memory {
        Some(_) => (output, READER[1], Some(number(index))),
        None => (output, names.outputs[index].as_str(), None),
    };
    let outputs = program.outputs.iter().enumerate().map(output);
    let map = Map {
        map_version: VERSION,
        hash: hash.to_owned(),
        generator: generator(options),
        model: program.model.clone(),
        entity: names.model.clone(),
        control: Control {
            clock: port("clk_i"),
            clock_enable: port("ce_i"),
            step: port("step_i"),
            busy: port("busy_o"),
            done: port("done_o"),
            overflow: port("overflow_o"),
        },
        step: interface.step,
        early_steps: interface.early_steps.iter().map(early_step).collect(),
        clocks_per_step: program.period,
        inputs: inputs
            .map(|(index, (input, name))| described(program, input, name, interface.inputs.get(index)))
            .collect(),
        ticks: program
            .ticks()
            .map(|(index, tick, _)| {
                let name = program.inputs[at(index)].name.clone();
                Tick { name, steps: tick.steps, done: tick.done }
            })
            .collect(),
        outputs: outputs
            .zip(program.shown_states())
            .map(|((port, name, address), state)| {
                let first = interface.initial.get(&port.name).copied();
                shown(program, port, (name, address), (state.map(|id| id.number()), first))
            })
            .collect(),
        output_memory: memory.as_ref().map(|memory| OutputMemory {
            address: port(READER[0]),
            address_bits: memory.address_bits(),
            word: port(READER[1]),
            latency: memory.latency,
            lead: program::OutputMemory::READ_AFTER,
        }),
        states: program.states.iter().map(|state| placed(program, state)).collect(),
        parameters: interface.parameters.iter().filter_map(|tunable| parameter(program, tunable)).collect(),
        host: (program.host != Host::default()).then(|| access::ports(program)),
        foreign: None,
    };
    map.text()
}

fn described(program: &Program, input: &InputPort, name: &str, driven: Option<&Driven>) -> Input {
    let format = Format { bits: program.format.storage_bits, exponent: input.exponent };
    let [least, most] = format.words();
    // Stored words carry the offset of a data operand, and are clamped at its largest one.
    let room = (program.format.max_word() - program.format.data_offset()) >> program.format.guard_bits;
    let words = [least, most.min(room)];
    let guard = program.format.guard_bits as i32;
    let dropped = program.format.data_drop() as i32;
    Input {
        name: input.name.clone(),
        port: name.to_owned(),
        meaning: driven.map_or(Meaning::Quantity, |driven| driven.meaning),
        unit: input.unit.clone(),
        format,
        words,
        limits: words.map(|word| format.number(word)),
        range: driven.and_then(|driven| driven.range),
        between: driven.map_or(Between::Hold, |driven| driven.between),
        operand: Format { bits: program.format.data_bits, exponent: input.exponent - guard + dropped },
        rounding: Rounding::NearestHalvesUp,
        outside: Outside::ClampsAndFlags,
        host_rounding: HostRounding::Nearest,
    }
}

/// An output: its port and address, the state that it shows, and its number in the initial state.
fn shown(
    program: &Program,
    output: &OutputPort,
    (name, address): (&str, Option<u32>),
    (state, first): (Option<u32>, Option<f64>),
) -> Output {
    let format = Format { bits: program.format.storage_bits, exponent: output.exponent };
    Output {
        name: output.name.clone(),
        port: name.to_owned(),
        address,
        unit: output.unit.clone(),
        format,
        rounding: Rounding::NearestHalvesUp,
        state,
        initial: first.filter(|_| state.is_none()).and_then(|number| format.word(number)).map(|word| word.word),
        outside: if output.proven { Outside::Proven } else { Outside::Clamps },
    }
}

/// A tunable parameter, if the program has its state.
fn parameter(program: &Program, tunable: &Tunable) -> Option<Parameter> {
    let Tunable { name, unit, value, range } = tunable.clone();
    let state = program.states.iter().position(|state| state.name == name)?;
    Some(Parameter { name, unit, state: number(state), value, range })
}

fn placed(program: &Program, state: &StateRegister) -> State {
    let (pe, address) = state.own;
    let base = program.pes[pe].features.state_base(address) as u16;
    State {
        name: state.name.clone(),
        format: Format { bits: program.format.word_bits(), exponent: state.exponent },
        offset: program.format.data_offset(),
        pe: pe.number(),
        address,
        base: (state.age.is_none() && base != address).then_some(base),
        copies: state.imported.iter().map(|(pe, address)| (pe.number(), *address)).collect(),
        age: state.age.map(NonZeroU32::get),
        initial: state.initial(program),
    }
}
