//! Fusing: equations that functions of one variable read are written out there, however the author cut them, so that as
//! much as possible of one variable becomes one function.
//!
//! `tau = 1/(alpha + beta)` with `alpha` and `beta` of `V` becomes a function of `V`; so does `V/(E - 1)` with
//! `E = exp(V)`, whose singularity is removable only then. Sums such as `V - EK` that functions are applied to become
//! variables of their own, so that all that reads them can be fused as well; the time stays one. Choices that do no more
//! than fill a gap of a formula are left out first ([`guards`]). What nothing reads any more is dropped. The values of a
//! model stay what they are; see `docs/decisions/0080-fusion.md`.

mod guards;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use pe_ir::index;
use pe_ir::model::{Algebraic, Expr, Model, Select, State, Variable};
use pe_ir::motion::Motion;
use pe_ir::source::{Diagnostic, Span};

use crate::kinks::bends;
use crate::lift::{MOST_KINKS, Reads};

/// Parts of an expression that is written out, at most.
const LONGEST: usize = 400;

/// Terms of a sum that becomes a variable, at most.
const MOST_TERMS: usize = 4;

/// A model whose functions of one variable are whole, and warnings about choices that were left out. Its algebraic
/// equations get other numbers.
pub fn fuse(model: Model) -> (Model, Vec<Diagnostic>) {
    let all = model.algebraics.iter().map(|algebraic| &algebraic.expr);
    if all.chain(model.states.iter().flat_map(State::equations)).all(Expr::is_polynomial) {
        return (model, Vec::new());
    }
    let mut fuser = Fuser {
        alone: read_by_one(&model),
        numbers: Vec::with_capacity(model.algebraics.len()),
        algebraics: Vec::with_capacity(model.algebraics.len()),
        bodies: Vec::with_capacity(model.algebraics.len()),
        directions: HashMap::new(),
        findings: Vec::new(),
        span: Span::default(),
        name: String::new(),
        model: &model,
    };
    for (number, algebraic) in model.algebraics.iter().enumerate() {
        (fuser.span, fuser.name) = (algebraic.span, algebraic.name.clone());
        let piece = fuser.piece(&algebraic.expr);
        let expr = fuser.cheapest(number, &piece);
        let own = Variable::Algebraic(index::number(fuser.algebraics.len()));
        let is_plain = algebraic.range.is_none() && !algebraic.angle && !algebraic.kept && !is_time(&model, algebraic);
        let body = piece.written.filter(|_| is_plain && piece.reads != Reads::Nothing && piece.reads != Reads::Many);
        let body = body.filter(|body| size(body) <= LONGEST && bends(body).is_some_and(|all| all.len() <= MOST_KINKS));
        if let Some((direction, scale, offset)) = direction(&expr).filter(|_| body.is_none() && is_plain) {
            fuser.directions.entry(direction).or_insert((own, scale, offset));
        }
        fuser.numbers.push(index::number(fuser.algebraics.len()));
        fuser.push(Algebraic { expr, ..algebraic.clone() }, body.map(|body| (piece.reads, body)));
    }
    let mut equations = Vec::with_capacity(model.states.len());
    for state in &model.states {
        (fuser.span, fuser.name) = (state.span, state.name.clone());
        equations.push(state.equations().map(|expr| fuser.piece(expr).cut).collect::<Vec<_>>());
    }
    let Fuser { numbers, algebraics, findings, .. } = fuser;
    let mut model = Model { algebraics, ..model };
    for (state, equations) in model.states.iter_mut().zip(equations) {
        state.equations_mut().zip(equations).for_each(|(own, equation)| *own = equation);
    }
    model.outputs.iter_mut().for_each(|output| renumber(&mut output.variable, &numbers));
    if let Some(mechanism) = &mut model.mechanism {
        Arc::make_mut(mechanism).each_variable_mut(&mut |variable| renumber(variable, &numbers));
    }
    drop_unread(&mut model);
    model.share_systems();
    (model, findings)
}

/// Whether an equation is that of the time, which depends on the step: another step makes a new one.
fn is_time(model: &Model, algebraic: &Algebraic) -> bool {
    let mut reads = false;
    algebraic.expr.each_variable(&mut |variable| {
        reads |= matches!(variable, Variable::State(state) if model.states[state].motion == Some(Motion::Clock));
    });
    reads
}

/// For each algebraic equation, whether one other equation reads it and no output.
fn read_by_one(model: &Model) -> Vec<bool> {
    let mut counts = vec![0u32; model.algebraics.len()];
    let mut read = |expr: &Expr| {
        let mut seen = BTreeSet::new();
        expr.each_variable(&mut |variable| {
            if let Variable::Algebraic(number) = variable {
                seen.insert(number);
            }
        });
        seen.into_iter().for_each(|number| counts[index::at(number)] += 1);
    };
    model.algebraics.iter().for_each(|algebraic| read(&algebraic.expr));
    model.states.iter().flat_map(State::equations).for_each(read);
    for output in &model.outputs {
        if let Variable::Algebraic(number) = output.variable {
            counts[index::at(number)] += 2;
        }
    }
    counts.into_iter().map(|count| count == 1).collect()
}

/// Drops algebraic equations that nothing reads, unless they are kept.
fn drop_unread(model: &mut Model) {
    let count = model.algebraics.len();
    let mut needed: Vec<bool> = model.algebraics.iter().map(|algebraic| algebraic.kept).collect();
    let mark = |expr: &Expr, needed: &mut Vec<bool>| {
        expr.each_variable(&mut |variable| {
            if let Variable::Algebraic(number) = variable {
                needed[index::at(number)] = true;
            }
        });
    };
    model.states.iter().flat_map(State::equations).for_each(|expr| mark(expr, &mut needed));
    for output in &model.outputs {
        mark(&Expr::Variable(output.variable), &mut needed);
    }
    for part in model.mechanism.iter().flat_map(|mechanism| mechanism.parts()) {
        mark(part, &mut needed);
    }
    for number in (0..count).rev() {
        if needed[number] {
            mark(&model.algebraics[number].expr, &mut needed);
        }
    }
    let mut next = 0;
    let numbers: Vec<u32> = needed
        .iter()
        .map(|needed| {
            next += u32::from(*needed);
            next.saturating_sub(1)
        })
        .collect();
    let renumber = |variable: &mut Variable| renumber(variable, &numbers);
    let mut place = 0;
    model.algebraics.retain(|_| {
        place += 1;
        needed[place - 1]
    });
    model.algebraics.iter_mut().for_each(|algebraic| algebraic.expr.each_variable_mut(&mut { renumber }));
    let equations = model.states.iter_mut().flat_map(State::equations_mut);
    equations.for_each(|expr| expr.each_variable_mut(&mut { renumber }));
    model.outputs.iter_mut().for_each(|output| renumber(&mut output.variable));
    if let Some(mechanism) = &mut model.mechanism {
        Arc::make_mut(mechanism).each_variable_mut(&mut { renumber });
    }
}

/// Gives a variable its new number.
fn renumber(variable: &mut Variable, numbers: &[u32]) {
    if let Variable::Algebraic(number) = variable {
        *number = numbers[index::at(*number)];
    }
}

/// Variables, constants and what joins them.
fn size(expr: &Expr) -> usize {
    match expr {
        Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) => 1,
        Expr::Sum(members) | Expr::Product(members) => 1 + members.iter().map(size).sum::<usize>(),
        Expr::Power(base, _) | Expr::Apply(_, base) => 1 + size(base),
        Expr::Select(select) => 1 + [&select.condition, &select.yes, &select.no].map(size).iter().sum::<usize>(),
    }
}

/// Variables of a sum and the bits of their factors over that of the first.
type Terms = Vec<(Variable, u64)>;

/// Terms of a sum of several variables over the factor of the first, by the bits of their factors; that factor, and what
/// is added.
fn direction(expr: &Expr) -> Option<(Terms, f64, f64)> {
    let mut factors: BTreeMap<Variable, f64> = BTreeMap::new();
    let mut offset = 0.0;
    affine(expr, 1.0, &mut factors, &mut offset)?;
    factors.retain(|_, factor| *factor != 0.0);
    if !(2..=MOST_TERMS).contains(&factors.len()) {
        return None;
    }
    let first = *factors.values().next()?;
    let terms: Terms = factors.into_iter().map(|(variable, factor)| (variable, (factor / first).to_bits())).collect();
    (first.is_finite() && offset.is_finite()).then_some((terms, first, offset))
}

/// Adds up the factors of variables in a sum of products with numbers.
fn affine(expr: &Expr, weight: f64, factors: &mut BTreeMap<Variable, f64>, offset: &mut f64) -> Option<()> {
    match expr {
        Expr::Constant(number) => *offset += weight * number,
        Expr::Variable(variable) => *factors.entry(*variable).or_default() += weight,
        Expr::Sum(members) => members.iter().try_for_each(|member| affine(member, weight, factors, offset))?,
        Expr::Product(members) => {
            let mut rest = None;
            let mut weight = weight;
            for member in members {
                match member {
                    Expr::Constant(number) => weight *= number,
                    member if rest.is_none() => rest = Some(member),
                    _ => return None,
                }
            }
            match rest {
                Some(rest) => affine(rest, weight, factors, offset)?,
                None => *offset += weight,
            }
        }
        Expr::Power(..) | Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => return None,
    }
    Some(())
}

/// An expression of the fused model.
struct Piece {
    /// With the equations that it reads by name, but where writing them out makes one function of several.
    cut: Expr,
    /// The variables that it comes down to.
    reads: Reads,
    /// With all equations written out, if it comes down to one variable at most.
    written: Option<Expr>,
    /// Whether it applies a function itself.
    applies: bool,
}

impl Piece {
    fn cut(expr: Expr, applies: bool) -> Piece {
        Piece { cut: expr, reads: Reads::Many, written: None, applies }
    }

    /// What becomes one function.
    fn function(expr: Expr, reads: Reads) -> Piece {
        Piece { cut: expr.clone(), reads, written: Some(expr), applies: true }
    }
}

struct Fuser<'a> {
    model: &'a Model,
    /// Whether an algebraic equation of the model has one reader.
    alone: Vec<bool>,
    /// New numbers of the algebraic equations so far.
    numbers: Vec<u32>,
    algebraics: Vec<Algebraic>,
    /// What those of one variable are, written out.
    bodies: Vec<Option<(Reads, Expr)>>,
    /// Variables that are a sum of others: a factor of its terms and what is added.
    directions: HashMap<Terms, (Variable, f64, f64)>,
    findings: Vec<Diagnostic>,
    /// The equation of the spec that is being fused.
    span: Span,
    name: String,
}

impl Fuser<'_> {
    fn push(&mut self, algebraic: Algebraic, body: Option<(Reads, Expr)>) {
        self.algebraics.push(algebraic);
        self.bodies.push(body);
    }

    /// The right-hand side of an equation. Where it is a polynomial of functions that nothing else reads, one function
    /// in place of all is cheaper.
    fn cheapest(&self, number: usize, piece: &Piece) -> Expr {
        let Some(written) = piece.written.as_ref().filter(|_| !piece.applies && piece.reads != Reads::Nothing) else {
            return piece.cut.clone();
        };
        let (mut functions, mut all_alone) = (0, true);
        self.model.algebraics[number].expr.each_variable(&mut |variable| {
            if let Variable::Algebraic(inner) = variable {
                let body = &self.bodies[index::at(self.numbers[index::at(inner)])];
                if body.as_ref().is_some_and(|(_, body)| !body.is_polynomial()) {
                    functions += 1;
                    all_alone &= self.alone[index::at(inner)];
                }
            }
        });
        let is_one = bends(written).is_some_and(|places| places.len() <= MOST_KINKS) && size(written) <= LONGEST;
        if functions > 0 && all_alone && is_one { written.clone() } else { piece.cut.clone() }
    }

    fn piece(&mut self, expr: &Expr) -> Piece {
        match expr {
            Expr::Constant(_) => {
                Piece { cut: expr.clone(), reads: Reads::Nothing, written: Some(expr.clone()), applies: false }
            }
            Expr::Variable(variable) => self.variable(*variable),
            Expr::Sum(members) => {
                let pieces: Vec<Piece> = members.iter().map(|member| self.piece(member)).collect();
                joined(pieces, Expr::sum)
            }
            Expr::Product(members) => {
                let mut pieces: Vec<Piece> = members.iter().map(|member| self.piece(member)).collect();
                self.factors(&mut pieces);
                joined(pieces, Expr::product)
            }
            Expr::Power(base, exponent) => {
                let base = self.piece(base);
                let power = |expr| Expr::power(expr, *exponent);
                Piece { cut: power(base.cut), written: base.written.map(power), ..base }
            }
            Expr::Apply(function, argument) => {
                let argument = self.piece(argument);
                let apply = |expr: Expr| Expr::Apply(*function, Box::new(expr));
                match argument {
                    // What has no value stays a variable, so that the run finds it and names it.
                    Piece { reads: Reads::Nothing, cut, .. } => Piece::cut(apply(cut), true),
                    Piece { reads, written: Some(written), .. } if size(&written) <= LONGEST => {
                        Piece::function(apply(written), reads)
                    }
                    Piece { cut, .. } => match self.sum(&cut) {
                        Some(sum) => Piece::function(apply(sum.1), Reads::One(sum.0)),
                        None => Piece::cut(apply(cut), true),
                    },
                }
            }
            Expr::Select(select) => self.select(select),
            // The whole of an equation, of variables and numbers alone.
            Expr::Solution(_) => Piece::cut(expr.renamed(&|variable| self.renumbered(variable)), true),
        }
    }

    fn renumbered(&self, variable: Variable) -> Variable {
        match variable {
            Variable::Algebraic(number) => Variable::Algebraic(self.numbers[index::at(number)]),
            variable => variable,
        }
    }

    fn variable(&self, variable: Variable) -> Piece {
        let variable = self.renumbered(variable);
        let cut = Expr::Variable(variable);
        if let Variable::Algebraic(number) = variable {
            let number = index::at(number);
            if let Expr::Constant(value) = self.algebraics[number].expr {
                return Piece { cut, reads: Reads::Nothing, written: Some(Expr::Constant(value)), applies: false };
            }
            if let Some((reads, body)) = &self.bodies[number] {
                return Piece { cut, reads: *reads, written: Some(body.clone()), applies: false };
            }
        }
        Piece { cut: cut.clone(), reads: Reads::One(variable), written: Some(cut), applies: false }
    }

    /// A sum of several variables as one that stands for it, and the sum in terms of that.
    fn sum(&mut self, expr: &Expr) -> Option<(Variable, Expr)> {
        let (terms, factor, offset) = direction(expr)?;
        let own = Variable::Algebraic(index::number(self.algebraics.len()));
        let (variable, scale, added) = *self.directions.entry(terms.clone()).or_insert((own, 1.0, 0.0));
        if variable == own {
            let term = |(variable, bits): (Variable, u64)| Expr::scaled(f64::from_bits(bits), Expr::Variable(variable));
            let expr = Expr::sum(terms.into_iter().map(term).collect());
            let name = self.sum_name(&expr);
            let (unit, range, span) = (None, None, self.span);
            self.push(Algebraic { name, unit, expr, range, kept: false, angle: false, span }, None);
        }
        let ratio = factor / scale;
        let scaled = Expr::scaled(ratio, Expr::Variable(variable));
        Some((variable, Expr::sum(vec![scaled, Expr::Constant(offset - ratio * added)])))
    }

    /// A name that no variable has: its text, which is none of the language.
    fn sum_name(&self, expr: &Expr) -> String {
        expr.text(&|variable, _| match variable {
            Variable::State(number) => self.model.states[number].name.clone(),
            Variable::Input(number) => self.model.inputs[index::at(number)].name.clone(),
            Variable::Algebraic(number) => self.algebraics[index::at(number)].name.clone(),
        })
    }

    /// Writes out those factors of a product that come down to the variable of a function beside them.
    fn factors(&mut self, pieces: &mut [Piece]) {
        let root =
            |piece: &Piece| if let (Reads::One(root), true) = (piece.reads, piece.applies) { Some(root) } else { None };
        let roots: BTreeSet<Variable> = pieces.iter().filter_map(root).collect();
        if roots.is_empty() {
            return;
        }
        for piece in pieces.iter_mut() {
            if let (Reads::Many, Some((terms, factor, offset))) = (piece.reads, direction(&piece.cut)) {
                let known = self.directions.get(&terms).filter(|(variable, ..)| roots.contains(variable));
                if let Some((variable, scale, added)) = known {
                    let ratio = factor / scale;
                    let scaled = Expr::scaled(ratio, Expr::Variable(*variable));
                    let cut = Expr::sum(vec![scaled, Expr::Constant(offset - ratio * added)]);
                    *piece =
                        Piece { cut: cut.clone(), reads: Reads::One(*variable), written: Some(cut), applies: false };
                }
            }
            if let (Reads::One(root), Some(written)) = (piece.reads, &piece.written)
                && roots.contains(&root)
                && size(written) <= LONGEST
            {
                piece.cut = written.clone();
            }
        }
    }

    fn select(&mut self, select: &Select) -> Piece {
        let [condition, yes, no] = [&select.condition, &select.yes, &select.no].map(|part| self.piece(part));
        if let (Reads::One(root), Some(condition)) = (condition.reads, &condition.written) {
            let written = |expr: &Expr| self.written_for(expr, root);
            let (yes_written, no_written) = (written(&yes.cut), written(&no.cut));
            if let Some(guard) = guards::guard(condition, root, &yes_written, &no_written) {
                if guard.difference > guards::ROUNDED {
                    self.findings.push(guards::left_out(&guard, (&self.name, self.span)));
                }
                return if guard.formula_if_true { yes } else { no };
            }
        }
        let reads = condition.reads.with(yes.reads).with(no.reads);
        let choice = |condition, yes, no| Expr::Select(Box::new(Select { condition, yes, no }));
        if let (Some(condition), Some(yes), Some(no)) = (&condition.written, &yes.written, &no.written)
            && reads != Reads::Many
        {
            let written = choice(condition.clone(), yes.clone(), no.clone());
            if bends(&written).is_some_and(|places| places.len() <= MOST_KINKS) && size(&written) <= LONGEST {
                return Piece::function(written, reads);
            }
        }
        Piece::cut(choice(condition.cut, yes.cut, no.cut), true)
    }

    /// An expression of the fused model with all equations of one variable written out.
    fn written_for(&self, expr: &Expr, root: Variable) -> Expr {
        expr.substituted(&|variable| match variable {
            Variable::Algebraic(number) => match &self.bodies[index::at(number)] {
                Some((Reads::One(other), body)) if *other == root => body.clone(),
                _ => Expr::Variable(variable),
            },
            variable => Expr::Variable(variable),
        })
    }
}

/// A sum or product of pieces.
fn joined(pieces: Vec<Piece>, join: fn(Vec<Expr>) -> Expr) -> Piece {
    let reads = pieces.iter().fold(Reads::Nothing, |reads, piece| reads.with(piece.reads));
    let applies = pieces.iter().any(|piece| piece.applies);
    let written: Option<Vec<Expr>> = match reads {
        Reads::Many => None,
        _ => pieces.iter().map(|piece| piece.written.clone()).collect(),
    };
    let written = written.map(join).filter(|written| size(written) <= LONGEST);
    match written {
        Some(written) if applies => Piece::function(written, reads),
        Some(written) => {
            let cut = join(pieces.into_iter().map(|piece| piece.cut).collect());
            Piece { cut, reads, written: Some(written), applies }
        }
        None => Piece {
            reads: Reads::Many,
            ..Piece::cut(join(pieces.into_iter().map(|piece| piece.cut).collect()), applies)
        },
    }
}
