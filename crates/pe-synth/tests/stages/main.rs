//! The stages of the compiler through the library: random models, checkers, errors, formats, engines.

#![allow(clippy::disallowed_methods, reason = "the tests' own numbers may come from the standard library")]

#[path = "../support/mod.rs"]
mod support;
#[path = "../support/validation.rs"]
mod validation_set;

mod angles;
mod arithmetic;
mod check;
mod check_limits;
mod checkers;
mod contradictions;
mod counted;
mod delays;
mod events;
mod every_step;
mod every_step_nonlinear;
mod extremes;
mod faults;
mod full_size;
mod functions;
mod ghdl;
mod goals;
mod grids;
mod headroom;
mod inputs;
mod library;
mod mechanisms;
mod methods;
mod noise;
mod pairs;
mod parts;
mod pictures;
mod priorities;
mod random_models;
mod ranges;
mod reasons;
mod relay;
mod rings;
mod rounded;
mod rounding;
mod routes;
mod sampled;
mod scene;
mod signals;
mod slots;
mod solvers;
mod split;
mod step_error;
mod sums;
mod systems;
mod tables;
mod texts;
mod total_error;
mod turning;
mod unit_of_time;
mod validation;
mod variants;
mod verilator;
