"""Published test problems, physiology, mechanics, control and sampled parts."""

import math

import numpy as np
from scipy import signal

from problems import case, numbered

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
