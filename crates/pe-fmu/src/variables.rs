//! Variables of an FMU, and the numbers by which they are called.

use pe_map::{Input, Map, Meaning, Output};

/// Number of the independent variable, which FMI 3.0 asks for.
pub const TIME: u32 = 0;
/// Number of the parameter that says how the network is reached.
pub const TRANSPORT: u32 = 1;
/// Number of the parameter that says how many clocks a step may take; 0 is no limit.
pub const CLOCK_BUDGET: u32 = 2;
/// Number of the first input.
const FIRST: u32 = 3;

/// A transport that needs nothing but the FMU.
pub const DEFAULT_TRANSPORT: &str = "model";

/// What a number of a variable stands for; indices count as [`Host::inputs`](pe_host::Host::inputs) and the map's outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// Time.
    Time,
    /// Parameter.
    Transport,
    /// Parameter.
    ClockBudget,
    /// Number for an input.
    Input(usize),
    /// Number of an output.
    Output(usize),
    /// Word of an output, in 64 bits.
    Word(usize),
    /// The lower 32 bits of it, in FMI 2.0.
    Low(usize),
    /// The upper 32 bits of it.
    High(usize),
    /// Number of a tunable parameter.
    Parameter(usize),
}

/// How many inputs, outputs and tunable parameters an FMU has.
#[derive(Clone, Copy, Debug)]
pub struct Variables {
    inputs: usize,
    outputs: usize,
    parameters: usize,
}

impl Variables {
    /// Variables of a design.
    pub fn of(map: &Map) -> Variables {
        let parameters = map.parameters.len();
        Variables { inputs: inputs(map).count(), outputs: map.outputs.len(), parameters }
    }

    /// The variable with this number.
    pub fn find(self, number: u32) -> Option<Variable> {
        match number {
            TIME => return Some(Variable::Time),
            TRANSPORT => return Some(Variable::Transport),
            CLOCK_BUDGET => return Some(Variable::ClockBudget),
            _ => (),
        }
        let index = (number - FIRST) as usize;
        let Some(behind) = index.checked_sub(self.inputs) else { return Some(Variable::Input(index)) };
        if let Some(parameter) = behind.checked_sub(4 * self.outputs) {
            return (parameter < self.parameters).then_some(Variable::Parameter(parameter));
        }
        let output = behind % self.outputs.max(1);
        match behind.checked_div(self.outputs)? {
            0 => Some(Variable::Output(output)),
            1 => Some(Variable::Word(output)),
            2 => Some(Variable::Low(output)),
            3 => Some(Variable::High(output)),
            _ => None,
        }
    }

    /// The number of a variable.
    pub fn number(self, variable: Variable) -> u32 {
        let index = match variable {
            Variable::Time => return TIME,
            Variable::Transport => return TRANSPORT,
            Variable::ClockBudget => return CLOCK_BUDGET,
            Variable::Input(index) => index,
            Variable::Output(index) => self.inputs + index,
            Variable::Word(index) => self.inputs + self.outputs + index,
            Variable::Low(index) => self.inputs + 2 * self.outputs + index,
            Variable::High(index) => self.inputs + 3 * self.outputs + index,
            Variable::Parameter(index) => self.inputs + 4 * self.outputs + index,
        };
        FIRST + u32::try_from(index).expect("a design has fewer ports")
    }
}

/// Inputs that are written.
pub fn inputs(map: &Map) -> impl Iterator<Item = &Input> {
    map.inputs.iter().filter(|input| input.meaning == Meaning::Quantity)
}

/// Name of an output that no input has.
pub fn output_name(map: &Map, output: &Output) -> String {
    match inputs(map).any(|input| input.name == output.name) {
        true => format!("{}.output", output.name),
        false => output.name.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_lead_back_to_their_variables() {
        let variables = Variables { inputs: 2, outputs: 3, parameters: 2 };
        let mut all = vec![Variable::Time, Variable::Transport, Variable::ClockBudget];
        all.extend((0..2).map(Variable::Input));
        for kind in [Variable::Output, Variable::Word, Variable::Low, Variable::High] {
            all.extend((0..3).map(kind));
        }
        all.extend((0..2).map(Variable::Parameter));
        for (number, variable) in (0..).zip(&all) {
            assert_eq!((variables.number(*variable), variables.find(number)), (number, Some(*variable)));
        }
        assert_eq!(variables.find(all.len() as u32), None);
        assert_eq!(Variables { inputs: 1, outputs: 0, parameters: 0 }.find(4), None);
    }
}
