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


# --- suspension: every body by itself with six accelerations, and the forces in its joints ------------------------------

X, Y, Z = np.eye(3)
AXES = [X, np.array([math.cos(0.08), 0, -math.sin(0.08)])]
HINGES, LENGTHS, ARMS = [np.array([0, 0.35, 0.2]), np.array([-0.02, 0.45, 0.5])], [0.4, 0.28], [4, 2]
RACK, TOP, CAR_MASS, HUB_MASS = np.array([-0.12, 0.37, 0.27]), np.array([0, 0.55, 0.75]), 350, 35
HUB = np.diag([0.9, 1.5, 0.9])


def turned(axis, angle):
    skew = np.cross(np.eye(3), axis)
    return np.eye(3) + math.sin(angle) * skew + (1 - math.cos(angle)) * skew @ skew


def lever(at):
    """What turns an angular acceleration into that of a point beside the reference point."""
    return -np.array([[0, -at[2], at[1]], [at[2], 0, -at[0]], [-at[1], at[0], 0]])


@case("suspension", [f"{name}[{number}]" for name in "qw" for number in range(1, 7)], [0] * 6 + [0.3] + [0] * 5, 2,
      limit=1e-7, finest=1e-10)
def suspension(t, y):
    q, w = np.array(y[:6]), np.array(y[6:])
    # Accelerations: the car's, then of wishbones and knuckle that of the centre of mass and the angular one.
    system, right = np.zeros((40, 40)), np.zeros(40)
    row, height = 21, q[0] * Z

    def constrain(blocks, value):
        nonlocal row
        for of in range(len(value)):
            for place, block in blocks:
                system[row, place:place + block.shape[1]] += block[of]
            right[row] = value[of]
            row += 1

    def body(place, mass, inertia, spin, force, torque):
        system[place:place + 3, place:place + 3] = mass * np.eye(3)
        right[place:place + 3] = force - mass * 9.81 * Z
        if inertia is not None:
            system[place + 3:place + 6, place + 3:place + 6] = inertia
            right[place + 3:place + 6] = torque - np.cross(spin, inertia @ spin)

    along = [turned(axis, angle) @ Y for axis, angle in zip(AXES, q[1:3])]
    spins = [axis * rate for axis, rate in zip(AXES, w[1:3])]
    steer, caster = turned(Z, q[3]), turned(Z, q[3]) @ turned(Y, q[4])
    rotation = caster @ turned(X, q[5])
    axes = [Z, steer @ Y, caster @ X]
    spin = sum(axis * rate for axis, rate in zip(axes, w[3:]))
    ball = HINGES[0] + LENGTHS[0] * along[0]
    point = {name: rotation @ np.array(at) for name, at in (
        ("upper", (-0.02, -0.02, 0.3)), ("arm", (-0.12, -0.03, 0.07)), ("wheel", (0, 0.05, 0.1)), ("mass", (0, 0.03, 0.1)))}

    seat = 0.6 * LENGTHS[0] * along[0]
    strut = HINGES[0] + seat - TOP
    length = np.linalg.norm(strut)
    push = (60e3 * (0.648 - length) - 4e3 * np.cross(spins[0], seat) @ strut / length) * strut / length
    road = 0.02 * math.sin(2 * math.pi * t)
    grip = ((350 + 4 + 2 + 35) * 9.81 + 200e3 * (road - (height + ball + point["wheel"])[2] + 0.3)) * Z

    body(0, CAR_MASS, None, None, -push, None)
    for number, place in enumerate((3, 9)):
        rod = ARMS[number] * LENGTHS[number] ** 2 / 12 * (np.eye(3) - np.outer(along[number], along[number]))
        force, at = (push, seat - LENGTHS[0] * along[0] / 2) if number == 0 else (np.zeros(3), np.zeros(3))
        body(place, ARMS[number], rod, spins[number], force, np.cross(at, force))
    body(15, HUB_MASS, rotation @ HUB @ rotation.T, spin, grip, np.cross(point["wheel"] - point["mass"], grip))

    constrain([(0, np.array([X, Y]))], np.zeros(2))
    for number, place in enumerate((3, 9)):
        half = LENGTHS[number] * along[number] / 2
        central = np.cross(spins[number], np.cross(spins[number], half))
        constrain([(place, np.eye(3)), (place + 3, lever(-half)), (0, -np.eye(3))], central)
        across = np.linalg.svd(AXES[number][None])[2][1:]
        constrain([(place + 3, across)], np.zeros(2))
        joint = np.zeros(3) if number == 0 else point["upper"]
        at = joint - point["mass"]
        constrain([(place, np.eye(3)), (place + 3, lever(half)), (15, -np.eye(3)), (18, -lever(at))],
                  np.cross(spin, np.cross(spin, at)) - central)
    tie = ball + point["arm"] - RACK
    at = point["arm"] - point["mass"]
    moving = np.cross(spins[0], LENGTHS[0] * along[0]) + np.cross(spin, point["arm"])
    constrain([(15, tie[None]), (18, tie[None] @ lever(at)), (0, -tie[None])],
              [-moving @ moving - tie @ np.cross(spin, np.cross(spin, at))])
    system[:21, 21:] = system[21:, :21].T
    found = np.linalg.solve(system, right)
    left = np.cross(w[3] * Z, axes[1]) * w[4] + np.cross(w[3] * Z + w[4] * axes[1], axes[2]) * w[5]
    knuckle = np.linalg.solve(np.array(axes).T, found[18:21] - left)
    return [*w, found[2], AXES[0] @ found[6:9], AXES[1] @ found[12:15], *knuckle]


# --- four posts: particles for bodies, and all derivatives taken from where they are -------------------------------------

CORNERS = [(1, 1.3), (-1, 1.3), (1, -1.3), (-1, -1.3)]
ROADS = [(0.02, 1), (0.015, 1.5), (0.02, 1.2), (0.01, 2)]
POST_LOAD = (1416 / 4 + 4 / 3 + 2 / 3 + 35) * 9.81
TINY = 1e-30


def about(axis, angle):
    """Rotations about an axis of coordinates, also complex."""
    cos, sin, one, none = np.cos(angle), np.sin(angle), np.ones_like(angle), np.zeros_like(angle)
    rows = [[one, none, none, none, cos, -sin, none, sin, cos], [cos, none, sin, none, one, none, -sin, none, cos],
            [cos, -sin, none, sin, cos, none, none, none, one]]
    return np.stack(rows[axis], -1).reshape(np.shape(angle) + (3, 3))


def by_angles(angles):
    return about(2, angles[..., 0]) @ about(1, angles[..., 1]) @ about(0, angles[..., 2])


def particles(mass, inertia, centre):
    """Places and masses of seven particles with the mass, the centre and the inertia of a body."""
    spread = (sum(inertia) / 2 - np.array(inertia)) / 2 / 0.5 ** 2
    beside = [np.array(centre) + sign * 0.5 * axis for axis in np.eye(3) for sign in (1, -1)]
    return [np.array(centre), *beside], [mass - 2 * sum(spread), *np.repeat(spread, 2)]


CAR_PLACES, CAR_MASSES = particles(1416, (500, 2000, 2200), (0, 0, 0.55))
PARTICLES = np.array(CAR_MASSES + (particles(35, (0.9, 1.5, 0.9), (0, 0, 0))[1] + [4 / 3, 2 / 3]) * 4)


def posed(q):
    """Where all particles and the wheels are, what the closures are, and how long the springs."""
    turn = by_angles(q[..., 3:6])

    def world(at):
        return q[..., :3] + np.einsum("...ab,...b->...a", turn, at + 0 * q[..., :3])

    places, wheels, closures, springs = [world(at) for at in CAR_PLACES], [], [], []
    for number, (side, base) in enumerate(CORNERS):
        own = q[..., 6 + 5 * number:11 + 5 * number]

        def mirrored(*at):
            return np.array(at) * (1, side, 1)

        def arm(tilt, angle):
            return np.stack([math.sin(tilt) * np.sin(angle), side * np.cos(angle), math.cos(tilt) * np.sin(angle)], -1)

        corner, lower = np.array([base, 0, 0]), arm(0, own[..., 0])
        joint = corner + mirrored(0, 0.35, 0.2) + 0.4 * lower
        end = corner + mirrored(-0.02, 0.45, 0.5) + 0.28 * arm(0.08, own[..., 1])
        knuckle = by_angles(own[..., 2:5])
        hub = [joint + knuckle @ at for at in particles(35, (0.9, 1.5, 0.9), mirrored(0, 0.03, 0.1))[0]]
        places += [world(at) for at in [*hub, joint, end]]
        wheels.append(world(joint + knuckle @ mirrored(0, 0.05, 0.1)))
        tie = joint + knuckle @ mirrored(-0.12, -0.03, 0.07) - corner - mirrored(-0.12, 0.37, 0.27)
        closures += [joint + knuckle @ mirrored(-0.02, -0.02, 0.3) - end, (np.sqrt(np.sum(tie ** 2, -1)) - 0.35)[..., None]]
        springs.append(np.sqrt(np.sum((mirrored(0, -0.2, -0.55) + 0.24 * lower) ** 2, -1)))
    return [np.stack(places, -2), np.stack(wheels, -2), np.concatenate(closures, -1), np.stack(springs, -1)]


@case("four_posts", [f"{name}[{number}]" for name in "qw" for number in range(1, 27)], [0] * 52, 0.5, limit=1e-5, finest=1e-8)
def four_posts(t, y):
    q, w = np.array(y[:26]), np.array(y[26:])
    moved = posed(q + 1j * TINY * np.eye(26))
    by_places, by_wheels, by_closures, by_springs = [part.imag / TINY for part in moved]
    wheels, springs = moved[1][0].real, moved[3][0].real
    ahead, behind, now = [[part.imag / TINY for part in posed(q + step * w + 1j * TINY * w)] for step in (1e-5, -1e-5, 0)]
    bent = [(one - other) / 2e-5 for one, other in zip(ahead, behind)]
    masses = np.einsum("ipc,jpc,p->ij", by_places, by_places, PARTICLES)
    force = -np.einsum("ipc,pc,p->i", by_places, bent[0] + 9.81 * Z, PARTICLES)
    for corner, (height, rate) in enumerate(ROADS):
        grip = POST_LOAD + 200e3 * (height * math.sin(2 * math.pi * rate * t) - wheels[corner, 2] + 0.3)
        shake = 0.2 * math.sin(2 * math.pi * 1.3 * t) if corner < 2 else 0
        aside, across = now[1][corner, :2]
        force += by_wheels[:, corner] @ [-3e3 * aside, -3e3 * (across - shake), grip]
        force += by_springs[:, corner] * (60e3 * (0.648 - springs[corner]) - 4e3 * now[3][corner])
    system = np.block([[masses, by_closures], [by_closures.T, np.zeros((16, 16))]])
    return [*w, *np.linalg.solve(system, np.concatenate([force, -bent[2]]))[:26]]
