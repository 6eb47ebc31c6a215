//! Models with hubs: states and an algebraic variable that all units read, with coefficients that follow a seed.

use pe_frontend::{NoFiles, Overrides};
use pe_ir::model::Model;
use pe_ir::source::Sources;

/// A model of so many units on four hubs, one of which is algebraic.
pub fn hub_model(units: u32, solver: &str, seed: u64) -> Model {
    let mut sources = Sources::new("hubs.spec", &hub_spec(units, solver, seed));
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default());
    compiled.unwrap_or_else(|findings| panic!("{findings:?}")).0
}

/// Its spec.
pub fn hub_spec(units: u32, solver: &str, seed: u64) -> String {
    format!(
        "
model hubs
solver {solver}
step 1 ms
span 100 ms
const n = {units}
index i in 1..n
input u = sine(1, 3 Hz)
state a = 0.3
state b = -0.2
state c = 0.1
state x[i] = 0.2*sin({seed} + i)
p = a*b*c + 0.5*a*b - 0.3*c^2 + 0.2*a*c
a' = -2*a + 0.5*b*c + sum(j in 1..n: 0.1*sin({seed}*j)*x[j]) + u
b' = -3*b + 0.4*a + sum(j in 1..n: 0.1*cos({seed}*j)*x[j])
c' = -c + 0.2*a*b + sum(j in 1..n: 0.1*sin({seed} + 3*j)*x[j])
x[i]' = -(4 + sin({seed}*i))*x[i] + cos(i)*a + sin(i)*b*x[i] - 0.5*cos({seed} - i)*c + 0.7*p
output a, x[1], x[n]
"
    )
}
