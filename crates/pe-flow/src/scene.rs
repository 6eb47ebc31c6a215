//! Which equations are kept and for which output, and which are left out.
//!
//! Nothing is decided here; the report shows it as `kept`.

use std::borrow::Cow;
use std::collections::{HashMap, VecDeque};

use pe_ir::element;
use pe_ir::graph::{Role, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::{Model, Variable};

use crate::report::types::Kept;

/// Names of a chain of reasons that are shown; of longer ones the middle is left out.
const SHOWN_OF_CHAIN: usize = 8;

/// An entry per quantity, in the order of states, algebraic quantities and inputs, those left out as a whole at the
/// end: its length does not grow with the arrays.
///
/// `because` tells why the first kept element is there. `chain` leads from the element that is farthest from every
/// output to the output that needs it: each name is read by the next one.
pub fn kept(model: &Model, graph: &StepGraph) -> Vec<Kept> {
    let mut computed = vec![false; model.algebraics.len()];
    for value in &graph.values {
        if let Role::Algebraic(index, _) = value.role {
            // Behind the algebraic variables of the model come those of its linear systems.
            computed.get_mut(index as usize).into_iter().for_each(|computed| *computed = true);
        }
    }
    let scene = Scene::of(model);
    let mut quantities: Vec<Quantity> = Vec::new();
    let mut places: HashMap<Cow<str>, usize> = HashMap::new();
    for (at, (name, kind)) in scene.elements.iter().enumerate() {
        let quantity = element::quantity(name);
        let place = *places.entry(quantity.clone()).or_insert(quantities.len());
        if place == quantities.len() {
            quantities.push(Quantity { name: quantity, kind, kept: Vec::new(), put_in_place: 0, left_out: 0 });
        }
        quantities[place].kept.push(at);
        if let Variable::Algebraic(index) = scene.variable(at) {
            quantities[place].put_in_place += usize::from(!computed[index as usize]);
        }
    }
    for name in &model.left_out {
        let quantity = element::quantity(name);
        let place = *places.entry(quantity.clone()).or_insert(quantities.len());
        if place == quantities.len() {
            quantities.push(Quantity {
                name: quantity,
                kind: "left out",
                kept: Vec::new(),
                put_in_place: 0,
                left_out: 0,
            });
        }
        quantities[place].left_out += 1;
    }
    quantities.iter().map(|quantity| quantity.entry(&scene)).collect()
}

/// The elements of a quantity.
struct Quantity<'a> {
    name: Cow<'a, str>,
    kind: &'static str,
    /// Numbers of the kept elements in the scene.
    kept: Vec<usize>,
    /// Kept algebraic elements that are not computed on their own, but within each equation that reads them.
    put_in_place: usize,
    left_out: usize,
}

impl Quantity<'_> {
    fn entry(&self, scene: &Scene) -> Kept {
        let farthest = self.kept.iter().copied().max_by_key(|at| (scene.distance[*at], usize::MAX - at));
        Kept {
            name: self.name.clone().into_owned(),
            kind: self.kind.to_owned(),
            kept: self.kept.len(),
            put_in_place: self.put_in_place,
            left_out: self.left_out,
            because: self.kept.first().map_or("no output depends on it".to_owned(), |at| scene.because(*at)),
            chain: farthest.map_or(Vec::new(), |at| scene.chain(at).into_iter().map(str::to_owned).collect()),
        }
    }
}

/// The variables of a model and who needs them.
struct Scene<'a> {
    /// Name and kind: states, algebraic quantities, inputs.
    elements: Vec<(&'a str, &'static str)>,
    states: usize,
    algebraics: usize,
    /// The element that reads this one and is nearest to an output; itself for an output, the largest number for an input
    /// that only the solver reads.
    reader: Vec<usize>,
    /// Readers up to the nearest output.
    distance: Vec<u32>,
    /// Where the end of a long chain from this element begins that is shown; the element itself where that is near.
    ending: Vec<usize>,
}

impl<'a> Scene<'a> {
    fn of(model: &'a Model) -> Scene<'a> {
        let states = model.states.iter().map(|state| {
            let kind = if state.motion.is_some() { "signal" } else { "state" };
            (state.name.as_str(), kind)
        });
        let algebraics = model.algebraics.iter().map(|algebraic| (algebraic.name.as_str(), "algebraic"));
        let inputs = model.inputs.iter().map(|input| (input.name.as_str(), "input"));
        let elements: Vec<_> = states.chain(algebraics).chain(inputs).collect();
        let mut scene = Scene {
            reader: vec![usize::MAX; elements.len()],
            distance: vec![0; elements.len()],
            ending: (0..elements.len()).collect(),
            elements,
            states: model.states.len(),
            algebraics: model.algebraics.len(),
        };
        // Breadth first from the outputs, so that reasons are as short as can be.
        let mut waiting = VecDeque::new();
        for output in &model.outputs {
            let at = scene.number(output.variable);
            if scene.reader[at] == usize::MAX {
                scene.reader[at] = at;
                waiting.push_back(at);
            }
        }
        while let Some(reader) = waiting.pop_front() {
            let expr = match scene.variable(reader) {
                Variable::State(index) => &model.states[index].derivative,
                Variable::Algebraic(index) => &model.algebraics[index as usize].expr,
                Variable::Input(_) => continue,
            };
            expr.each_variable(&mut |variable| {
                let at = scene.number(variable);
                if scene.reader[at] == usize::MAX {
                    scene.reader[at] = reader;
                    scene.distance[at] = scene.distance[reader] + 1;
                    if scene.distance[at] as usize > SHOWN_OF_CHAIN / 2 - 2 {
                        scene.ending[at] = scene.ending[reader];
                    }
                    waiting.push_back(at);
                }
            });
        }
        scene
    }

    fn number(&self, variable: Variable) -> usize {
        match variable {
            Variable::State(index) => index.index(),
            Variable::Algebraic(index) => self.states + index as usize,
            Variable::Input(index) => self.states + self.algebraics + index as usize,
        }
    }

    fn variable(&self, at: usize) -> Variable {
        if at < self.states {
            Variable::State(StateId::at(at))
        } else if at < self.states + self.algebraics {
            Variable::Algebraic((at - self.states) as u32)
        } else {
            Variable::Input((at - self.states - self.algebraics) as u32)
        }
    }

    fn because(&self, at: usize) -> String {
        let name = self.elements[at].0;
        match self.reader[at] {
            reader if reader == at => format!("`{name}` is an output"),
            usize::MAX => format!("`{name}` is read by the solver's own equations"),
            reader => format!("`{name}` is read by `{}`", self.elements[reader].0),
        }
    }

    /// The names from an element to its output.
    fn chain(&self, mut at: usize) -> Vec<&'a str> {
        // Models of many scalars ask for many chains, which may be long.
        let long = self.distance[at] as usize >= SHOWN_OF_CHAIN;
        let mut chain = vec![self.elements[at].0];
        while ![at, usize::MAX].contains(&self.reader[at]) {
            at = self.reader[at];
            if long && chain.len() == SHOWN_OF_CHAIN / 2 {
                chain.push("...");
                at = self.ending[at];
            }
            chain.push(self.elements[at].0);
        }
        chain
    }
}
