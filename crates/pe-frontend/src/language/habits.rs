//! Words of other languages, and how the same is written here.

/// Functions of other languages: their names, and what is written here instead.
const FUNCTIONS: &[(&[&str], &str)] = &[
    (&["ln", "loge"], "the natural logarithm is `log(x)`"),
    (&["lg", "log_10"], "the logarithm to base 10 is `log10(x)`"),
    (&["log1p"], "write `log(1 + x)`"),
    (&["expm1"], "write `exp(x) - 1`"),
    (&["exp2", "pow2"], "write `2^x`"),
    (&["pow", "power", "Pow", "Power"], "a power is written `x^2`"),
    (&["sqr", "square_of"], "a square is written `x^2`"),
    (&["cbrt"], "write `sign(x)*abs(x)^(1/3)`, or `x^(1/3)` where `x` stays positive"),
    (&["hypot"], "write `sqrt(x^2 + y^2)`"),
    (
        &["atan2", "arctan2"],
        "no function takes the angle of two numbers: while `x` stays positive it is `atan(y/x)`; or let the angle be a state",
    ),
    (&["arctan"], "write `atan(x)`"),
    (&["arcsin"], "write `asin(x)`"),
    (&["arccos"], "write `acos(x)`"),
    (&["asinh", "arcsinh"], "write `log(x + sqrt(x^2 + 1))`"),
    (&["acosh", "arccosh"], "write `log(x + sqrt(x^2 - 1))`"),
    (&["atanh", "arctanh"], "write `0.5*log((1 + x)/(1 - x))`"),
    (&["sec"], "write `1/cos(x)`"),
    (&["csc"], "write `1/sin(x)`"),
    (&["cot"], "write `1/tan(x)`"),
    (&["sech"], "write `1/cosh(x)`"),
    (&["coth"], "write `1/tanh(x)`"),
    (&["sinc"], "write `sin(x)/x`"),
    (&["fabs", "Abs", "fabsf", "absolute"], "write `abs(x)`"),
    (&["sgn", "signum"], "write `sign(x)`"),
    (&["fmin", "fminf", "minimum", "amin"], "write `min(x, y)`"),
    (&["fmax", "fmaxf", "maximum", "amax"], "write `max(x, y)`"),
    (
        &["clamp", "clip", "sat", "saturate", "saturation", "constrain", "limit", "limiter", "bound"],
        "write `min(max(x, lo), hi)`",
    ),
    (&["deadzone", "dead_zone"], "write `x - min(max(x, lo), hi)`"),
    (&["relu"], "write `max(x, 0)`"),
    (&["sigmoid", "logistic"], "write `1/(1 + exp(-x))`"),
    (&["fmod", "rem", "remainder", "fmodf"], "write `mod(x, y)`"),
    (&["trunc", "fix", "integer", "int"], "round with `floor(x)`, `ceil(x)` or `round(x)`"),
    (
        &["heaviside", "Heaviside", "unitstep", "unit_step", "stp"],
        "write `if x >= 0 then 1 else 0`; as a signal `pulse(1, 0.5 s, 1e9 s)`, a pulse that outlasts the run",
    ),
    (
        &["piecewise", "Piecewise", "ifelse", "ifthenelse", "IfThenElse", "iif", "cond", "select", "merge"],
        "write `if c then a else b`; several choices chain: `if c then a else if d then b else e`",
    ),
    (&["gt", "lt", "geq", "leq", "neq"], "compare with `>`, `<`, `>=`, `<=`, `==` and `!=`"),
    (
        &["der", "ddt", "diff", "Derivative", "derivative", "deriv"],
        "a derivative is written `x' = ...`, alone on the left; to read it elsewhere, name its right-hand side: `a = ...`, `x' = a`",
    ),
    (&["integral", "integrate", "idt", "integ", "INTEG"], "an integral is a state: `state y = 0`, `y' = x`"),
    (
        &["edge", "reinit", "pre", "rising", "impulse"],
        "an event gives states new values: `when x > 1 { x = 0 }`, on the right with the values before it",
    ),
    (
        &["delay", "transport_delay", "delay1", "delay3", "DELAY"],
        "there is no such function; a value of the past is a state, in a block `every 1 ms { ... }` or as a chain of lags",
    ),
    (
        &["interp1", "interp", "interpolate", "lookup", "table", "spline", "CombiTable1D"],
        "samples over time come from a file: `samples(\"file.csv\", \"column\", linear)`; a curve over a variable is a function, or `if` choices of straight lines",
    ),
    (
        &["rand", "random", "randn", "noise", "normal", "uniform"],
        "nothing here is random; play a recorded signal: `samples(\"file.csv\", \"column\", hold)`",
    ),
    (&["sin_wave", "sinewave", "sinusoid"], "a signal is `sine(amplitude, 50 Hz)`"),
    (&["inv", "inverse", "pinv", "linsolve", "mldivide"], "solve the system instead: `x = solve(T, b)`"),
    (&["norm"], "write `sqrt(dot(x, x))`"),
    (&["prod", "product"], "there is no product over an index; write the factors out"),
    (
        &["zeros", "ones", "eye", "linspace", "arange", "array", "matrix"],
        "an array has indices: `state x[i in 1..5] = 0`, its value may read them",
    ),
    (&["radians", "deg2rad"], "write `x*pi/180`"),
    (&["degrees", "rad2deg"], "write `x*180/pi`"),
];

/// First words of statements of other languages, and what is written here instead.
const STATEMENTS: &[(&[&str], &str)] = &[
    (&["parameter", "parameters", "par", "params", "p", "constant"], "a parameter is written `param k = 1`"),
    (
        &["var", "variable", "Real", "real", "double", "float", "let", "species", "auto", "number", "Var"],
        "a state is written `state x = 0`; what an equation without a prime defines needs no declaration",
    ),
    (&["init", "initial", "ic", "start"], "an initial value stands in the declaration: `state x = 1`"),
    (
        &["equation", "equations", "algorithm", "begin", "end", "code", "endmodel", "done"],
        "there are no sections: equations stand among the declarations, in any order",
    ),
    (&["def", "func", "fun", "define"], "a function is written `function f(x) = x^2`"),
    (&["import", "using", "from", "use", "load"], "another spec is inserted by `include \"file.spec\"`"),
    (&["print", "plot", "return", "display", "disp", "printf", "observe"], "what is shown is named by `output x`"),
    (&["while", "repeat", "loop"], "there are no loops: an equation of an array holds for all of its indices"),
    (&["dt", "tstep", "stepsize", "timestep"], "the step is written `step 1 ms`"),
    (
        &["tstop", "tend", "duration", "stop", "tspan", "t_end"],
        "the time that runs are judged over is written `span 2 s`",
    ),
    (&["method", "integrator", "ode"], "the method is written `solver rk4`"),
    (&["unit"], "units are checked by `units strict`; a unit stands behind its name: `param m [kg] = 1`"),
    (&["name", "title", "system", "block", "class", "package", "module"], "a spec begins with `model NAME \"title\"`"),
];

/// Methods that choose their steps themselves, and other names of methods, with what there is here.
const SOLVERS: &[(&[&str], &str)] = &[
    (
        &["rk45", "rkf45", "ode45", "ode23", "dopri5", "dop853", "tsit5", "cash_karp", "dp5", "rk23", "RK45"],
        "steps are fixed, there is no control of the step; take `rk4`",
    ),
    (
        &[
            "cvode", "lsoda", "lsode", "bdf", "ode15s", "ode23s", "ode23t", "radau", "dassl", "ida", "gear", "rodas",
            "rodas4", "vode", "BDF", "LSODA",
        ],
        "steps are fixed, there is no control of the step; for stiff models take `rodas3`, `ros2` or `implicit_euler`",
    ),
    (&["forward_euler", "explicit_euler", "fe", "Euler"], "take `euler`"),
    (&["backward_euler", "be", "beuler"], "take `implicit_euler`"),
    (&["crank_nicolson", "cn", "tustin", "trapezoid", "trap"], "take `trapezoidal`"),
    (&["rk2", "midpoint", "ralston"], "take `heun`, of the same order"),
    (&["rk", "runge_kutta", "rungekutta", "RK4"], "take `rk4`"),
    (&["verlet", "velocity_verlet", "stormer_verlet"], "take `leapfrog`"),
    (&["adams", "adams_bashforth"], "take `ab2`, `ab3` or `ab4`"),
];

fn find(table: &[(&'static [&'static str], &'static str)], word: &str) -> Option<&'static str> {
    table.iter().find(|(words, _)| words.contains(&word)).map(|(_, help)| *help)
}

/// How a function of another language is written.
pub(crate) fn function(name: &str) -> Option<&'static str> {
    find(FUNCTIONS, name)
}

/// How a statement that begins with this word is written.
pub(crate) fn statement(word: &str) -> Option<&'static str> {
    find(STATEMENTS, word)
}

/// What there is in place of a numerical method.
pub(crate) fn solver(name: &str) -> Option<&'static str> {
    find(SOLVERS, name)
}

/// Names that other languages give to the derivative of `state`.
pub(crate) fn derivative_names(state: &str) -> [String; 9] {
    [
        format!("{state}dot"),
        format!("{state}_dot"),
        format!("d{state}"),
        format!("d{state}dt"),
        format!("d{state}_dt"),
        format!("d_{state}"),
        format!("D{state}"),
        format!("der_{state}"),
        format!("{state}_prime"),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::language::functions;
    use crate::language::waveforms::WAVEFORMS;
    use crate::language::words::OF_ARRAYS;
    use crate::syntax::lexer::is_keyword;
    use pe_ir::model::Solver;

    #[test]
    fn words_of_others_are_none_of_ours_and_occur_once() {
        let ours = |word: &str| {
            functions::find(word).is_some()
                || WAVEFORMS.iter().any(|(name, ..)| *name == word)
                || OF_ARRAYS.iter().any(|(name, _)| *name == word)
        };
        for table in [FUNCTIONS, STATEMENTS, SOLVERS] {
            let words: Vec<&str> = table.iter().flat_map(|(words, _)| words.iter().copied()).collect();
            for (at, word) in words.iter().enumerate() {
                assert!(!words[..at].contains(word), "{word} twice");
            }
        }
        assert!(FUNCTIONS.iter().flat_map(|(words, _)| *words).all(|word| !ours(word)));
        assert!(STATEMENTS.iter().flat_map(|(words, _)| *words).all(|word| !is_keyword(word)));
        let solver = |word: &&str| Solver::ALL.iter().any(|solver| solver.name() == *word);
        assert!(!SOLVERS.iter().flat_map(|(words, _)| *words).any(solver));
    }
}
