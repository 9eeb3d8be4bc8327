"""CommonRoad's multi-body model as we found it, and what the files of its cars take from it.

The frozen table holds derivatives of library version 3.0.2 with its own parameters; write it anew, after a look at
what the library changed, with ``python tests/test_multibody_library.py``.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from vehiclemodels.init_mb import init_mb
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

from vse_gym.multibody import CARS, MultiBody, parameters
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import advance, rolling_start
from vse_gym.vehicles import load

TABLE = Path(__file__).parent / "golden" / "commonroad_mb.json"
every_car = pytest.mark.parametrize("name", CARS)

# steer, speed, heading, yaw rate, sideslip; steering rate, acceleration: straight, turning left and right, sliding,
# braking, driving, and the library's kinematic model below 0.1 m/s
CASES = (
    (0.0, 22.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.03, 22.0, 0.5, 0.2, -0.01, 0.1, 0.0),
    (-0.05, 15.0, -1.0, -0.3, 0.02, -0.3, 1.5),
    (0.10, 20.0, 2.0, 0.6, -0.4, 0.0, -4.0),
    (0.02, 0.05, 0.1, 0.0, 0.0, 0.05, 0.5),
)
STATES = 29
WHEELS = slice(23, 27)


def derivative(name, x, u):
    return vehicle_dynamics_mb(list(x), list(u), setup_vehicle_parameters(CARS[name]))  # it edits its arguments


def freeze():
    """Derivatives at each case with every other state away from rest by a seeded draw of a believable size."""
    rng = np.random.default_rng(0)
    size = np.full(STATES, 0.01)
    size[[16, 21]] = 0.002  # deflection of the tyres, some 2 cm at rest [m]
    size[[27, 28]] = 0.003  # shift of the axles [m]
    size[:6] = size[10] = 0.0  # given by the case
    rows = []
    for name in CARS:
        for *core, steering_rate, acceleration in CASES:
            x = np.array(init_mb([0.0, 0.0, *core], setup_vehicle_parameters(CARS[name])), dtype=float)
            x += size * rng.uniform(-1, 1, STATES)
            x[WHEELS] *= rng.uniform(0.9, 1.02, 4)
            u = [steering_rate, acceleration]
            rows.append({"car": name, "x": x.tolist(), "u": u, "dx": derivative(name, x.tolist(), u)})
    return {"commonroad-vehicle-models": "3.0.2", "rows": rows}


@every_car
def test_the_library_still_computes_what_it_did(name):
    rows = [row for row in json.loads(TABLE.read_text())["rows"] if row["car"] == name]
    assert len(rows) == len(CASES)
    for row in rows:  # another libm may round sines otherwise
        np.testing.assert_allclose(derivative(name, row["x"], row["u"]), row["dx"], rtol=1e-9, atol=1e-9)


@every_car
def test_a_car_of_its_file_has_the_library_s_numbers(name):
    assert parameters(load(name)) == setup_vehicle_parameters(CARS[name])


def steady_turn(q):
    """Roll of the body and of both axles per lateral acceleration [rad s2/m], outwards positive: the library's
    equations for the sprung mass and each axle, linear and at rest in a turn.

    The joints of an axle carry its share of the body, which leans into them; the axle leans on its tyres, and the
    tyres shift sideways under it (K_lt).
    """
    wheelbase = q.a + q.b
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    matrix[0, 0] = -q.m_s * p.GRAVITY * (q.h_s - q.h_raf)
    right[0] = q.m_s * (q.h_s - q.h_raf)
    for i, (arm, unsprung, track, spring, bar, joint) in enumerate(axles(q), 1):
        springs, tyres = 0.5 * track**2 * spring - bar, 0.5 * track**2 * q.K_zt  # N m/rad; bars are negative there
        body = q.m_s * arm / wheelbase
        weight, force = (body + unsprung) * p.GRAVITY, q.m * arm / wheelbase
        matrix[0, 0] += springs
        matrix[0, i] = -springs
        matrix[i, 0] = -springs + body * p.GRAVITY * (q.R_w - joint)
        matrix[i, i] = springs + tyres - q.R_w * weight
        radius = q.R_w - weight / (2 * q.K_zt)
        right[i] = force * (radius + q.K_lt * weight / 2) - (force - unsprung) * (q.R_w - joint)
    return np.linalg.solve(matrix, right)


def axles(q):
    return (
        (q.b, q.m_uf, q.T_f, q.K_sf, q.K_tsf, q.h_raf),
        (q.a, q.m_ur, q.T_r, q.K_sr, q.K_tsr, q.h_rar),
    )


def effective_stiffness(q):
    """Cornering stiffness of a front and a rear tyre with the camber that roll brings [N/rad].

    A tyre's force per load is K (alpha + c gamma), and in a steady turn gamma is in proportion to that force.
    """
    body, *leans = steady_turn(q)
    pure = -q.tire.p_ky1
    thrust = q.tire.p_hy3 - q.tire.p_vy3 / pure  # c: slip angle that a camber angle is worth [-]
    out = []
    for (arm, unsprung, track, *_), gain, lean in zip(axles(q), (q.D_f, q.D_r), leans, strict=True):
        weight = (q.m_s * arm / (q.a + q.b) + unsprung) * p.GRAVITY
        camber = body + gain * 0.5 * track * (body - lean)  # per lateral acceleration, as the next
        force = q.m * arm / (q.a + q.b) / weight
        out.append(0.5 * pure * weight / (1 - pure * thrust * camber / force))
    return out


@every_car
def test_the_files_cornering_stiffness_is_derived_from_the_library_s_springs_and_camber(name):
    car = load(name)
    ours = car.front_tyre.cornering_stiffness, car.rear_tyre.cornering_stiffness
    assert ours == pytest.approx(effective_stiffness(setup_vehicle_parameters(CARS[name])), rel=1e-5)  # as written


@every_car
def test_the_body_rolls_in_a_gentle_turn_as_its_springs_say(name):
    # What the derivation stands on, against the library itself: 1.5 m/s2, where sines are still angles.
    car = load(name)
    plant = MultiBody(car, p.road((0.0, 1.0)))
    bodies, state = plant.start(15.0)
    steer = 1.5 * car.wheelbase / 15.0**2
    for _ in range(400):
        bodies, state = plant.advance(bodies, state, p.Inputs(steer, np.zeros(4), np.zeros(4)), 0.01)
    assert state[p.ROLL] / state[p.AY] == pytest.approx(steady_turn(plant.library)[0], rel=0.02)


@every_car
def test_without_camber_both_plants_turn_alike(name):
    # So that what is left between them below the limit is the camber, which comes late, with the body's roll.
    car, road, held = load(name), p.road((0.0, 0.8)), np.zeros(4)
    plant = MultiBody(car, road)
    tyre = replace(plant.everywhere.tire, p_hy3=0.0, p_vy3=0.0)
    object.__setattr__(plant, "everywhere", replace(plant.everywhere, tire=tyre))
    bare = {}
    for axle, (arm, unsprung, *_) in zip(("front_tyre", "rear_tyre"), axles(plant.library), strict=True):
        weight = (plant.library.m_s * arm / car.wheelbase + unsprung) * p.GRAVITY
        bare[axle] = getattr(car, axle)._replace(cornering_stiffness=-0.5 * tyre.p_ky1 * weight)
    other = car._replace(**bare)
    (bodies, state), stiff = plant.start(22.0), rolling_start(car, 22.0)
    yaw_rates = []
    for k in range(250):
        inputs = p.Inputs(0.02 * np.sin(np.pi * 0.01 * k), held, held)
        bodies, state = plant.advance(bodies, state, inputs, 0.01)
        stiff = advance(other, road, stiff, inputs, 10, 1e-3)
        yaw_rates.append((state[p.YAW_RATE], stiff[p.YAW_RATE]))
    ours, theirs = np.array(yaw_rates).T
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.005 * np.abs(ours).max()  # 1.5 % and more with camber


if __name__ == "__main__":
    TABLE.write_text(json.dumps(freeze(), indent=1) + "\n")
