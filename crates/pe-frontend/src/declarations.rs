//! What is fixed before time zero: initial values, stated ranges, and the signals of inputs.

use crate::ast::{Binder, Declared, Measure, Name, Range, Signal, StatementKind};
use crate::bound::{Node, NodeKind};
use crate::elaborate::Elaborator;
use crate::evaluate::{Fault, Purpose, fault};
use crate::functions;
use crate::names::{Kind, Symbol};
use crate::nearest::suggestion;
use crate::resolve::{Reads, unknown_function};
use crate::settings::{FREQUENCIES, scaled, unit_scale};
use pe_ir::codes;
use pe_ir::model::Waveform;
use pe_ir::source::{Diagnostic, Span};

/// Initial value and stated range of a flat state.
pub(crate) struct Initial {
    pub(crate) value: f64,
    pub(crate) range: Option<(f64, f64)>,
}

/// Signal and stated range of a flat input.
pub(crate) struct Driven {
    pub(crate) waveform: Waveform,
    pub(crate) range: Option<(f64, f64)>,
    /// The declaration.
    pub(crate) span: Span,
}

/// A waveform: name, names of its arguments, how many of them are needed.
const WAVEFORMS: [(&str, &[&str], usize); 3] = [
    ("constant", &["value"], 1),
    ("sine", &["amplitude", "frequency", "offset", "phase"], 2),
    ("square", &["amplitude", "frequency", "offset", "duty"], 2),
];

/// Place of the frequency among the arguments of a waveform.
const FREQUENCY: usize = 1;

/// A bound signal.
struct BoundSignal {
    /// Number in [`WAVEFORMS`].
    waveform: usize,
    /// Arguments and the scales of their units.
    arguments: Vec<(Node, f64)>,
}

/// A bound range of values.
type BoundBounds = Option<(Node, Node)>;

impl<'a> Elaborator<'a> {
    /// Initial values and ranges of all states, in flat order.
    pub(crate) fn initial_values(&mut self) -> Vec<Initial> {
        let mut initials = Vec::new();
        for statement in &self.spec.statements {
            let StatementKind::State { declared, initial, within } = &statement.kind else { continue };
            let value = self.bind_element(initial, &declared.dimensions, Reads::Constants);
            let bounds = self.bind_bounds(within.as_ref(), &declared.dimensions);
            let (Some(value), Some(bounds)) = (value, bounds) else { continue };
            let mut outside = None;
            self.for_each_element(declared, |elaborator| {
                let start = elaborator.evaluator.number(&elaborator.names, &value, Purpose::Constant)?;
                let range = elaborator.bounds(&bounds)?;
                if outside.is_none() && range.is_some_and(|(low, high)| start < low || start > high) {
                    outside = Some((start, range.unwrap_or_default()));
                }
                initials.push(Initial { value: start, range });
                Ok(())
            });
            if let Some((start, (low, high))) = outside {
                let what = format!("the initial value {start} of `{}`", declared.name.text);
                self.warn_outside(initial.span, &what, low, high);
            }
        }
        initials
    }

    /// Signals and ranges of all inputs, in flat order.
    pub(crate) fn inputs(&mut self) -> Vec<Driven> {
        let mut inputs = Vec::new();
        for statement in &self.spec.statements {
            let StatementKind::Input { declared, signal, within } = &statement.kind else { continue };
            let bound = self.bind_signal(signal, &declared.dimensions);
            let bounds = self.bind_bounds(within.as_ref(), &declared.dimensions);
            let (Some(signal), Some(bounds)) = (bound, bounds) else { continue };
            let mut outside = None;
            self.for_each_element(declared, |elaborator| {
                let waveform = elaborator.waveform(&signal)?;
                let range = elaborator.bounds(&bounds)?;
                let (least, most) = waveform.bounds();
                if outside.is_none() && range.is_some_and(|(low, high)| least < low || most > high) {
                    outside = Some(((least, most), range.unwrap_or_default()));
                }
                inputs.push(Driven { waveform, range, span: statement.span });
                Ok(())
            });
            if let Some(((least, most), (low, high))) = outside {
                let what = format!("the signal of `{}`, from {least} to {most},", declared.name.text);
                self.warn_outside(declared.name.span, &what, low, high);
            }
        }
        inputs
    }

    /// Runs `action` with the frame of each element; stops at the first fault and reports it.
    fn for_each_element(&mut self, declared: &'a Declared, mut action: impl FnMut(&mut Self) -> Result<(), Fault>) {
        let Some(Symbol::Quantity(number)) = self.names.find(&declared.name.text) else { return };
        let quantity = &self.names.quantities[number];
        if quantity.broken || quantity.name.span != declared.name.span {
            return;
        }
        for offset in 0..quantity.length {
            self.evaluator.frame = self.names.quantities[number].subscripts(offset);
            let done = action(self);
            let element = self.names.quantities[number].name_at(offset);
            let label =
                |error: Diagnostic| error.with_label(declared.name.span, format!("in the definition of `{element}`"));
            if done.is_err() {
                self.settle(done, label);
                return;
            }
        }
    }

    fn bind_bounds(&mut self, within: Option<&'a Range>, binders: &'a [Binder]) -> Option<BoundBounds> {
        let Some(range) = within else { return Some(None) };
        let low = self.bind_element(&range.low, binders, Reads::Constants);
        let high = self.bind_element(&range.high, binders, Reads::Constants);
        Some(Some((low?, high?)))
    }

    fn bounds(&mut self, bounds: &BoundBounds) -> Result<Option<(f64, f64)>, Fault> {
        let Some((low_node, high_node)) = bounds else { return Ok(None) };
        let low = self.evaluator.number(&self.names, low_node, Purpose::Constant)?;
        let high = self.evaluator.number(&self.names, high_node, Purpose::Constant)?;
        if low < high {
            return Ok(Some((low, high)));
        }
        let span = Span { start: low_node.span.start, end: high_node.span.end };
        let message = format!("the range from {low} to {high} holds no interval");
        Err(fault(Diagnostic::error(codes::BAD_BOUNDS, span, message).with_help("give the smaller bound first")))
    }

    fn warn_outside(&mut self, span: Span, what: &str, low: f64, high: f64) {
        let message = format!("{what} lies outside the stated range {low} .. {high}");
        self.report.push(Diagnostic::error(codes::OUTSIDE_BOUNDS, span, message).into_warning());
    }

    fn bind_signal(&mut self, signal: &'a Signal, binders: &'a [Binder]) -> Option<BoundSignal> {
        let (function, arguments, span) = match signal {
            Signal::Value(value) => {
                let value = self.bind_element(value, binders, Reads::Constants)?;
                return Some(BoundSignal { waveform: 0, arguments: vec![(value, 1.0)] });
            }
            Signal::Call { function, arguments, span } => (function, arguments, *span),
        };
        match WAVEFORMS.iter().position(|(name, ..)| *name == function.text) {
            Some(number) => self.bind_waveform(number, arguments, span, binders),
            None => self.bind_function(function, arguments, span, binders),
        }
    }

    fn bind_waveform(
        &mut self,
        number: usize,
        arguments: &'a [Measure],
        span: Span,
        binders: &'a [Binder],
    ) -> Option<BoundSignal> {
        let (waveform, meanings, needed) = WAVEFORMS[number];
        if arguments.len() < needed || arguments.len() > meanings.len() {
            let message =
                format!("`{waveform}` takes {needed} to {} argument(s), found {}", meanings.len(), arguments.len());
            let help = format!("its arguments are {}", meanings.join(", "));
            self.report.push(Diagnostic::error(codes::ARGUMENT_COUNT, span, message).with_help(help));
            return None;
        }
        let mut bound = Vec::with_capacity(arguments.len());
        for (place, (argument, meaning)) in arguments.iter().zip(meanings).enumerate() {
            let units = if place == FREQUENCY { &FREQUENCIES[..] } else { &[] };
            let scale = unit_scale(argument.unit.as_ref(), units, meaning).map_err(|error| self.report.push(error));
            let value = self.bind_element(&argument.value, binders, Reads::Constants);
            if let (Some(value), Ok(scale)) = (value, scale) {
                bound.push((value, scale));
            }
        }
        (bound.len() == arguments.len()).then_some(BoundSignal { waveform: number, arguments: bound })
    }

    /// A lone call that is no waveform: a function of constants, whose value is a constant signal.
    fn bind_function(
        &mut self,
        name: &'a Name,
        arguments: &'a [Measure],
        span: Span,
        binders: &'a [Binder],
    ) -> Option<BoundSignal> {
        let Some(function) = functions::find(&name.text) else {
            let known = WAVEFORMS.iter().map(|(name, ..)| *name).chain(functions::FUNCTIONS.iter().map(|f| f.name));
            let help = suggestion(&name.text, known).unwrap_or_else(|| {
                format!("waveforms are {}", WAVEFORMS.map(|(name, ..)| format!("`{name}`")).join(", "))
            });
            let error = Diagnostic::error(codes::UNKNOWN_FUNCTION, name.span, unknown_function(&name.text));
            self.report.push(error.with_help(help));
            return None;
        };
        let (fewest, most) = function.arguments;
        if arguments.len() < fewest || arguments.len() > most {
            let message = format!("`{}` does not take {} argument(s)", name.text, arguments.len());
            self.report.push(Diagnostic::error(codes::ARGUMENT_COUNT, span, message));
            return None;
        }
        let mut bound = Vec::with_capacity(arguments.len());
        for argument in arguments {
            let unit = unit_scale(argument.unit.as_ref(), &[], "argument").map_err(|error| self.report.push(error));
            let value = self.bind_element(&argument.value, binders, Reads::Constants);
            bound.extend(value.filter(|_| unit.is_ok()));
        }
        let complete = bound.len() == arguments.len();
        let call = Node { kind: NodeKind::Call(function, bound), span };
        complete.then_some(BoundSignal { waveform: 0, arguments: vec![(call, 1.0)] })
    }

    fn waveform(&mut self, signal: &BoundSignal) -> Result<Waveform, Fault> {
        let mut values = Vec::with_capacity(signal.arguments.len());
        for (node, scale) in &signal.arguments {
            let value = scaled(self.evaluator.number(&self.names, node, Purpose::Constant)?, *scale);
            if !value.is_finite() {
                return Err(fault(Diagnostic::error(codes::NOT_FINITE, node.span, "the value is too large")));
            }
            values.push(value);
        }
        let value = |place: usize, default: f64| values.get(place).copied().unwrap_or(default);
        let place = |at: usize| signal.arguments.get(at).map_or_else(Span::default, |(node, _)| node.span);
        let (amplitude, frequency, offset) = (value(0, 0.0), value(FREQUENCY, 0.0), value(2, 0.0));
        if frequency < 0.0 {
            let message = format!("the frequency is {frequency} Hz; it must not be negative");
            return Err(fault(Diagnostic::error(codes::BAD_WAVEFORM, place(FREQUENCY), message)));
        }
        Ok(match WAVEFORMS[signal.waveform].0 {
            "sine" => Waveform::Sine { amplitude, frequency, offset, phase: value(3, 0.0) },
            "square" => {
                let duty = value(3, 0.5);
                if !(0.0..=1.0).contains(&duty) {
                    let message = format!("the duty is {duty}; it is a part of the period, between 0 and 1");
                    return Err(fault(Diagnostic::error(codes::BAD_WAVEFORM, place(3), message)));
                }
                Waveform::Square { amplitude, frequency, offset, duty }
            }
            _ => Waveform::Constant(amplitude),
        })
    }

    /// Whether the spec declares a quantity of this kind, or may do so in a broken statement.
    pub(crate) fn declares(&self, kind: Kind, section: &str) -> bool {
        self.names.quantities.iter().any(|quantity| quantity.kind == kind)
            || self.spec.broken.iter().any(|broken| broken.section == section)
    }
}
