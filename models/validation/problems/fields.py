"""Problems of several fields, whose references follow the solution."""

import math

import numpy as np

from problems import case, numbered

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

@case("quarter_car", "c s xs vs xu vu", [0.02, 0, 0, 0, 0, 0], 4, limit=1e-9, grid=1e-3)
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


@case("rooms", numbered("air", 4) + numbered("wall", 4), [5] * 4 + [2] * 4, 48, limit=2e-9, grid=0.02)
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
