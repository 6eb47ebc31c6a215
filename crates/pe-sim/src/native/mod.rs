//! A step graph as a program for the computer at hand: what a programmer who knows the model's structure would write.
//!
//! Equations of array elements become loops over rows, with coefficients as numbers where they are the same in all
//! elements and as rows where not; what is left over is written out, or listed if it is much. The result is source text
//! in front of which the type of numbers `R` is to be declared and behind which the fixed part is to be put
//! (`templates/native.rs`), and the tables that the program reads.

mod assemble;
mod fuse;
mod layout;
mod loops;
mod order;
mod source;
mod work;

use pe_ir::graph::StepGraph;
use pe_ir::model::Model;

use layout::Layout;
use order::Order;
pub use work::{Program, Work};

/// Writes a step graph as a program.
pub fn program(model: &Model, graph: &StepGraph) -> Program {
    let orders = [Some(Order::declared(graph)), Order::of_tree(model, graph), Order::of_grid(graph)];
    let layouts = orders.into_iter().flatten().map(|order| Layout::new(graph, &order));
    let cost = |layout: &Layout| layout.arranged.cost(|chain| layout.chains[chain].terms.len());
    assemble::program(graph, &layouts.min_by_key(cost).expect("there is the declared order"))
}
