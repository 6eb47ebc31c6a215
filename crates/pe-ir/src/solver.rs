//! The numerical methods.

/// A numerical method that advances the model by one step of fixed length `h`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solver {
    /// Explicit Euler, `y+ = y + h f(y)`.
    Euler,
    /// Heun's second-order method, the explicit trapezoidal rule.
    Heun,
    /// Heun's third-order method.
    Heun3,
    /// Classic fourth-order Runge-Kutta.
    Rk4,
    /// Velocities first, then positions with the new velocities.
    SymplecticEuler,
    /// Half a step of the positions, a step of the velocities, half a step of the positions.
    Leapfrog,
    /// Adams-Bashforth of second order: a linear combination of the last two slopes.
    Ab2,
    /// Adams-Bashforth of third order.
    Ab3,
    /// Adams-Bashforth of fourth order.
    Ab4,
    /// Runge-Kutta-Chebyshev of second order in 5 stages, stable far along the negative real axis.
    Rkc5,
    /// The same in 10 stages.
    Rkc10,
    /// One linearly implicit iteration of backward Euler.
    ImplicitEuler,
    /// The trapezoidal rule with two Newton iterations.
    Trapezoidal,
    /// Rosenbrock's method of second order in two stages, L-stable.
    Ros2,
    /// Rosenbrock's method of third order in four stages, L-stable and stiffly accurate.
    Rodas3,
    /// Rush and Larsen's method: gates of a cell by exponentials, other states by Euler's method.
    RushLarsen,
    /// The matrix exponential of a linear model.
    Exact,
}

impl Solver {
    /// All methods.
    pub const ALL: [Solver; 17] = [
        Solver::Euler,
        Solver::Heun,
        Solver::Heun3,
        Solver::Rk4,
        Solver::SymplecticEuler,
        Solver::Leapfrog,
        Solver::Ab2,
        Solver::Ab3,
        Solver::Ab4,
        Solver::Rkc5,
        Solver::Rkc10,
        Solver::ImplicitEuler,
        Solver::Trapezoidal,
        Solver::Ros2,
        Solver::Rodas3,
        Solver::RushLarsen,
        Solver::Exact,
    ];

    /// The explicit Runge-Kutta methods with as many stages as their order; every model has a step of each.
    pub const RUNGE_KUTTA: [Solver; 4] = [Solver::Euler, Solver::Heun, Solver::Heun3, Solver::Rk4];

    /// Whether it takes a list of steps: the step stands in the diagonal of a matrix, so that an input can change it.
    pub fn takes_lists(self) -> bool {
        matches!(self, Solver::ImplicitEuler | Solver::Trapezoidal | Solver::Ros2 | Solver::Rodas3)
    }

    /// The name used in the spec, on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Solver::Euler => "euler",
            Solver::Heun => "heun",
            Solver::Heun3 => "heun3",
            Solver::Rk4 => "rk4",
            Solver::SymplecticEuler => "symplectic_euler",
            Solver::Leapfrog => "leapfrog",
            Solver::Ab2 => "ab2",
            Solver::Ab3 => "ab3",
            Solver::Ab4 => "ab4",
            Solver::Rkc5 => "rkc5",
            Solver::Rkc10 => "rkc10",
            Solver::ImplicitEuler => "implicit_euler",
            Solver::Trapezoidal => "trapezoidal",
            Solver::Ros2 => "ros2",
            Solver::Rodas3 => "rodas3",
            Solver::RushLarsen => "rush_larsen",
            Solver::Exact => "exact",
        }
    }

    /// What it is called in full.
    pub fn title(self) -> &'static str {
        match self {
            Solver::Euler => "explicit Euler",
            Solver::Heun => "Heun's method of second order",
            Solver::Heun3 => "Heun's method of third order",
            Solver::Rk4 => "classic Runge-Kutta of fourth order",
            Solver::SymplecticEuler => "symplectic Euler, for models of positions and velocities",
            Solver::Leapfrog => "leapfrog of second order, for models of positions and velocities",
            Solver::Ab2 => "Adams-Bashforth of second order",
            Solver::Ab3 => "Adams-Bashforth of third order",
            Solver::Ab4 => "Adams-Bashforth of fourth order",
            Solver::Rkc5 => "Runge-Kutta-Chebyshev of second order, 5 stages, for diffusion",
            Solver::Rkc10 => "Runge-Kutta-Chebyshev of second order, 10 stages, for diffusion",
            Solver::ImplicitEuler => "linearly implicit Euler, for stiff models",
            Solver::Trapezoidal => "trapezoidal rule with two Newton iterations",
            Solver::Ros2 => "Rosenbrock's method of second order, for stiff models",
            Solver::Rodas3 => "Rosenbrock's method of third order, for stiff models",
            Solver::RushLarsen => "Rush and Larsen's method, for gates of cell models",
            Solver::Exact => "matrix exponential, for linear models",
        }
    }

    /// Whether inputs are part of what the method approximates with its order: it reads them at the times of its slopes
    /// only. Other methods of higher order hold them over the stages of a step.
    pub fn covers_inputs(self) -> bool {
        matches!(self, Solver::Ab2 | Solver::Ab3 | Solver::Ab4)
    }

    /// Order of the global error in the step size. `exact` has no such error; the order that stands for it is high
    /// enough that extrapolating the difference of two steps changes nothing.
    pub fn order(self) -> u32 {
        match self {
            Solver::Euler | Solver::SymplecticEuler | Solver::ImplicitEuler | Solver::RushLarsen => 1,
            Solver::Heun | Solver::Leapfrog | Solver::Ab2 | Solver::Rkc5 | Solver::Rkc10 => 2,
            Solver::Trapezoidal | Solver::Ros2 => 2,
            Solver::Heun3 | Solver::Ab3 | Solver::Rodas3 => 3,
            Solver::Rk4 | Solver::Ab4 => 4,
            Solver::Exact => 16,
        }
    }

    /// Evaluations of the right-hand side per step.
    pub fn stages(self) -> u32 {
        match self {
            Solver::Euler | Solver::SymplecticEuler | Solver::Leapfrog | Solver::Exact => 1,
            Solver::Ab2 | Solver::Ab3 | Solver::Ab4 | Solver::ImplicitEuler | Solver::RushLarsen => 1,
            Solver::Heun | Solver::Trapezoidal | Solver::Ros2 => 2,
            Solver::Heun3 | Solver::Rodas3 => 3,
            Solver::Rk4 => 4,
            Solver::Rkc5 => 5,
            Solver::Rkc10 => 10,
        }
    }
}
