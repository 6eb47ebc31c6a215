"""Mechanisms and vehicles of models/, each formulated in another way than in its spec."""

import math

import numpy as np

from problems import case

# --- car: the equations as their authors publish them, from their package ----------------------------------------------

CAR = ("x y delta vx yaw r roll p pitch q vy z vz roll_u[1] p_u[1] vy_u[1] z_u[1] vz_u[1] roll_u[2] p_u[2] vy_u[2] z_u[2] "
       "vz_u[2] spin[1] spin[2] spin[3] spin[4] pin[1] pin[2]")


def car_start():
    front, rear = (965.7108098804363 * part / 2.5789128 + 63.7921826056784 for part in (1.4227170936, 1.1561957064))
    start = np.zeros(29)
    start[3] = 20
    start[16], start[21] = (mass * 9.81 / (2 * 158294.1398119115) for mass in (front, rear))
    start[23:27] = 20 / 0.344
    return start


# The tyres' offsets jump where the camber passes through zero, so nothing finer helps.
@case("car", CAR, car_start(), 5, ("DOP853", "RK45"), limit=1e-9, finest=1e-11, jumps=(0.5, 0.6), grid=4e-3)
def car(t, y):
    from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
    from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

    car.parameters = getattr(car, "parameters", None) or parameters_vehicle2()
    return vehicle_dynamics_mb(list(y), [0.3 if 0.5 <= t < 0.6 else 0.0, 0.0], car.parameters)


# --- double pendulum: the masses by themselves, and the forces in the rods that hold them ------------------------------


@case("double_pendulum_top", "a b w[1] w[2]", [3, 1, 1, 5], 5, limit=1e-8)
def double_pendulum_top(t, y):
    lengths, masses = (1, 0.8), (1, 0.6)
    along = [np.array([math.sin(angle), -math.cos(angle)]) for angle in y[:2]]
    across = [np.array([math.cos(angle), math.sin(angle)]) for angle in y[:2]]
    # Rod k pulls the mass above it (if it is not the pivot) and holds the one below; along it the distance stays.
    system, right = np.zeros((6, 6)), np.zeros(6)
    system[0:2, 0:2] = masses[0] * np.eye(2)
    system[2:4, 2:4] = masses[1] * np.eye(2)
    system[0:2, 4], system[0:2, 5], system[2:4, 5] = along[0], -along[1], along[1]
    right[[1, 3]] = [-9.81 * mass for mass in masses]
    system[4, 0:2], right[4] = along[0], -lengths[0] * y[2] ** 2
    system[5, 0:2], system[5, 2:4], right[5] = -along[1], along[1], -lengths[1] * y[3] ** 2
    upper, lower = np.linalg.solve(system, right)[:4].reshape(2, 2)
    return [y[2], y[3], across[0] @ upper / lengths[0], across[1] @ (lower - upper) / lengths[1]]


# --- spatial crank: reduced to the crank, whose inertia and potential depend on its angle -------------------------------

PIVOTS = np.array([[0.1, 0.7, 0.35], [0.7, 0.1, 0.35]])
PLANES = np.array([[0, 1, 0], [1, 0, 0]])
START, UP, CRANK, ROCKER = -1.6, np.array([0, 0, 1]), 0.2, 0.5
RODS = [np.sum(([CRANK, 0, 0] - pivot - ROCKER * (math.cos(START) * plane + math.sin(START) * UP)) ** 2)
        for pivot, plane in zip(PIVOTS, PLANES)]


def rockers(crank):
    """Angles of the rockers where the crank is at `crank`, and what they turn for each of its turns; also complex."""
    tip, aside = (CRANK * np.array(pair) for pair in
                  ([np.cos(crank), np.sin(crank), 0], [-np.sin(crank), np.cos(crank), 0]))
    angles, ratios = [], []
    for pivot, plane, square in zip(PIVOTS, PLANES, RODS):
        reach = tip - pivot
        flat, high = reach @ plane, reach @ UP
        spread = np.arccos((reach @ reach + ROCKER ** 2 - square) / (2 * ROCKER * np.sqrt(flat ** 2 + high ** 2)))
        angle = np.arctan(high / flat) - math.pi + spread
        angles.append(angle)
        arm, swing = ROCKER * (np.cos(angle) * plane + np.sin(angle) * UP), ROCKER * (np.cos(angle) * UP - np.sin(angle) * plane)
        ratios.append((reach - arm) @ aside / ((reach - arm) @ swing))
    return angles, ratios


def inertia_and_potential(crank):
    angles, ratios = rockers(crank)
    aside = CRANK * np.array([-np.sin(crank), np.cos(crank), 0])
    inertia, potential = 0.05, 0
    for plane, angle, ratio in zip(PLANES, angles, ratios):
        swing = ratio * ROCKER * (np.cos(angle) * UP - np.sin(angle) * plane)
        inertia += 0.8 / 3 * swing @ swing + 0.5 / 3 * (aside @ aside + aside @ swing + swing @ swing)
        potential += 9.81 * ROCKER * (0.8 + 0.5) / 2 * np.sin(angle)
    return inertia, potential


@case("spatial_crank", ["crank", "rock[1]", "rock[2]", "w[1]", "w[2]", "w[3]"],
      [0, START, START, *(12 * ratio for ratio in np.real(rockers(0j)[1])), 12], 4)
def spatial_crank(t, y):
    crank, rate = y[0] + 1e-30j, y[5]
    inertia, potential = inertia_and_potential(crank)
    push = -(0.5 * inertia.imag * rate ** 2 + potential.imag) / 1e-30 - 0.002 * rate
    ratios = np.array(rockers(crank)[1])
    turning = push / inertia.real
    return [rate, *(ratios.real * rate), *(ratios.real * turning + ratios.imag / 1e-30 * rate ** 2), turning]
