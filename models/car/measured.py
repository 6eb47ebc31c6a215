#!/usr/bin/env python3
"""Writes measured.csv, what the sensors of another car say, and prints the gains of observer.spec.

    python3 -m venv VENV && VENV/bin/pip install numpy==2.4.6 scipy==1.17.1 commonroad-vehicle-models==3.0.2 omegaconf==2.4.0
    VENV/bin/python models/car/measured.py

The other car is heavier and slower in yaw than the model, its tyres grip less, and it drives a slalom. The gains are those
of the steady Kalman filter of the model, linearised in a gentle turn at 20 m/s, over the step.
"""

import os

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_discrete_are
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

NAMES = ("x y delta vx yaw r roll p pitch q vy z vz roll_u1 p_u1 vy_u1 z_u1 vz_u1 roll_u2 p_u2 vy_u2 z_u2 vz_u2 "
         "spin1 spin2 spin3 spin4 pin1 pin2").split()
STEP, END = 4e-3, 8
SENSORS = {"vx": 0.1, "r": 0.01, "p": 0.02}  # standard deviations
# What the model does not know about the car, as noise in a step.
UNKNOWN = {"vx": 5e-3, "vy": 2e-3, "r": 2e-3, "p": 1e-3, "roll": 2e-4, "spin1": 0.02, "spin2": 0.02, "spin3": 0.02, "spin4": 0.02}
CORRECTED = "vx r p vy roll vy_u1 vy_u2 spin1 spin2 spin3 spin4".split()


def car(parameters):
    return lambda state, steer: np.array(vehicle_dynamics_mb(list(state), [steer, 0.0], parameters))


def steer(t):
    """Rate of the steering angle."""
    return 0.07 * np.cos(np.pi * (t - 0.5)) if t >= 0.5 else 0.0


def integrate(f, start, times):
    result = solve_ivp(lambda t, y: f(y, steer(t)), (times[0], times[-1]), start, "DOP853", times, rtol=1e-9, atol=1e-11,
                       max_step=0.02)
    return result.y.T


def gains(f, start):
    turn = start.copy()
    turn[NAMES.index("delta")] = 0.02
    turn = solve_ivp(lambda t, y: f(y, 0.0), (0, 3), turn, "DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
    kept = [n for n, name in enumerate(NAMES) if name not in ("x", "y", "yaw", "delta")]
    names = [NAMES[n] for n in kept]
    a = np.zeros((len(kept), len(kept)))
    for column, n in enumerate(kept):
        move = np.zeros(len(turn))
        move[n] = 1e-6 * max(1, abs(turn[n]))
        a[:, column] = (f(turn + move, 0.0) - f(turn - move, 0.0))[kept] / (2 * move[n])
    forward = expm(a * STEP)
    sees = np.array([[float(name == sensor) for name in names] for sensor in SENSORS])
    noise = np.diag([SENSORS[sensor] ** 2 for sensor in SENSORS])
    unknown = np.diag([UNKNOWN.get(name, 1e-5) ** 2 for name in names])
    spread = solve_discrete_are(forward.T, sees.T, unknown, noise)
    gain = spread @ sees.T @ np.linalg.inv(sees @ spread @ sees.T + noise)
    used = np.array([row if name in CORRECTED else 0 * row for name, row in zip(names, gain)])
    print("largest eigenvalue of the errors:", abs(np.linalg.eigvals(forward - used @ sees @ forward)).max())
    for name, row in zip(names, gain):
        print(f"{name:8}", "  ".join(f"{sensor} {number / STEP:9.4f}" for sensor, number in zip(SENSORS, row)))


def main():
    model, other = parameters_vehicle2(), parameters_vehicle2()
    start = np.array(init_mb([0, 0, 0, 20, 0, 0, 0], model))
    gains(car(model), start)
    other.m, other.m_s, other.I_z = other.m + 80, other.m_s + 80, 1.05 * other.I_z
    other.tire.p_dy1 *= 0.95
    start = np.array(init_mb([0, 0, 0, 21, 0, 0, 0], other))
    times = STEP * np.arange(round(END / STEP) + 1)
    states = integrate(car(other), start, times)
    random = np.random.default_rng(1)
    columns = [times] + [np.array([steer(t) for t in times])]
    for sensor, deviation in SENSORS.items():
        columns.append(states[:, NAMES.index(sensor)] + deviation * random.standard_normal(len(times)))
    columns += [states[:, NAMES.index(name)] for name in ("vy", "roll")]
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "measured.csv")
    with open(path, "w") as file:
        file.write("# another car, by measured.py; vy and roll are its true values, which no sensor sees\n")
        file.write("t [s], steer, vx, r, p, vy, roll\n")
        for row in zip(*columns):
            file.write(", ".join(f"{value:.5g}" for value in row) + "\n")


main()
