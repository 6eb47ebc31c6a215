//! How well closures are kept, in the report.

use std::fmt;

use pe_judge::residuals::{Largest as Measured, Residual, Residuals};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::values::Unbounded;

/// How well a design keeps the closures of a mechanism, at every step of the span.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Mechanism {
    /// Number of closures.
    pub closures: usize,
    /// The largest magnitude of a closure, which should be zero.
    pub gap: InBoth,
    /// The largest magnitude of a closure's rate, `J w`, per second.
    pub opening: InBoth,
    /// Outputs that should stay constant: those of `--conserved`, and `energy`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub conserved: Vec<Followed>,
}

/// The same of the run in fixed point and of the same steps in double precision.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct InBoth {
    /// In fixed point.
    pub fixed: Largest,
    /// In double precision.
    pub double: Largest,
}

/// The largest magnitude over a run.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Largest {
    /// The magnitude.
    pub size: Unbounded,
    /// The closure.
    pub closure: String,
    /// Time in seconds.
    pub time_s: f64,
}

/// A quantity that should stay constant.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Followed {
    /// The output.
    pub name: String,
    /// Its value at time zero.
    pub initial: f64,
    /// Largest distance from it in fixed point, in its unit.
    pub fixed: Unbounded,
    /// The same in double precision.
    pub double: Unbounded,
}

impl Mechanism {
    /// The residuals of a design.
    pub fn of(residuals: &Residuals) -> Mechanism {
        let largest = |measured: &Measured| Largest {
            size: measured.size.into(),
            closure: residuals.closures.get(measured.closure).cloned().unwrap_or_default(),
            time_s: measured.time,
        };
        let both = |of: &dyn Fn(&Residual) -> &Measured| InBoth {
            fixed: largest(of(&residuals.fixed)),
            double: largest(of(&residuals.double)),
        };
        let drifts = residuals.fixed.drifts.iter().zip(&residuals.double.drifts);
        let conserved = residuals.conserved.iter().zip(drifts).map(|((name, initial), (fixed, double))| Followed {
            name: name.clone(),
            initial: *initial,
            fixed: (*fixed).into(),
            double: (*double).into(),
        });
        Mechanism {
            closures: residuals.closures.len(),
            gap: both(&|residual| &residual.gap),
            opening: both(&|residual| &residual.opening),
            conserved: conserved.collect(),
        }
    }
}

impl fmt::Display for Unbounded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Unbounded::Number(number) => write!(f, "{number:.1e}"),
            Unbounded::Word(word) => f.write_str(word),
        }
    }
}

impl fmt::Display for Mechanism {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Mechanism { gap, opening, conserved, .. } = self;
        write!(
            f,
            "at most {} open (`{}`), {} in double precision; ",
            gap.fixed.size, gap.fixed.closure, gap.double.size
        )?;
        write!(f, "rates {} and {} per second", opening.fixed.size, opening.double.size)?;
        for Followed { name, fixed, double, .. } in conserved {
            write!(f, "; `{name}` drifts by {fixed} and {double}")?;
        }
        Ok(())
    }
}
