//! What names and symbols in the expressions of SBML mean.

use std::collections::HashMap;

use pe_ir::codes;
use pe_ir::source::Diagnostic;
use roxmltree::Node;

use crate::expr::{Callee, Expr};
use crate::mathml::{self, Scope, bad};
use crate::model::{Function, Quantity};
use crate::number;

/// Names of the model.
#[derive(Default)]
pub(super) struct Core {
    /// Quantities by id.
    pub ids: HashMap<String, usize>,
    /// Functions by id.
    pub functions: HashMap<String, Known>,
    /// Quantities whose rate expressions read, with the id of that rate.
    pub rates_of: Vec<(usize, String)>,
    /// What stands for such a rate until it is known: a number beyond those of quantities.
    pub rate_marks: HashMap<usize, usize>,
}

/// A function of the model.
#[derive(Clone)]
pub(super) struct Known {
    /// Its number in the model.
    pub number: usize,
    /// Its body, if it is put in place of each call.
    pub inlined: Option<Expr>,
    /// How deep its calls go.
    pub level: usize,
}

/// Where one expression stands.
pub(super) struct Place<'c> {
    core: &'c mut Core,
    quantities: &'c [Quantity],
    functions: &'c [Function],
    locals: Option<&'c HashMap<String, usize>>,
    /// Arguments of the function whose body it is.
    pub arguments: Option<Vec<String>>,
    /// How deep the calls in it go.
    pub level: usize,
    parts: usize,
}

/// Most parts that calls put in place in one expression.
const MOST_PARTS: usize = 200_000;

/// Numbers from here on stand for rates that are not known yet.
const MARKS: usize = usize::MAX / 2;

impl Core {
    pub fn scope<'c>(
        &'c mut self,
        quantities: &'c [Quantity],
        functions: &'c [Function],
        locals: Option<&'c HashMap<String, usize>>,
    ) -> Place<'c> {
        Place { core: self, quantities, functions, locals, arguments: None, level: 0, parts: 0 }
    }
}

impl Scope for Place<'_> {
    fn name(&mut self, id: &str, place: Node) -> Result<Expr, Diagnostic> {
        if let Some(arguments) = &self.arguments {
            let argument = arguments.iter().position(|argument| argument == id);
            return argument.map(Expr::Argument).ok_or_else(|| {
                let finding = super::unknown_id(place, id);
                finding.with_help("functions read their arguments only")
            });
        }
        let local = self.locals.and_then(|locals| locals.get(id));
        local
            .or_else(|| self.core.ids.get(id))
            .map(|index| Expr::Name(*index))
            .ok_or_else(|| super::unknown_id(place, id))
    }

    fn call(&mut self, id: &str, arguments: Vec<Expr>, place: Node) -> Result<Expr, Diagnostic> {
        let Some(known) = self.core.functions.get(id) else {
            let message = format!("there is no function `{}` in the model", id.escape_debug());
            return Err(Diagnostic::error(codes::IMPORT_UNKNOWN, mathml::place(place), message));
        };
        let takes = self.functions[known.number].arguments.len();
        if takes != arguments.len() {
            let message = format!("`{}` has {} arguments and takes {takes}", id.escape_debug(), arguments.len());
            return Err(Diagnostic::error(codes::IMPORT_MATH, mathml::place(place), message));
        }
        if known.inlined.is_none() && !arguments.iter().any(Expr::is_condition) {
            self.level = self.level.max(known.level + 1);
            return Ok(Expr::Call(Callee::Own(known.number), arguments));
        }
        let body = known.inlined.as_ref().unwrap_or(&self.functions[known.number].body);
        let largest = arguments.iter().map(|argument| argument.extent().1).max().unwrap_or(1);
        self.parts = self.parts.saturating_add(body.extent().1.saturating_mul(largest));
        if self.parts > MOST_PARTS {
            let message = format!("calls of functions such as `{}` make the expression too long", id.escape_debug());
            return Err(Diagnostic::error(codes::IMPORT_LIMIT, mathml::place(place), message));
        }
        self.level = self.level.max(known.level);
        Ok(mathml::inlined(body, &arguments))
    }

    fn symbol(&mut self, url: &str, place: Node) -> Result<Expr, Diagnostic> {
        match url.rsplit('/').next() {
            Some("time") => Ok(Expr::Time),
            Some("avogadro") => Ok(number::literal("6.02214179e23").expect("a number")),
            _ => Err(bad(place, &format!("the symbol `{}` is not known", url.escape_debug()))),
        }
    }

    fn symbol_call(&mut self, url: &str, arguments: &[Node], place: Node) -> Result<Expr, Diagnostic> {
        match (url.rsplit('/').next(), arguments) {
            (Some("rateOf"), [argument]) => {
                let Expr::Name(of) = self.name(&crate::xml::text(*argument), *argument)? else {
                    return Err(bad(place, "`rateOf` takes the name of a quantity"));
                };
                let next = MARKS + self.core.rate_marks.len();
                let mark = *self.core.rate_marks.entry(of).or_insert_with(|| {
                    self.core.rates_of.push((of, format!("{}_rate", self.quantities[of].id)));
                    next
                });
                Ok(Expr::Name(mark))
            }
            (Some("delay"), [of, delay]) => {
                let (mut findings, mut parts) = (Vec::new(), 0);
                let mut reader = mathml::Reader { scope: self, findings: &mut findings, parts: &mut parts };
                let (of, delay) = (reader.number(*of), reader.number(*delay));
                if let Some(finding) = findings.into_iter().next() {
                    return Err(finding);
                }
                let mut of_rate = false;
                of.each(&mut |part| of_rate |= matches!(part, Expr::Name(mark) if *mark >= MARKS));
                if of_rate {
                    return Err(bad(place, "a rate some time ago cannot be expressed"));
                }
                Ok(of.map(&mut |leaf| match leaf {
                    Expr::Name(_) | Expr::Time => Some(Expr::Call(Callee::Past, vec![leaf.clone(), delay.clone()])),
                    Expr::Call(Callee::Past, members) => {
                        let both = Expr::sum([(false, members[1].clone()), (false, delay.clone())]);
                        Some(Expr::Call(Callee::Past, vec![members[0].clone(), both]))
                    }
                    _ => None,
                }))
            }
            _ => Err(bad(place, &format!("the symbol `{}` is not known", url.escape_debug()))),
        }
    }
}
