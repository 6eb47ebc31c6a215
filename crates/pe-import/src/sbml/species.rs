//! Species: amounts and concentrations.

use std::collections::HashMap;

use roxmltree::Node;

use super::{Reader, flag, unknown_id};
use crate::expr::Expr;
use crate::model::{Kind, Quantity};
use crate::xml::{listed, span};

/// What is known of a species beside its quantity.
pub(super) struct Species<'a> {
    node: Node<'a, 'a>,
    /// The quantity of its compartment.
    compartment: usize,
    /// Whether expressions mean its amount by its name, and not its concentration.
    is_amount: bool,
    /// Units of its amount and its concentration.
    units: [Option<String>; 2],
    /// The quantity that holds its amount, where that is another one.
    amount: Option<usize>,
    /// What reactions add to its amount per time; members with `true` are taken away.
    pub flows: Vec<(bool, Expr)>,
}

impl<'a> Reader<'a, '_> {
    pub(super) fn declare_species(&mut self) {
        let compartments: HashMap<&str, Node> = listed(self.node, "listOfCompartments")
            .into_iter()
            .filter_map(|node| Some((node.attribute("id")?, node)))
            .collect();
        for node in listed(self.node, "listOfSpecies") {
            let Some(index) = self.declare(node, "Species") else { continue };
            let name = node.attribute("compartment").unwrap_or("");
            let (Some(compartment), Some(around)) = (self.core.ids.get(name), compartments.get(name)) else {
                self.findings.push(unknown_id(node, name));
                continue;
            };
            let is_point = around.attribute("spatialDimensions").is_some_and(|text| text.trim().parse() == Ok(0.0));
            let is_amount = flag(node, "hasOnlySubstanceUnits", false) || is_point;
            let units = [true, false].map(|amount| self.species_unit(node, *around, amount));
            self.model.quantities[index].unit = units[usize::from(!is_amount)].clone();
            let species =
                Species { node, compartment: *compartment, is_amount, units, amount: None, flows: Vec::new() };
            self.species.insert(index, species);
        }
    }

    /// Whether reactions change a species.
    pub(super) fn is_reacting(&self, index: usize) -> bool {
        let id = &self.model.quantities[index].id;
        self.species.get(&index).is_some_and(|species| {
            let fixed = flag(species.node, "boundaryCondition", false) || flag(species.node, "constant", false);
            !fixed && !self.rules.contains_key(id)
        })
    }

    /// What a species is converted with from the extent of reactions.
    pub(super) fn conversion(&mut self, index: usize) -> Option<Expr> {
        let own = self.species[&index].node;
        let node = if own.has_attribute("conversionFactor") { own } else { self.node };
        let factor = node.attribute("conversionFactor")?;
        match self.core.ids.get(factor) {
            Some(factor) => Some(Expr::Name(*factor)),
            None => {
                self.findings.push(unknown_id(node, factor));
                None
            }
        }
    }

    /// Gives all species their values and equations, after all reactions are read.
    pub(super) fn species(&mut self) {
        let mut all: Vec<usize> = self.species.keys().copied().collect();
        all.sort_unstable();
        for index in all {
            let Some(mut species) = self.species.remove(&index) else { continue };
            let flows = std::mem::take(&mut species.flows);
            self.one_species(index, &mut species, flows);
            self.species.insert(index, species);
        }
    }

    fn one_species(&mut self, index: usize, species: &mut Species<'a>, flows: Vec<(bool, Expr)>) {
        let id = self.model.quantities[index].id.clone();
        let around = Expr::Name(species.compartment);
        let compartment_varies = self.varies(&self.model.quantities[species.compartment].id);
        let amount = self.attribute(species.node, "initialAmount");
        let concentration = self.attribute(species.node, "initialConcentration");
        let [amount_unit, concentration_unit] = &species.units;
        let start = match (self.start(index), amount, concentration, species.is_amount) {
            (Some(start), ..) => Some(start),
            (None, Some(amount), _, true) => Some(amount),
            (None, Some(amount), _, false) => Some(amount.measured(amount_unit.as_deref()).over(around.clone())),
            (None, None, Some(concentration), true) => {
                Some(concentration.measured(concentration_unit.as_deref()).times(around.clone()))
            }
            (None, None, Some(concentration), false) => Some(concentration),
            (None, None, None, _) => None,
        };
        let changes = !flows.is_empty() || self.changed.contains(&id);
        if let Some(kind) = self.diluted(index, species, &start) {
            self.model.quantities[index].kind = kind;
            return;
        }
        if self.rules.contains_key(&id) || species.is_amount || !compartment_varies {
            let mut kind = self.ruled(index, start);
            if !flows.is_empty() {
                let rate = Expr::sum(flows);
                let rate = if species.is_amount { rate } else { rate.over(around) };
                kind = match kind {
                    Kind::Constant(initial) | Kind::State { initial, .. } => Kind::State { initial, rate },
                    other => other,
                };
            }
            self.model.quantities[index].kind = kind;
            return;
        }
        // The amount stays as it is when the compartment changes, and the concentration follows.
        let held = self.amount_of(index, species);
        let initial = start.map(|start| match start {
            Expr::Product(members) if members.len() == 2 && members[1] == (true, around.clone()) => {
                members[0].1.clone()
            }
            start => start.times(around.clone()),
        });
        self.model.quantities[held].kind = match (initial, changes) {
            (None, _) => Kind::Missing,
            (Some(initial), true) => Kind::State { initial, rate: Expr::sum(flows) },
            (Some(initial), false) => Kind::Constant(initial),
        };
        self.model.quantities[index].kind = Kind::Algebraic(Expr::Name(held).over(around));
    }

    /// What a concentration with a rate is, if events change its compartment: they leave its amount as it is, which is
    /// the state then.
    fn diluted(&mut self, index: usize, species: &mut Species<'a>, start: &Option<Expr>) -> Option<Kind> {
        let size = &self.model.quantities[species.compartment];
        if species.is_amount || !self.changed.contains(&size.id) {
            return None;
        }
        let growth = match &size.kind {
            Kind::State { rate, .. } => rate.clone(),
            _ => return None,
        };
        let (is_rate, rule) = *self.rules.get(&self.model.quantities[index].id)?;
        let start = start.clone().filter(|_| is_rate)?;
        let around = Expr::Name(species.compartment);
        let inflow = self.math(rule).times(around.clone());
        let held = self.amount_of(index, species);
        let rate = Expr::sum(vec![(false, inflow), (false, Expr::Name(index).times(growth))]);
        self.model.quantities[held].kind = Kind::State { initial: start.times(around.clone()), rate };
        Some(Kind::Algebraic(Expr::Name(held).over(around)))
    }

    /// The quantity for the amount of a species whose name means its concentration; made where there is none.
    fn amount_of(&mut self, index: usize, species: &mut Species<'a>) -> usize {
        if let Some(amount) = species.amount {
            return amount;
        }
        let id = &self.model.quantities[index].id;
        let mut quantity =
            Quantity::new(format!("{id}_amount"), self.model.quantities[index].group, span(species.node));
        quantity.label = format!("amount of {id}");
        let amount = self.model.add(quantity);
        species.amount = Some(amount);
        amount
    }

    /// The quantity of the compartment in which the name of a species means its concentration; none if it means its amount.
    pub(super) fn volume_of(&self, index: usize) -> Option<usize> {
        self.species.get(&index).filter(|species| !species.is_amount).map(|species| species.compartment)
    }

    /// The quantity that holds what a species is.
    pub(super) fn held(&self, index: usize) -> usize {
        self.species.get(&index).and_then(|species| species.amount).unwrap_or(index)
    }

    /// Makes an expression the equation of a quantity; the amount of a species that is held apart follows it.
    pub(super) fn determine(&mut self, index: usize, value: Expr) {
        if let Some(Species { amount: Some(amount), compartment, .. }) = self.species.get(&index) {
            let amount_of = Expr::Name(index).times(Expr::Name(*compartment));
            self.model.quantities[*amount].kind = Kind::Algebraic(amount_of);
        }
        self.model.quantities[index].kind = Kind::Algebraic(value);
    }

    /// The quantity to which an event gives a new value for a species, and that value. A concentration counts in the
    /// compartment as it is before the event, even if the event changes both.
    pub(super) fn assigned(&mut self, index: usize, value: Expr) -> (usize, Expr) {
        match self.species.get(&index) {
            Some(Species { amount: Some(amount), compartment, .. }) => (*amount, value.times(Expr::Name(*compartment))),
            _ => (index, value),
        }
    }

    /// The quantity that is the amount of a species; the quantity itself if it is one, or no species.
    pub(super) fn amount(&mut self, index: usize) -> usize {
        let Some(mut species) = self.species.remove(&index) else { return index };
        let amount = match species.is_amount {
            true => index,
            false => {
                let made = species.amount.is_none();
                let amount = self.amount_of(index, &mut species);
                if made {
                    let value = Expr::Name(index).times(Expr::Name(species.compartment));
                    self.model.quantities[amount].kind = Kind::Algebraic(value);
                }
                amount
            }
        };
        self.species.insert(index, species);
        amount
    }

    /// The quantity that is the concentration of a species; the quantity itself if it is one, or no species.
    pub(super) fn concentration(&mut self, index: usize) -> usize {
        let Some(species) = self.species.get(&index).filter(|species| species.is_amount) else { return index };
        let id = &self.model.quantities[index].id;
        let mut quantity =
            Quantity::new(format!("{id}_concentration"), self.model.quantities[index].group, span(species.node));
        quantity.label = format!("concentration of {id}");
        quantity.kind = Kind::Algebraic(Expr::Name(index).over(Expr::Name(species.compartment)));
        self.model.add(quantity)
    }
}
