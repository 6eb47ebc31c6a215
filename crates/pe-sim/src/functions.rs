//! Functions of one variable in a run in double precision: exact ones, and tables in their place.

use pe_ir::functions::Functions;
use pe_ir::graph::{Chain, Role, StepGraph, ValueId};

use crate::slots::Slots;

/// What a run needs to know of the step's functions.
///
/// Chains that apply a function, and those that write the argument of a lookup, are of classes of their own, so that
/// tiles of plain sums stay what they are. The columns of a lookup are written with its argument; chains that read them
/// read, directly or through others, the argument as well, and come later.
pub(crate) struct FunctionRun {
    functions: Functions,
    /// Smallest and largest argument of each exact function.
    pub arguments: Vec<(f64, f64)>,
    /// Slot, function and argument where a function had no value.
    pub outside: Option<(u32, u32, f64)>,
    /// The lookups of each argument, by its slot: ascending.
    lookups: Vec<(u32, u32)>,
    /// Slots and columns that are read, of each lookup.
    columns: Vec<Vec<(u32, u8)>>,
}

impl FunctionRun {
    /// The class of chains that write the argument of a lookup.
    pub const ARGUMENTS: u32 = u32::MAX;

    pub fn new(graph: &StepGraph, slots: &Slots) -> FunctionRun {
        let functions = graph.functions.clone();
        let lookups = functions.lookups.iter().enumerate();
        let mut lookups: Vec<(u32, u32)> =
            lookups.map(|(number, lookup)| (slots.of(lookup.argument), number as u32)).collect();
        lookups.sort_unstable();
        let mut columns = vec![Vec::new(); functions.lookups.len()];
        for (index, value) in graph.values.iter().enumerate() {
            if let Role::Column(lookup, column) = value.role {
                columns[lookup as usize].push((slots.of(ValueId(index as u32)), column));
            }
        }
        let arguments = vec![(f64::INFINITY, f64::NEG_INFINITY); functions.exact.len()];
        FunctionRun { functions, arguments, outside: None, lookups, columns }
    }

    /// The class of a chain: zero for plain sums.
    pub fn class(&self, chain: &Chain, slots: &Slots) -> u32 {
        match chain.function {
            Some(function) => function + 1,
            None if self.first_lookup(slots.of(chain.write.value)).is_some() => Self::ARGUMENTS,
            None => 0,
        }
    }

    fn first_lookup(&self, slot: u32) -> Option<usize> {
        let at = self.lookups.partition_point(|(argument, _)| *argument < slot);
        self.lookups.get(at).is_some_and(|(argument, _)| *argument == slot).then_some(at)
    }

    /// Applies the function of a class to the sums of a tile; `target` gives the slot of a lane.
    pub fn apply(&mut self, class: u32, numbers: &mut [f64], target: impl Fn(usize) -> u32) {
        if class == Self::ARGUMENTS {
            return;
        }
        let index = class as usize - 1;
        let (low, high) = &mut self.arguments[index];
        for (lane, number) in numbers.iter_mut().enumerate() {
            let argument = *number;
            *low = low.min(argument);
            *high = high.max(argument);
            *number = self.functions.exact[index].evaluate(argument);
            if !number.is_finite() && argument.is_finite() && self.outside.is_none() {
                self.outside = Some((target(lane), class - 1, argument));
            }
        }
    }

    /// Reads the columns of all lookups of an argument.
    pub fn look_up(&self, argument: u32, values: &mut [f64], largest: &mut [f64]) {
        let Some(first) = self.first_lookup(argument) else { return };
        let number = values[argument as usize];
        for (_, lookup) in self.lookups[first..].iter().take_while(|(slot, _)| *slot == argument) {
            let table = &self.functions.tables[self.functions.lookups[*lookup as usize].table as usize];
            let index = self.functions.segments.index_of(number, table.octaves);
            for (slot, column) in &self.columns[*lookup as usize] {
                let entry = table.columns[*column as usize][index];
                values[*slot as usize] = entry;
                largest[*slot as usize] = largest[*slot as usize].max(entry.abs());
            }
        }
    }
}
