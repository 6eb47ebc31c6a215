"""Jumps, rests, scales, stiffness, chaos, and models of other folders."""

import math

import numpy as np

from problems import case, numbered
from problems.published import ROBERTSON

# --- inputs that jump, rests ------------------------------------------------------------------------------------------

def halves(frequency, end):
    """Times at which a square wave jumps."""
    return tuple(k / (2 * frequency) for k in range(1, math.ceil(2 * frequency * end - 1e-9)))


def square(t, frequency):
    return 1 if (2 * frequency * t + 1e-10) // 1 % 2 == 0 else -1


@case("rc_square", "v", [0], 100, grid=5e-3, jumps=halves(2, 100))
def rc_square(t, y):
    return [100 * (square(t, 2) - y[0])]


@case("rc_off_step", "v", [0], 4, grid=5e-3, jumps=halves(1.3, 4))
def rc_off_step(t, y):
    return [20 * (square(t, 1.3) - y[0])]


@case("chopper", "i", [0], 0.05, grid=5e-5, jumps=tuple(k / 1000 + part for k in range(50) for part in (0, 2.5e-4))[1:])
def chopper(t, y):
    on = (1000 * t + 1e-10) % 1 < 0.25
    return [((24 if on else 0) - y[0] / 2) / 2e-3]


@case("kicked_pendulum", "theta omega", [0, 0], 15, grid=2e-3, jumps=(4, 4.2, 9, 9.2, 14, 14.2), limit=1e-9)
def kicked_pendulum(t, y):
    push = 8 if t >= 4 and (t - 4 + 1e-10) % 5 < 0.2 else 0
    return [y[1], push - 9.81 * math.sin(y[0]) - 0.8 * y[1]]


@case("late_pulse", "a b c", [0, 0, 0], 20, grid=1e-3, jumps=(17, 17.01))
def late_pulse(t, y):
    u = 100 if 17 <= t < 17.01 else 0
    return [50 * (u - y[0]), 20 * (y[0] - y[1]), 5 * (y[1] - y[2])]


case("ramp_lag", "x v", [0, 0], 5, grid=1e-3, jumps=(1, 3))(
    lambda t, y: [y[1], 100 * (min(max(t - 1, 0), 2) - y[0]) - 14 * y[1]])


@case("chirp_filter", "x v", [0, 0], 4, grid=1e-3)
def chirp_filter(t, y):
    # From 1 to 10 Hz in 4 s: the phase is the integral of the frequency.
    u = math.sin(2 * math.pi * (t + 9 / 8 * t * t))
    return [10 * math.pi * y[1], 10 * math.pi * (u - y[0] - y[1] / 10)]


def driven(t, y):
    return [y[1], math.sin(0.6 * math.pi * t) - 4 * y[0] - 0.4 * y[1]]


case("sine_held", "x v", [0, 0], 20, grid=5e-3)(driven)
case("sine_inside", "x v", [0, 0], 20, grid=2e-2)(driven)


@case("stiff_square", "fast slow", [0, 0], 4, grid=2e-3, jumps=halves(1, 4), limit=1e-9)
def stiff_square(t, y):
    return [5000 * (square(t, 1) - y[0]), 5 * (y[0] - y[1])]


@case("diffusion_jump", numbered("T", 12), [0] * 12, 3, grid=5e-3, jumps=halves(1, 3), limit=1e-9)
def diffusion_jump(t, y):
    rod = np.concatenate([[square(t, 1)], y, y[-1:]])
    return 100 * np.diff(rod, 2)


@case("clamp_tank", "h", [0.2], 20, grid=5e-3, jumps=(5, 10, 15), limit=1e-9)
def clamp_tank(t, y):
    return [0.7 + 0.6 * square(t, 0.1) - math.sqrt(y[0]) / 2 - 4 * max(y[0] - 1, 0)]


@case("gear_backlash", "x v", [0, 1], 8, grid=1e-3, limit=1e-8)
def gear_backlash(t, y):
    x, v = y
    beyond = x - min(max(x, -0.2), 0.2)
    return [v, -400 * beyond - v / 20]


# --- time, scales, stiffness, chaos -----------------------------------------------------------------------------------

# Abramowitz and Stegun, table 10.11: Ai(-10).
case("airy", "y z", [0.355028053887817, 0.258819403792807], 10, grid=5e-3, published=(10, [0.04024123849, None], 1e-6))(
    lambda t, y: [y[1], -t * y[0]])
case("mathieu", "x v", [0.01, 0], 30, grid=5e-3)(lambda t, y: [y[1], -(1 + 0.3 * math.cos(2 * t)) * y[0]])
# Up to the bump and from there on, so that no method passes over it.
case("narrow_bump", "y", [0], 10, grid=2e-3, jumps=(5, 5.5, 6, 6.5, 7))(
    lambda t, y: [20 * math.exp(-50 * (t - 6) ** 2) - y[0] / 2])
case("logistic_wide", "y", [1e-6], 30, grid=1e-2,
     published=(20, [1 / (1 + 999999 * math.exp(-20))], 1e-9))(lambda t, y: [y[0] * (1 - y[0])])
case("two_scales", "parent daughter tracer", [1e9, 0, 1e-3], 20, finest=1e-12, grid=1e-2)(
    lambda t, y: [-0.3 * y[0], 0.3 * y[0] - 2 * y[1], 1e-12 * y[1] - y[2] / 10])
case("kaps", "y1 y2", [1, 1], 5, ("Radau", "LSODA"), grid=1e-2, published=(1, [math.exp(-2), math.exp(-1)], 1e-10))(
    lambda t, y: [-1002 * y[0] + 1000 * y[1] ** 2, y[0] - y[1] - y[1] ** 2])
case("curtiss", "y", [0], 10, grid=1e-2)(lambda t, y: [50 * (math.cos(t) - y[0])])
# z lies on y/(1 + y) and falls onto it with exp(-200 t).
case("davis_skodje", "y z", [3, 2], 5, grid=5e-3,
     published=(1, [3 * math.exp(-1), 3 * math.exp(-1) / (1 + 3 * math.exp(-1))], 1e-10))(
    lambda t, y: [-y[0], -200 * (y[1] - y[0] / (1 + y[0])) - y[0] / (1 + y[0]) ** 2])


@case("chua", "x y z", [0.7, 0, 0], 15, grid=2e-3, limit=1e-8)
def chua(t, y):
    # The slope is -1.143 within the kinks, -0.714 outside.
    inner = min(max(y[0], -1), 1)
    return [9 * (y[1] - y[0] + 0.714 * y[0] + 0.429 * inner), y[0] - y[1] + y[2], -14.286 * y[1]]


case("thomas", "x y z", [1, 0.5, -0.5], 60, limit=1e-9, grid=1e-2)(lambda t, y: np.sin(np.roll(y, -1)) - 0.19 * np.array(y))
case("lorenz96", numbered("x", 8), [8, 8, 8.01, 8, 8, 8, 8, 8], 2, grid=1e-3, limit=1e-8)(
    lambda t, y: (np.roll(y, -1) - np.roll(y, 2)) * np.roll(y, 1) - y + 8)
COMPETITION = np.array([[1, 0.9, 1.4], [1.4, 1, 0.9], [0.9, 1.4, 1]])
case("three_species", "a b c", [0.3, 0.2, 0.1], 60, grid=2e-2)(lambda t, y: y * (1 - COMPETITION @ y))
case("hard_spring", "x v", [1, 0], 20, grid=2e-3, limit=1e-9)(lambda t, y: [y[1], -y[0] - y[0] ** 3])
# The first step of 0.2 ms, and what follows it.
case("robertson_first", "a b c", [1, 0, 0], 40, ("DOP853", "LSODA"), grid=2e-4)(ROBERTSON)

# --- models of models/ ------------------------------------------------------------------------------------------------

case("harmonic_oscillator", "x v", [1, 0], 5, grid=1e-3, limit=1e-9, published=(5, [1, None], 1e-10))(
    lambda t, y: [y[1], -(2 * math.pi) ** 2 * y[0]])
case("lotka_volterra", "prey predator", [10, 10], 30, grid=5e-3)(
    lambda t, y: [y[0] * (1.1 - 0.4 * y[1]), y[1] * (0.1 * y[0] - 0.4)])
case("pendulum", "phi omega", [2.5, 0], 20, limit=1e-9, grid=2e-3)(
    lambda t, y: [y[1], -9.81 * math.sin(y[0]) - y[1] / 5 + 2 * math.sin(0.8 * math.pi * t)])
case("van_der_pol", "x y", [0.5, 0], 30, grid=5e-3)(lambda t, y: [y[1], 1.5 * (1 - y[0] ** 2) * y[1] - y[0]])


@case("rc_ladder", numbered("U", 10), [0.1 * (1 - i / 20) for i in range(1, 11)], 0.4, grid=1e-4)
def rc_ladder(t, y):
    i = np.arange(1, 11)
    resistance, capacity = 1000 * (1 + 0.05 * np.sin(2 * i)), 1e-6 * (1 + 0.05 * np.cos(3 * i))
    into = -np.diff(np.concatenate([[math.sin(10 * math.pi * t)], y])) / resistance
    return (into - np.append(into[1:], 0)) / capacity


@case("lutchen20", numbered("c", 20), [0.3 + 0.2 * math.cos(3 * math.pi * i / 20) for i in range(1, 21)], 0.05, grid=1e-4)
def lutchen20(t, y):
    i = np.arange(1, 21)
    volume = 8e-5 * (1 + 0.5 * i / 20) * (1 + 0.04 * np.sin(1.1 * i))
    conductance = 0.012 * (1 + 9 * (i / 20) ** 2) * (1 + 0.03 * np.cos(0.9 * i))
    # What flows over the face in front of each cell, and out of the last one.
    before = np.concatenate([[0.9], y])
    flux = np.append(0.4 * before[:-1] + conductance * -np.diff(before), 0.4 * y[-1])
    return -np.diff(flux) / volume
