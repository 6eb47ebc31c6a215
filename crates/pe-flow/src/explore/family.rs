//! Points of a sweep, sorted by what they share.

use std::sync::{Arc, OnceLock};

use pe_ir::model::Model;
use pe_judge::total::Reference;
use pe_judge::{Coefficients, DesignPoint, FormChoice};
use pe_sim::reference::ReferenceError;

/// A point to be compiled.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its place in the sweep.
    pub index: usize,
    /// The point.
    pub point: DesignPoint,
    /// The command that compiles it alone.
    pub command: String,
}

/// Points with the same step graph.
pub struct Family {
    /// The solution that its points are compared with; families that are compared at the same times share it.
    pub reference: Arc<OnceLock<Result<Reference, ReferenceError>>>,
    /// Points with the same formats; none of the lists is empty.
    pub formats: Vec<Vec<Job>>,
}

/// Whether a model has functions of variables.
fn has_functions(model: &Model) -> bool {
    model.algebraics.iter().any(|algebraic| !algebraic.expr.is_polynomial())
}

/// Sorts jobs by what they share; with functions, whose tables depend on the multiplier's ports, these as well, and with
/// events, which each method finds in steps of its own, solutions by methods.
pub fn families(jobs: Vec<Job>, model: &Model) -> Vec<Family> {
    let mut families: Vec<Family> = Vec::new();
    let (functions, events) = (has_functions(model), model.has_jumps());
    let same_tables = |a: &DesignPoint, b: &DesignPoint| !functions || a.multiplier == b.multiplier;
    let same_times = |a: &DesignPoint, b: &DesignPoint| {
        a.step == b.step && a.early_steps == b.early_steps && (!events || a.solver == b.solver)
    };
    // Stages that are sums want coefficients in one slot.
    let one_slot = |point: &DesignPoint| point.coefficients == Coefficients::OneSlot;
    let same_form = |a: &DesignPoint, b: &DesignPoint| {
        a.form == b.form && (a.form != FormChoice::Sums || one_slot(a) == one_slot(b))
    };
    let same_step = |a: &DesignPoint, b: &DesignPoint| a.solver == b.solver && same_times(a, b) && same_form(a, b);
    let same_graph = |a: &DesignPoint, b: &DesignPoint| same_step(a, b) && same_tables(a, b);
    let same_format = |a: &DesignPoint, b: &DesignPoint| {
        (a.multiplier, a.storage, a.coefficients) == (b.multiplier, b.storage, b.coefficients)
    };
    for job in jobs {
        let family = match families.iter().position(|family| same_graph(&family.formats[0][0].point, &job.point)) {
            Some(index) => &mut families[index],
            None => {
                let alike = families.iter().find(|family| same_times(&family.formats[0][0].point, &job.point));
                let reference = alike.map_or_else(Arc::default, |family| Arc::clone(&family.reference));
                families.push(Family { reference, formats: vec![vec![job]] });
                continue;
            }
        };
        match family.formats.iter().position(|format| same_format(&format[0].point, &job.point)) {
            Some(index) => family.formats[index].push(job),
            None => family.formats.push(vec![job]),
        }
    }
    families
}
