#!/usr/bin/env python3
"""Writes reference solutions of the validation models: models/validation/reference/NAME.csv.

    python3 -m venv VENV && VENV/bin/pip install numpy==2.4.6 scipy==1.17.1
    VENV/bin/python models/validation/reference.py [NAME...]

The right-hand sides are written out here a second time, by hand and from the sources that README.md names, so that a
mistake in a spec shows. Every model is solved by two methods of scipy at tight tolerance. What differs between them at
the times of the file is printed, relative to the largest magnitude of the state, and may be LIMIT at most; so is the
difference to published values. A file has a row with the largest magnitudes over the span and one for each time.
"""

import math
import os
import sys

import numpy as np
from scipy import signal
from scipy.integrate import solve_ivp

# The two solutions agree to this part of a state's largest magnitude, unless a case says that its own sensitivity
# forbids it.
LIMIT = 1e-10
ROWS = 20
# Rows of a file whose times follow the solution: as many spread evenly, and as many where the solver's steps are short.
DENSE = 120
FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "reference")
CASES = {}


class Case:
    """A model: right-hand side, names and initial values of the states, end of the span."""

    def __init__(self, f, names, start, end, methods, published, limit, finest, jumps, period, sample, grid):
        self.grid = grid
        self.f, self.names, self.start, self.end = f, names, np.array(start, float), end
        self.methods, self.published, self.limit, self.finest, self.jumps = methods, published, limit, finest, jumps
        self.period, self.sample = period, sample


def case(name, names, start, end, methods=("DOP853", "LSODA"), published=None, limit=LIMIT, finest=1e-13,
         jumps=(), period=None, sample=None, grid=None):
    """Registers a right-hand side `f(t, y)`, which jumps at `jumps`. `published` is (time, values, relative tolerance).
    With `grid`, the step of the spec, the times of the file follow the solution: multiples of the grid that are dense
    where it is fast.

    At all multiples of `period` the states become `sample(y)`; what is sampled only has the derivative 0."""

    def register(f):
        CASES[name] = Case(f, names.split() if isinstance(names, str) else names, start, end, methods, published,
                           limit, finest, jumps, period, sample, grid)
        return f

    return register


def solve(case, method, times):
    """The states at the times, one row each, and their largest magnitudes over all steps of the solver."""
    size = np.abs(case.start)
    size = np.maximum(size, 1e-3 * np.max(size)) if np.max(size) > 0 else np.ones(len(size))
    atol = 1e-3 * case.finest * np.minimum(size, 1.0)
    state, largest, rows = case.start, np.abs(case.start), []
    bounds = [0, *case.jumps, times[-1]]
    if case.period:
        bounds = [case.period * number for number in range(round(times[-1] / case.period))] + [times[-1]]
    for start, end in zip(bounds, bounds[1:]):
        if case.sample:
            state = np.array(case.sample(state), float)
        # The last stage of the last step must not see what comes after the jump.
        before = np.nextafter(end, start)
        result = solve_ivp(lambda t, y: case.f(min(t, before), y), (start, end), state, method, rtol=case.finest,
                           atol=atol, dense_output=True)
        if not result.success:
            raise SystemExit(f"{method}: {result.message}")
        wanted = times[(times > start * (1 + 1e-12)) & (times <= end * (1 + 1e-12))]
        if len(wanted):
            rows.append(result.sol(wanted).T)
        state, largest = result.y[:, -1], np.maximum(largest, np.max(np.abs(result.y), axis=1))
    return np.concatenate(rows), largest


def following(case):
    """Multiples of the grid that follow the solution: the first steps, as many where it is fast, as many evenly."""
    steps = round(case.end / case.grid)
    result = solve_ivp(case.f, (0, case.end), case.start, case.methods[0], rtol=1e-6,
                       atol=1e-9 * np.maximum(np.abs(case.start), 1e-3 * np.max(np.abs(case.start)) + 1e-12))
    fast = np.interp(np.linspace(0, 1, DENSE), np.linspace(0, 1, len(result.t)), result.t) / case.grid
    wanted = np.concatenate([np.arange(1, 11), np.linspace(1, steps, DENSE), fast])
    numbers = np.unique(np.clip(np.rint(wanted), 1, steps)).astype(int)
    return case.end * numbers / steps


# --- not stiff: DETEST (Hull, Enright, Fellen, Sedgwick 1972) -------------------------------------------------------

case("detest_a1", "y", [1], 20)(lambda t, y: [-y[0]])
case("detest_a2", "y", [1], 20)(lambda t, y: [-(y[0] ** 3) / 2])
case("detest_a3", "c s y", [1, 0, 1], 20)(lambda t, y: [-y[1], y[0], y[2] * math.cos(t)])
case("detest_a4", "y", [1], 20)(lambda t, y: [y[0] / 4 * (1 - y[0] / 20)])
case("detest_a5", "t y", [0, 4], 20)(lambda t, y: [1, (y[1] - t) / (y[1] + t)])
case("detest_b1", "prey predator", [1, 3], 20)(
    lambda t, y: [2 * (y[0] - y[0] * y[1]), -(y[1] - y[0] * y[1])])
case("detest_b2", "a b c", [2, 0, 1], 20)(lambda t, y: [-y[0] + y[1], y[0] - 2 * y[1] + y[2], y[1] - y[2]])
case("detest_b3", "a b c", [1, 0, 0], 20)(lambda t, y: [-y[0], y[0] - y[1] ** 2, y[1] ** 2])
case("detest_b5", "x y z", [0, 1, 1], 20, ("DOP853", "Radau"))(lambda t, y: [y[1] * y[2], -y[0] * y[2], -0.51 * y[0] * y[1]])


@case("detest_b4", "x y z", [3, 0, 0], 20)
def detest_b4(t, y):
    r = math.hypot(y[0], y[1])
    return [-y[1] - y[0] * y[2] / r, y[0] - y[1] * y[2] / r, y[0] / r]


def numbered(name, count, first=1):
    """Names of the elements of an array."""
    return [f"{name}[{k}]" for k in range(first, first + count)]


@case("detest_c1", numbered("y", 10), [1] + [0] * 9, 20)
def detest_c1(t, y):
    out = np.append(y[:-1], 0)
    return np.append(0, y[:-1]) - out


@case("detest_c3", numbered("y", 10), [1] + [0] * 9, 20)
def detest_c3(t, y):
    return np.append(0, y[:-1]) - 2 * y + np.append(y[1:], 0)


def kepler(t, y):
    r3 = math.hypot(y[0], y[1]) ** 3
    return [y[2], y[3], -y[0] / r3, -y[1] / r3]


def orbit(e, t):
    """Position and velocity at time t by Kepler's equation, as an independent check of the orbits."""
    a = t
    for _ in range(200):
        a -= (a - e * math.sin(a) - t) / (1 - e * math.cos(a))
    root = math.sqrt(1 - e * e)
    speed = 1 / (1 - e * math.cos(a))
    return [math.cos(a) - e, root * math.sin(a), -speed * math.sin(a), speed * root * math.cos(a)]


for at, e in enumerate([0.1, 0.3, 0.5, 0.7, 0.9]):
    case(f"detest_d{at + 1}", "x y u v", [1 - e, 0, 0, math.sqrt((1 + e) / (1 - e))], 20, ("DOP853", "Radau"),
         published=(20, orbit(e, 20), 1e-9))(kepler)

case("detest_e2", "x v", [2, 0], 20)(lambda t, y: [y[1], (1 - y[0] ** 2) * y[1] - y[0]])

# --- not stiff: others ----------------------------------------------------------------------------------------------

case("lorenz", "x y z", [1, 1, 1], 5)(
    lambda t, y: [10 * (y[1] - y[0]), y[0] * (28 - y[2]) - y[1], y[0] * y[1] - 8 / 3 * y[2]])
# Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.4: values at t = 20.
case("brusselator", "x y", [1.5, 3], 40,
     published=(20, [0.4986370712683478291402659846476, 4.596780349452011024598321237263], 1e-10))(
    lambda t, y: [1 + y[0] ** 2 * y[1] - 4 * y[0], 3 * y[0] - y[0] ** 2 * y[1]])


@case("fhn_cube", numbered("v", 27, 0) + numbered("w", 27, 0), [-1.2] * 27 + [-0.62] * 27, 100)
def fhn_cube(t, y):
    v, w = y[:27].reshape(3, 3, 3), y[27:].reshape(3, 3, 3)
    # Mirrored edges: no current leaves the cube.
    padded = np.pad(v, 1, mode="edge")
    coupling = -6 * v
    for axis in range(3):
        for shift in (0, 2):
            part = [slice(1, 4)] * 3
            part[axis] = slice(shift, shift + 3)
            coupling = coupling + padded[tuple(part)]
    drive = np.zeros((3, 3, 3))
    drive[0, 0, 0] = 0.5
    dv = v - v ** 3 / 3 - w + drive + 0.1 * coupling
    dw = 0.08 * (v + 0.7 - 0.8 * w)
    return np.concatenate([dv.ravel(), dw.ravel()])


# Szebehely 1967; Hairer, Norsett, Wanner I, section II.0: the orbit closes after 17.0652165601579625588917206249.
MOON = 0.012277471


@case("arenstorf", "x y u v", [0.994, 0, 0, -2.00158510637908252240537862224], 17.06, ("DOP853", "LSODA"),
      published=(17.0652165601579625588917206249, [0.994, None, None, None], 1e-6), limit=1e-6)
def arenstorf(t, y):
    d1 = ((y[0] + MOON) ** 2 + y[1] ** 2) ** 1.5
    d2 = ((y[0] - 1 + MOON) ** 2 + y[1] ** 2) ** 1.5
    return [y[2], y[3], y[0] + 2 * y[3] - (1 - MOON) * (y[0] + MOON) / d1 - MOON * (y[0] - 1 + MOON) / d2,
            y[1] - 2 * y[2] - (1 - MOON) * y[1] / d1 - MOON * y[1] / d2]


# --- stiff ----------------------------------------------------------------------------------------------------------

ROBERTSON = lambda t, y: [-0.04 * y[0] + 1e4 * y[1] * y[2], 0.04 * y[0] - 1e4 * y[1] * y[2] - 3e7 * y[1] ** 2,
                          3e7 * y[1] ** 2]
# The values at t = 40 are those of the example of CVODE (Hindmarsh and others, ACM TOMS 31, 2005), five digits.
case("robertson", "a b c", [1, 0, 0], 40, ("DOP853", "LSODA"),
     published=(40, [7.1583e-01, 9.1855e-06, 2.8416e-01], 2e-5))(ROBERTSON)
# The same in two parts, which want steps of their own: up to 0.4 s, and from there on.
case("robertson_start", "a b c", [1, 0, 0], 0.4)(ROBERTSON)
case("robertson_rest", "a b c", [0.985172113861, 3.386395378975e-5, 0.01479402218522], 40, finest=1e-12)(ROBERTSON)
case("van_der_pol_10", "x v", [2, 0], 40, ("DOP853", "Radau"))(lambda t, y: [y[1], 10 * (1 - y[0] ** 2) * y[1] - y[0]])
# Test Set for IVP Solvers, release 2.4, problem VDPOL: t = 2 there is t = 2000 here, and velocities are per 1000.
case("van_der_pol_1000", "x v", [2, 0], 2000, ("Radau", "LSODA"), limit=1e-6,
     published=(2000, [1.706167732170483, -0.8928097010247975e-3], 1e-7))(
    lambda t, y: [y[1], 1000 * (1 - y[0] ** 2) * y[1] - y[0]])


# Test Set for IVP Solvers, release 2.4, problem HIRES, values at t = 321.8122.
@case("hires", numbered("y", 8), [1, 0, 0, 0, 0, 0, 0, 0.0057], 321.8, ("DOP853", "LSODA"), published=(321.8122, [
    0.7371312573325668e-3, 0.1442485726316185e-3, 0.5888729740967575e-4, 0.1175651343283149e-2,
    0.2386356198831331e-2, 0.6238968252742796e-2, 0.2849998395185769e-2, 0.2850001604814231e-2], 1e-9))
def hires(t, y):
    fast = 280 * y[5] * y[7]
    return [-1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
            1.71 * y[0] - 8.75 * y[1],
            -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
            8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
            -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
            -fast + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
            fast - 1.81 * y[6],
            -fast + 1.81 * y[6]]


# Test Set for IVP Solvers, release 2.4, problem OREGO, values at t = 360.
case("orego", "x y z", [1, 2, 3], 360, ("Radau", "LSODA"), limit=1e-7,
     published=(360, [0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3], 1e-7))(
    lambda t, y: [77.27 * (y[1] + y[0] * (1 - 8.375e-6 * y[0] - y[1])), (y[2] - (1 + y[0]) * y[1]) / 77.27,
                  0.161 * (y[0] - y[2])])
# Values at t = 1000 as E. Hairer's page of stiff problems gives them.
case("e5", "y1 y2 y3 y4", [1.76e-3, 0, 0, 0], 1000, ("Radau", "LSODA"), limit=1e-9, published=(
    1000, [1.6180769999072942552e-3, 1.3822370304983735443e-10, 8.2515735006838336088e-12, 1.2997212954915352082e-10],
    1e-8))(
    lambda t, y: [-7.89e-10 * y[0] - 1.1e7 * y[0] * y[2], 7.89e-10 * y[0] - 1.13e9 * y[1] * y[2],
                  7.89e-10 * y[0] - 1.1e7 * y[0] * y[2] - 1.13e9 * y[1] * y[2] + 1.13e3 * y[3],
                  1.1e7 * y[0] * y[2] - 1.13e3 * y[3]])


@case("brusselator20", numbered("u", 20) + numbered("v", 20),
      [1 + math.sin(2 * math.pi * i / 21) for i in range(1, 21)] + [3] * 20, 10)
def brusselator20(t, y):
    u, v = y[:20], y[20:]
    c = 21 ** 2 / 50
    far = np.concatenate([[1], u, [1]])
    wide = np.concatenate([[3], v, [3]])
    return np.concatenate([1 + u * u * v - 4 * u + c * (far[:-2] - 2 * u + far[2:]),
                           3 * u - u * u * v + c * (wide[:-2] - 2 * v + wide[2:])])


RATES = np.array([1e4, 1e3, 1e2, 1e1, 1e0, 1e-1, 0])


@case("decay_chain", numbered("y", 7), [1] + [0] * 6, 10)
def decay_chain(t, y):
    flow = RATES * y
    return np.append(0, flow[:-1]) - flow


case("prothero_robinson", "c s y", [1, 0, 1], 10)(
    lambda t, y: [-y[1], y[0], -1e4 * (y[2] - math.cos(t)) - math.sin(t)])


# --- physiology -----------------------------------------------------------------------------------------------------

# Beeler and Reuter, J. Physiol. 268 (1977) 177-210, table 1: c1 .. c7 of each rate.
BEELER_REUTER = {
    "x1": ((0.0005, 0.083, 50, 0, 0, 0.057, 1), (0.0013, -0.06, 20, 0, 0, -0.04, 1)),
    "m": ((0, 0, 47, -1, 47, -0.1, -1), (40, -0.056, 72, 0, 0, 0, 0)),
    "h": ((0.126, -0.25, 77, 0, 0, 0, 0), (1.7, 0, 22.5, 0, 0, -0.082, 1)),
    "j": ((0.055, -0.25, 78, 0, 0, -0.2, 1), (0.3, 0, 32, 0, 0, -0.1, 1)),
    "d": ((0.095, -0.01, -5, 0, 0, -0.072, 1), (0.07, -0.017, 44, 0, 0, 0.05, 1)),
    "f": ((0.012, -0.008, 28, 0, 0, 0.15, 1), (0.0065, -0.02, 30, 0, 0, -0.2, 1)),
}


@case("beeler_reuter", "V Ca m h j d f x1", [-20, 1e-7, 0.011, 0.988, 0.975, 0.003, 0.994, 0.0001], 400, limit=1e-9)
def beeler_reuter(t, y):
    v, ca, gates = y[0], y[1], dict(zip(["m", "h", "j", "d", "f", "x1"], y[2:]))

    def rate(c1, c2, c3, c4, c5, c6, c7):
        below = math.exp(c6 * (v + c3)) + c7
        return (c1 * math.exp(c2 * (v + c3)) + c4 * (v + c5)) / below

    i_s = 0.09 * gates["d"] * gates["f"] * (v + 82.3 + 13.0287 * math.log(ca))
    i_na = (4 * gates["m"] ** 3 * gates["h"] * gates["j"] + 0.003) * (v - 50)
    i_x1 = gates["x1"] * 0.8 * (math.exp(0.04 * (v + 77)) - 1) / math.exp(0.04 * (v + 35))
    i_k1 = 0.35 * (4 * (math.exp(0.04 * (v + 85)) - 1) / (math.exp(0.08 * (v + 53)) + math.exp(0.04 * (v + 53)))
                   + 0.2 * (v + 23) / (1 - math.exp(-0.04 * (v + 23))))
    change = [-(i_k1 + i_x1 + i_na + i_s), -1e-7 * i_s + 0.07 * (1e-7 - ca)]
    for gate in ["m", "h", "j", "d", "f", "x1"]:
        alpha, beta = (rate(*constants) for constants in BEELER_REUTER[gate])
        change.append(alpha * (1 - gates[gate]) - beta * gates[gate])
    return change


# Hodgkin and Huxley, J. Physiol. 117 (1952) 500-544, voltages with the rest at -65 mV, times in seconds.
@case("hodgkin_huxley", "V m h n", [-65, 0.052932, 0.596121, 0.317677], 0.05, limit=1e-9, jumps=(0.005, 0.045))
def hodgkin_huxley(t, y):
    v, m, h, n = y
    current = 10 if 0.005 <= t < 0.045 else 0

    def singular(x):
        return x / (1 - math.exp(-x)) if abs(x) > 1e-5 else 1 + x / 2 + x * x / 12

    alpha = [singular((v + 40) / 10), 0.07 * math.exp(-(v + 65) / 20), 0.1 * singular((v + 55) / 10)]
    beta = [4 * math.exp(-(v + 65) / 18), 1 / (1 + math.exp(-(v + 35) / 10)), 0.125 * math.exp(-(v + 65) / 80)]
    ionic = 120 * m ** 3 * h * (v - 50) + 36 * n ** 4 * (v + 77) + 0.3 * (v + 54.387)
    return [1e3 * (current - ionic)] + [1e3 * (a * (1 - x) - b * x) for a, b, x in zip(alpha, beta, (m, h, n))]


# --- mechanics ------------------------------------------------------------------------------------------------------

@case("double_pendulum", "a b p r", [1, 0.5, 0, 0], 5)
def double_pendulum(t, y):
    # From the mass matrix, where the spec has the solved form.
    a, b, p, r = y
    c, s = math.cos(a - b), math.sin(a - b)
    mass = np.array([[2, c], [c, 1]])
    force = [-s * r * r - 2 * 9.81 * math.sin(a), s * p * p - 9.81 * math.sin(b)]
    return [p, r, *np.linalg.solve(mass, force)]


case("duffing", "c s x v", [1, 0, 1, 0], 40)(
    lambda t, y: [-1.2 * y[1], 1.2 * y[0], y[3], y[2] - y[2] ** 3 - 0.3 * y[3] + 0.2 * math.cos(1.2 * t)])


def rocker_angle(theta):
    """Angle of the rocker from the closed loop of the four-bar, for complex angles, too."""
    x, y = 2.5 - np.cos(theta), -np.sin(theta)
    square = x * x + y * y
    # The rocker's tip lies on circles about its joint (radius 2) and the tip of the crank (radius 2.5).
    along = (square + 2 ** 2 - 2.5 ** 2) / (2 * np.sqrt(square))
    across = np.sqrt(2 ** 2 - along * along)
    root = np.sqrt(square)
    tip_x, tip_y = (-x * along - y * across) / root, (-y * along + x * across) / root
    return tip_x, tip_y


def rocker_rate(theta):
    """d psi/d theta by a complex step."""
    step = 1e-30
    (x, y), (dx, dy) = rocker_angle(theta), rocker_angle(theta + 1j * step)
    return (x * dy.imag / step - y * dx.imag / step) / 4


@case("four_bar", "theta omega", [-0.4, 0], 10)
def four_bar(t, y):
    theta, omega = y
    k = rocker_rate(theta)
    # Fourth-order central differences of an exact derivative: good to 1e-13.
    d = 2e-3
    near, far = rocker_rate(theta + d) - rocker_rate(theta - d), rocker_rate(theta + 2 * d) - rocker_rate(theta - 2 * d)
    beyond = rocker_rate(theta + 3 * d) - rocker_rate(theta - 3 * d)
    dk = (45 * near - 9 * far + beyond) / (60 * d)
    cos_psi = rocker_angle(theta)[0] / 2
    return [omega, -(2 * k * dk * omega ** 2 + 9.81 * math.cos(theta) + 12 * cos_psi * k) / (1 + 2 * k * k)]


# --- control --------------------------------------------------------------------------------------------------------

@case("dc_motor", "theta omega current integral filtered", [0] * 5, 2)
def dc_motor(t, y):
    theta, omega, current, integral, filtered = y
    error = 1 - theta
    u = 10 * error + 20 * integral + 0.5 * 500 * (error - filtered)
    return [omega, (0.05 * current - 1e-5 * omega) / 1e-4, (u - current - 0.05 * omega) / 5e-3, error,
            500 * (error - filtered)]


@case("cart_pole", "x v theta omega", [0.2, 0, 0.3, 0], 10)
def cart_pole(t, y):
    # From the mass matrix, where the spec has the solved form.
    x, v, theta, omega = y
    force = 3.16227766 * x + 3.50208771 * v + 25.89061504 * theta + 3.78605672 * omega
    s, c = math.sin(theta), math.cos(theta)
    mass = np.array([[0.7, 0.2 * 0.3 * c], [c, 0.3]])
    acceleration = np.linalg.solve(mass, [force + 0.2 * 0.3 * omega ** 2 * s, 9.81 * s])
    return [v, acceleration[0], omega, acceleration[1]]


@case("chebyshev", "x[1] v[1] x[2] v[2]", [0] * 4, 1)
def chebyshev(t, y):
    change, feed = [], 1.0
    sections = [(68.00870769, -10.75430763 + 29.91438642j), (164.18754448, -31.70099692 + 15.12931249j)]
    for (zero, pole), (x, v) in zip(sections, [y[:2], y[2:]]):
        w = abs(pole)
        change += [w * v, w * (feed - x) + 2 * pole.real * v]
        # (s^2 + zero^2) w^2/zero^2 applied to x/w^2, with s^2 x/w^2 = feed - x + 2 Re(pole) v/w.
        feed = (w / zero) ** 2 * (feed - x + 2 * pole.real * v / w) + x
    return change


# --- biology and chemistry --------------------------------------------------------------------------------------------

case("sir", "S I R", [0.999, 0.001, 0], 100, grid=0.1)(
    lambda t, y: [-0.4 * y[0] * y[1], (0.4 * y[0] - 0.1) * y[1], 0.1 * y[1]])
case("seir", "S E I", [0.99, 0.01, 0], 200, grid=0.1)(
    lambda t, y: [0.01 * (1 - y[0]) - 0.9 * y[0] * y[2], 0.9 * y[0] * y[2] - 0.21 * y[1], 0.2 * y[1] - 0.16 * y[2]])


@case("chemostat", "biomass substrate", [0.1, 5], 60, grid=0.02)
def chemostat(t, y):
    uptake = 0.7 * y[0] * y[1] / (0.4 + y[1])
    return [uptake - 0.3 * y[0], 0.3 * (5 - y[1]) - 2 * uptake]


@case("glycolysis", "x y", [0.5, 2], 60, grid=0.01)
def glycolysis(t, y):
    flow = (0.08 + y[0] ** 2) * y[1]
    return [flow - y[0], 0.6 - flow]


case("goodwin", "m p r", [0.2, 0.2, 2.5], 100, grid=0.05)(
    lambda t, y: [1 / (1 + y[2] ** 10) - y[0] / 10, y[0] - y[1] / 10, y[1] - y[2] / 10])
case("fitzhugh_nagumo", "v w", [-1, -0.5], 150, grid=0.02)(
    lambda t, y: [y[0] * (1 - y[0] ** 2 / 3) - y[1] + 0.5, (y[0] + 0.7 - 0.8 * y[1]) / 12.5])


@case("morris_lecar", "V w", [-40, 0], 400, grid=0.05)
def morris_lecar(t, y):
    V, w = y
    m, rest = 1 / (1 + math.exp(-2 * (V + 1.2) / 18)), 1 / (1 + math.exp(-2 * (V - 2) / 30))
    current = 2 * (V + 60) + 8 * w * (V + 84) + 4.4 * m * (V - 120)
    return [(90 - current) / 20, 0.04 * (rest - w) * math.cosh((V - 2) / 60)]


PHARMACOKINETICS = np.array([[-1.2, 0, 0, 0], [1.2, -1.35, 0.6, 0.03], [0, 0.9, -0.6, 0], [0, 0.15, 0, -0.03]])
case("pharmacokinetics", "gut blood shallow deep", [1, 0, 0, 0], 24, grid=0.02)(lambda t, y: PHARMACOKINETICS @ y)
case("bateman", "gut blood", [1, 0], 12, grid=0.005)(lambda t, y: [-1.01 * y[0], 1.01 * y[0] - y[1]])


@case("michaelis_menten", "s e c p", [1, 0.2, 0, 0], 30, grid=0.005)
def michaelis_menten(t, y):
    bind, release, react = 10 * y[0] * y[1], 2 * y[2], y[2]
    return [release - bind, release + react - bind, bind - release - react, react]


case("toggle_switch", "u v", [1.1, 1], 40, grid=0.02)(
    lambda t, y: [10 / (1 + y[1] * y[1]) - y[0], 10 / (1 + y[0] * y[0]) - y[1]])


@case("repressilator", [f"{name}[{k}]" for name in "mp" for k in (1, 2, 3)], [2, 0.5, 0.5, 1, 2, 3], 60, grid=0.02)
def repressilator(t, y):
    m, p = y[:3], y[3:]
    return [*(20 / (1 + np.roll(p, 1) ** 2) + 0.2 - m), *(m - p)]


@case("holling", "prey predator", [1, 0.4], 100, grid=0.02)
def holling(t, y):
    eaten = y[0] * y[1] / (0.6 + y[0])
    return [y[0] - y[0] ** 2 / 2 - eaten, 0.8 * eaten - 0.45 * y[1]]


@case("minimal_model", "G X I", [280, 0, 120], 180, grid=0.1)
def minimal_model(t, y):
    glucose, effect, insulin = y
    return [-0.03 * (glucose - 90) - effect * glucose, 1.2e-5 * (insulin - 10) - effect / 50,
            0.003 * (glucose - 90) - 0.15 * (insulin - 10)]


@case("windkessel", "c s p i", [1, 0, 80, 0], 10, grid=1e-3)
def windkessel(t, y):
    c, s, p, i = y
    return [-7.5 * s, 7.5 * c, (80 + 70 * c - p) / 1.3, 12 * (80 + 70 * c - i)]


@case("hindmarsh_rose", "x y z", [-1, -5, 2], 60, grid=0.01)
def hindmarsh_rose(t, y):
    x = y[0]
    return [x * x * (3 - x) + y[1] - y[2] + 5, 1 - 5 * x * x - y[1], 0.024 * (x + 1.6) - 0.006 * y[2]]


@case("stirred_reactor", "x T", [0.2, 0.5], 20, grid=5e-3)
def stirred_reactor(t, y):
    rate = 0.072 * (1 - y[0]) * math.exp(20 * y[1] / (20 + y[1]))
    return [rate - y[0], 8 * rate - 1.3 * y[1]]


# --- mechanics --------------------------------------------------------------------------------------------------------

@case("quarter_car", "c s xs vs xu vu", [0.02, 0, 0, 0, 0, 0], 4, grid=1e-3)
def quarter_car(t, y):
    c, s, xs, vs, xu, vu = y
    strut = 16000 * (xs - xu) + 1200 * (vs - vu)
    return [-12 * s, 12 * c, vs, -strut / 300, vu, (strut - 160000 * (xu - c)) / 40]


@case("torsion_drive", "a va b vb c vc", [0] * 6, 2, grid=5e-4)
def torsion_drive(t, y):
    a, va, b, vb, c, vc = y
    first, second = 400 * (a - b) + 0.8 * (va - vb), 900 * (b - c) + 0.6 * (vb - vc)
    return [va, 10 * (5 - first - 0.5 * va), vb, 20 * (first - second), vc, (second - 2 * vc) / 0.3]


@case("spring_pendulum", "x y vx vy", [0.3, -1.2, 0, 0], 10, grid=2e-3)
def spring_pendulum(t, y):
    length = math.hypot(y[0], y[1])
    force = 40 * (length - 1)
    return [y[2], y[3], -force * y[0] / length, -force * y[1] / length - 9.81]


@case("fpu_chain", numbered("x", 8) + numbered("v", 8), [math.sin(math.pi * k / 9) for k in range(1, 9)] + [0] * 8, 40,
      grid=5e-3)
def fpu_chain(t, y):
    stretch = np.diff(np.concatenate([[0], y[:8], [0]]))
    force = stretch + stretch ** 3 / 2
    return [*y[8:], *(force[1:] - force[:-1])]


@case("toda", numbered("q", 4) + numbered("p", 4),
      [0.3 * k - 0.05 * k * k for k in range(1, 5)] + [0.6, -0.2, -0.2, -0.2], 20, grid=5e-3)
def toda(t, y):
    spring = np.exp(y[:4] - np.roll(y[:4], -1))
    return [*y[4:], *(np.roll(spring, 1) - spring)]


case("henon_heiles", "x y vx vy", [0, 0.1, 0.3905124837953327, 0], 100, grid=0.01)(
    lambda t, y: [y[2], y[3], -y[0] * (1 + 2 * y[1]), y[1] * (y[1] - 1) - y[0] ** 2])
case("parametric_pendulum", "c s theta omega", [1, 0, 0.4, 0], 20, limit=1e-9, grid=2e-3)(
    lambda t, y: [-7 * y[1], 7 * y[0], y[3], -(9.81 + 3 * y[0]) * math.sin(y[2]) - y[3] / 10])


@case("quaternion", "q0 q1 q2 q3 wx wy wz", [1, 0, 0, 0, 0.4, 0.1, 0.2], 30, grid=5e-3)
def quaternion(t, y):
    scalar, vector, w = y[0], y[1:4], y[4:]
    return [-np.dot(vector, w) / 2, *((scalar * w + np.cross(vector, w)) / 2),
            *(np.array([0.5, -0.8, 0.3]) * np.array([w[1] * w[2], w[2] * w[0], w[0] * w[1]]))]


@case("string16", numbered("x", 16) + numbered("v", 16),
      [k / 5 if k <= 5 else (17 - k) / 12 for k in range(1, 17)] + [0] * 16, 20, grid=5e-3)
def string16(t, y):
    return [*y[16:], *(4 * np.diff(np.concatenate([[0], y[:16], [0]]), 2))]


@case("two_masses", "x y vx vy", [0.5, 0, 0, 1.1], 10, grid=2e-3)
def two_masses(t, y):
    change = [0, 0]
    for mass, at in ((1, -0.5), (0.5, 1.5)):
        distance = np.array([y[0] - at, y[1]])
        change -= mass * distance / math.sqrt(distance @ distance + 0.25) ** 3
    return [y[2], y[3], *change]


# --- electrical and process engineering -------------------------------------------------------------------------------

case("pll", "e z", [0, 0], 0.5, grid=2e-4)(
    lambda t, y: [60 - y[1] - 80 * math.sin(y[0]), 3000 * math.sin(y[0])])
case("buck", "i v q", [0, 0, 0], 5e-3, grid=2e-6)(
    lambda t, y: [(24 * (0.5 + 0.02 * (12 - y[1]) + y[2]) - y[1]) / 1e-4, (y[0] - y[1] / 5) / 1e-4, 60 * (12 - y[1])])
case("boost", "d i v", [0.2, 1.8, 15], 0.01, grid=2e-6)(
    lambda t, y: [200 * (0.5 - y[0]), (12 - (1 - y[0]) * y[2]) / 2e-4, ((1 - y[0]) * y[1] - y[2] / 10) / 2e-4])


@case("induction_motor", "c s sa sb ra rb n", [1, 0, 0, 0, 0, 0, 0], 0.6, grid=1e-4)
def induction_motor(t, y):
    w = 314.159265358979
    supply, stator, rotor, n = y[0] + 1j * y[1], y[2] + 1j * y[3], y[4] + 1j * y[5], y[6]
    of_stator, of_rotor = 5.5 * stator - 5.2 * rotor, 5.5 * rotor - 5.2 * stator
    stator_rate = w * (supply - 0.03 * of_stator)
    rotor_rate = w * (-0.04 * of_rotor + 1j * n * rotor)
    torque = (np.conj(stator) * of_stator).imag
    supply_rate = 1j * w * supply
    return [supply_rate.real, supply_rate.imag, stator_rate.real, stator_rate.imag, rotor_rate.real, rotor_rate.imag,
            6 * torque - 0.5 * n]


@case("heat_exchanger", numbered("hot", 8) + numbered("cold", 8), [0] * 16, 20, grid=5e-3)
def heat_exchanger(t, y):
    hot, cold = y[:8], y[8:]
    return [*(2 * (np.append(60, hot[:-1]) - hot) - 0.8 * (hot - cold)),
            *(1.5 * (np.append(cold[1:], 0) - cold) + 0.7 * (hot - cold))]


@case("rooms", numbered("air", 4) + numbered("wall", 4), [5] * 4 + [2] * 4, 48, grid=0.02)
def rooms(t, y):
    air, wall = y[:4], y[4:]
    through = np.diff(np.concatenate([air[:1], air, air[-1:]]))
    return [*(np.array([12, 0, 0, 0]) + 3 * (wall - air) - air / 2 + 1.2 * (through[1:] - through[:-1])),
            *(0.4 * (air - wall) - wall / 10)]


@case("quadruple_tank", "h1 h2 h3 h4", [12.4, 12.7, 1.8, 1.4], 600, grid=0.2)
def quadruple_tank(t, y):
    out = np.array([3.1454, 2.5252, 3.1454, 2.5252]) * np.sqrt(y)
    return [(out[2] - out[0] + 2.331 * 3.6) / 28, (out[3] - out[1] + 2.01 * 3.6) / 32, (1.34 * 3.6 - out[2]) / 28,
            (0.999 * 3.6 - out[3]) / 32]


case("rossler", "x y z", [1, 1, 0], 50, grid=0.01)(
    lambda t, y: [-y[1] - y[2], y[0] + y[1] / 5, 0.2 + y[2] * (y[0] - 2.5)])
case("stiff_decay", "y", [0], 10, ("DOP853", "Radau"), grid=2e-3)(lambda t, y: [1000 - 1000 * y[0]])


# --- sampled --------------------------------------------------------------------------------------------------------

def dc_motor_samples(y):
    theta, omega, current, integral, filtered, _ = y
    error = 1 - theta
    u = 10 * error + 20 * integral + 0.5 * 500 * (error - filtered)
    return [theta, omega, current, integral + 1e-3 * error, error + math.exp(-0.5) * (filtered - error), u]


@case("dc_motor_sampled", "theta omega current integral filtered u", [0] * 6, 2, period=1e-3, sample=dc_motor_samples)
def dc_motor_sampled(t, y):
    theta, omega, current, _, _, u = y
    return [omega, (0.05 * current - 1e-5 * omega) / 1e-4, (u - current - 0.05 * omega) / 5e-3, 0, 0, 0]


@case("cart_pole_sampled", "x v theta omega force", [0.2, 0, 0.3, 0, 0], 10, period=0.02,
      sample=lambda y: [*y[:4], np.dot(y[:4], [3.16227766, 3.50208771, 25.89061504, 3.78605672])])
def cart_pole_sampled(t, y):
    v, theta, omega, force = y[1:]
    s, c = math.sin(theta), math.cos(theta)
    mass = np.array([[0.7, 0.2 * 0.3 * c], [c, 0.3]])
    acceleration = np.linalg.solve(mass, [force + 0.2 * 0.3 * omega ** 2 * s, 9.81 * s])
    return [v, acceleration[0], omega, acceleration[1], 0]


def low_pass_sample(y):
    # scipy's own filter, one sample long; its memories are those of the transposed direct form II.
    sections = signal.cheby2(4, 40, 0.01, output="sos")
    out, memories = signal.sosfilt(sections, [1.0], zi=np.array([[y[0], y[2]], [y[1], y[3]]]))
    return [memories[0, 0], memories[1, 0], memories[0, 1], memories[1, 1], out[0]]


case("low_pass", "m1[1] m1[2] m2[1] m2[2] y[2]", [0] * 5, 1, period=1e-3, sample=low_pass_sample)(
    lambda t, y: np.zeros(5))


def write(name):
    """Solves a case, judges the solution and writes its file."""
    case = CASES[name]
    times = np.array([case.end * row / ROWS for row in range(1, ROWS + 1)])
    if case.grid:
        times = following(case)
    (first, largest), (second, _) = (solve(case, method, times) for method in case.methods)
    agreement = np.max(np.abs(first - second) / largest)
    text = f"{name}: {case.methods[0]} and {case.methods[1]} differ by {agreement:.1e}"
    if not agreement <= case.limit:
        raise SystemExit(text + f", more than {case.limit:.1e}")
    if case.published:
        time, values, tolerance = case.published
        found = solve(case, case.methods[0], np.array([time]))[0][-1]
        pairs = [(value, known) for value, known in zip(found, values) if known is not None]
        worst = max(abs(value - known) / abs(known) for value, known in pairs)
        text += f"; published values at t = {time:g} differ by {worst:.1e}"
        if not worst <= tolerance:
            raise SystemExit(text + f", more than {tolerance:.1e}")
    print(text, flush=True)
    os.makedirs(FOLDER, exist_ok=True)
    with open(os.path.join(FOLDER, f"{name}.csv"), "w") as file:
        file.write(f"# {case.methods[0]} of scipy; {case.methods[1]} differs by {agreement:.1e}\n")
        file.write(",".join(["t"] + case.names) + "\n")
        file.write(",".join(["largest"] + [f"{number:.6e}" for number in largest]) + "\n")
        for time, row in zip(times, first):
            file.write(",".join([f"{time:.12g}"] + [f"{number:.12e}" for number in row]) + "\n")


def main():
    unknown = [name for name in sys.argv[1:] if name not in CASES]
    if unknown:
        raise SystemExit(f"unknown: {' '.join(unknown)}; known: {' '.join(CASES)}")
    for name in sys.argv[1:] or CASES:
        write(name)


main()
