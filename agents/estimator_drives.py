"""Drives that learned estimators are trained on, drawn by number.

A number is a drive: car, road, sensors, driver, control and noise all follow from it. Its seed is that number above
``FIRST``, which no study uses, and no car of the headline's is driven, so that none of its cells can occur.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from vse_gym.catalogue import MANOEUVRES
from vse_gym.evaluation import Study
from vse_gym.models import DataSheet, Nominal
from vse_gym.physics import parameters as p
from vse_gym.scenarios import Scenario, fitting_integrator
from vse_gym.sensors import QUIET, SUITES, Sensors, stream
from vse_gym.simulation import rollout
from vse_gym.vehicles import load, names

FIRST = 100_000  # the studies' seeds are all smaller, but for those that replace one, which begin at a million
MOST = 100_000  # drives that one seed of training may have
LOST = math.radians(40)  # sideslip from which on nobody need know how far a car has spun [rad]
TRUTH = (p.VX, p.VY, p.YAW_RATE, p.AX, p.AY)
HEADLINE = "headline-v1"
DEG, KMH = math.pi / 180, 1 / 3.6

# What is drawn; the sheet that goes with trained weights says it
RANGES: dict[str, tuple[float, float]] = {
    "speed_kmh": (35.0, 120.0),
    "friction": (0.2, 1.0),
    "mass_of_the_kind": (0.8, 1.3),  # times that of the file
    "balance": (0.36, 0.58),  # centre of gravity to front axle, over the wheelbase
    "grip_front": (9.0, 26.0),  # cornering stiffness over load [1/rad]
    "grip_rear": (1.0, 1.4),  # times that of the front
    "loaded": (1.0, 1.3),  # true mass over the one that is told
    "stiffness": (0.7, 1.05),  # true cornering stiffness over the one that is told
    "acceleration_noise": (0.03, 0.4),  # [m/s2]
    "yaw_rate_noise_deg": (0.05, 1.3),
    "wheel_noise": (0.02, 0.15),  # [rad/s]
}
CONTROLLERS = {"none": 0.2, "esc": 0.35, "sideslip_esc": 0.35, "lqr": 0.1}
SEEN_THROUGH = {"truth": 0.45, "ekf": 0.25, "ekf_cauchy_gaussian": 0.1, "kinematic": 0.1, "zero": 0.1}
DRIVES = {
    **{"sine_with_dwell": 0.2, "held_steer": 0.2, "double_lane_change": 0.14, "brake_in_turn": 0.14},
    **{"sine_steer": 0.06, "step_steer": 0.05, "slalom": 0.04, "obstacle_avoidance": 0.03, "gentle_curve": 0.04},
    **{"friction_jump": 0.04, "split_friction_braking": 0.03, "straight_driving": 0.03},
}


@lru_cache(maxsize=1)
def cars() -> list[str]:
    """The kinds of car that are driven: all but the headline's."""
    held_out = {cell.vehicle for cell in Study.load(HEADLINE).cells}
    return [name for name in names() if name not in held_out]


class Task(NamedTuple):
    """What is driven."""

    scenario: Scenario
    estimator: str
    controller: str
    seed: int


class Drive(NamedTuple):
    """What is kept of a drive, T instants; all in single precision."""

    number: int
    inputs: np.ndarray[Any, Any]  # of the readings, (T, 9)
    readings: np.ndarray[Any, Any]  # (T, 10), NaN where silent
    truth: np.ndarray[Any, Any]  # vx, vy, yaw rate, ax, ay, (T, 5)


def drawn(number: int) -> Task:
    """The drive of a number.

    Raises:
        ValueError: If there is no such number.
    """
    if not 0 <= number < 9 * MOST:
        raise ValueError(f"drives are numbered from 0 to {9 * MOST - 1}, not {number}")
    seed = FIRST + number
    rng = stream(seed, "training drive")
    told = _car(rng)
    manoeuvre, sensors = _manoeuvre(rng), _sensors(rng)
    driven = laden(told, rng)
    nominal = Nominal(told, sensors.sheet, max(1.0, manoeuvre.speed + rng.normal(0, 0.5)))
    scenario = Scenario(manoeuvre, driven, sensors, nominal, integrator=fitting_integrator(driven))
    return Task(scenario, _one_of(rng, SEEN_THROUGH), _one_of(rng, CONTROLLERS), seed)


def _between(rng: np.random.Generator, name: str) -> float:
    return float(rng.uniform(*RANGES[name]))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _one_of(rng: np.random.Generator, shares: dict[str, float]) -> str:
    weights = np.array(list(shares.values()))
    return list(shares)[rng.choice(len(shares), p=weights / weights.sum())]


def _car(rng: np.random.Generator) -> p.Vehicle:
    """A car as somebody would sell it: one of the kinds, with other masses, axles and tyres."""
    kinds = cars()
    car = load(kinds[rng.integers(len(kinds))])
    heavier, wheelbase = _between(rng, "mass_of_the_kind"), car.wheelbase * rng.uniform(0.93, 1.08)
    lf = wheelbase * _between(rng, "balance")
    lr, mass = wheelbase - lf, car.mass * heavier
    inertia = mass * lf * lr * rng.uniform(0.85, 1.15)
    front = _between(rng, "grip_front")
    grips, loads = (front, front * _between(rng, "grip_rear")), (lr, lf)
    law = rng.integers(3)  # the kind's own, or one that all cars may have
    tyres = []
    for own, grip, arm in zip((car.front_tyre, car.rear_tyre), grips, loads, strict=True):
        load_ = 0.5 * mass * p.GRAVITY * arm / wheelbase
        numbers = {"slip_stiffness": rng.uniform(18, 34) * load_, "cornering_stiffness": grip * load_}
        if law == 1:
            tyres.append(p.PolynomialTyre(**numbers, reference_load=load_))
        elif law == 2:
            shape = {"shape_x": 1.5, "shape_y": rng.uniform(1.25, 1.4), "curvature_x": 0.3, "curvature_y": -0.3}
            tyres.append(p.MagicFormulaTyre(**numbers, reference_load=load_, **shape, peak_x=1.05, peak_y=1.0))
        else:
            tyres.append(own._replace(**numbers, reference_load=load_))
    body = car.body
    if isinstance(body, p.RollingBody):
        body = body._replace(sprung_mass=body.sprung_mass * heavier)
    track = rng.uniform(0.95, 1.05)
    return car._replace(
        mass=mass,
        yaw_inertia=inertia,
        lf=lf,
        lr=lr,
        height=car.height * rng.uniform(0.9, 1.1),
        track_front=car.track_front * track,
        track_rear=car.track_rear * track,
        wheel_radius=car.wheel_radius * rng.uniform(0.93, 1.07),
        steering_ratio=rng.uniform(14, 18),
        front_transfer=rng.uniform(0.45, 0.65),
        front_drive=float(rng.choice([0.0, 0.5, 1.0], p=[0.4, 0.1, 0.5])),
        front_tyre=tyres[0],
        rear_tyre=tyres[1],
        body=body,
    )


def laden(told: p.Vehicle, rng: np.random.Generator) -> p.Vehicle:
    """The car as it is driven, of which nobody is told: laden, on other tyres, now and then out of true."""
    loaded, softer = _between(rng, "loaded"), _between(rng, "stiffness")
    tyres = [
        tyre._replace(cornering_stiffness=tyre.cornering_stiffness * softer * rng.uniform(0.97, 1.03))
        for tyre in (told.front_tyre, told.rear_tyre)
    ]
    body = told.body
    if isinstance(body, p.RollingBody):
        body = body._replace(sprung_mass=body.sprung_mass + told.mass * (loaded - 1))
    crooked = rng.random() < 0.3
    shift = crooked * rng.uniform(-0.05, 0.05)
    return told._replace(
        mass=told.mass * loaded,
        body=body,
        front_tyre=tyres[0],
        rear_tyre=tyres[1],
        lf=told.lf + shift,
        lr=told.lr - shift,
        steering_offset=crooked * rng.normal(0, 0.2 * DEG),
        radius_error=p.PerWheel(*(crooked * rng.uniform(-0.01, 0.01, 4)).tolist()),
    )


def _sensors(rng: np.random.Generator) -> Sensors:
    """One of the suites, or a cluster whose noise and faults are drawn."""
    if rng.random() < 0.5:
        return SUITES[list(SUITES)[rng.integers(len(SUITES))]]
    sheet = DataSheet(
        _log(rng, *RANGES["acceleration_noise"]),
        _log(rng, *RANGES["yaw_rate_noise_deg"]) * DEG,
        _log(rng, *RANGES["wheel_noise"]),
        QUIET.steer,
        QUIET.brake,
    )
    faults: dict[str, float] = {}
    if rng.random() < 0.35:
        faults |= {"acceleration_bias": rng.uniform(0, 0.4), "yaw_rate_bias": rng.uniform(0, 0.4) * DEG}
    if rng.random() < 0.35:
        faults["burst_rate"] = rng.uniform(0.1, 1.2)
        faults |= {"acceleration_burst": rng.uniform(3, 10), "yaw_rate_burst": rng.uniform(10, 40) * DEG}
    if rng.random() < 0.25:
        faults["silence_rate"] = rng.uniform(0.1, 0.8)
    if rng.random() < 0.25:
        faults |= {"alpha": rng.uniform(1.2, 1.95), "acceleration_range": 20.0, "yaw_rate_range": 100 * DEG}
    if rng.random() < 0.15:
        faults["delay"] = rng.uniform(0.01, 0.04)
    return Sensors(sheet, **faults)


def _manoeuvre(rng: np.random.Generator) -> Any:
    name = _one_of(rng, DRIVES)
    slippery = rng.random() < 0.55
    low, high = RANGES["friction"]
    friction = rng.uniform(low, 0.55) if slippery else rng.uniform(0.55, high)
    side, speed = float(rng.choice([-1.0, 1.0])), _between(rng, "speed_kmh") * KMH
    some: dict[str, Any] = {"speed": speed, "friction": friction}
    if rng.random() < 0.2:
        some |= {"slope": rng.normal(0, 1.0 * DEG), "bank": rng.normal(0, 1.0 * DEG)}
    if name == "sine_with_dwell":
        some |= {"amplitude": side * _log(rng, 40, 300) * DEG, "frequency": rng.uniform(0.5, 0.9), "duration": 5.0}
    elif name == "held_steer":
        some |= {"amplitude": side * _log(rng, 15, 150) * DEG, "rate": rng.uniform(100, 500) * DEG, "duration": 5.5}
        if rng.random() < 0.6:
            after = rng.uniform(low, 0.6) if rng.random() < 0.75 else rng.uniform(0.5, high)
            some |= {"friction_after": after, "jump": rng.uniform(1.0, 3.0)}
    elif name == "brake_in_turn":
        brake = {"brake": rng.uniform(1.5, 3.5), "deceleration": rng.uniform(2.0, 9.0), "duration": 6.0}
        some |= brake | {"side": side, "radius": rng.uniform(60, 200)}
        if rng.random() < 0.7:
            some["amplitude"] = side * _log(rng, 15, 120) * DEG
    elif name == "sine_steer":
        some |= {"amplitude": side * _log(rng, 15, 180) * DEG, "period": rng.uniform(1.2, 5), "begin": 0.5}
        some |= {"stop": 6.0, "duration": 6.5}
    elif name == "step_steer":
        some |= {"amplitude": side * _log(rng, 10, 120) * DEG, "duration": 5.0}
    elif name in ("double_lane_change", "obstacle_avoidance"):
        some |= {"speed": rng.uniform(40, 90) * KMH}
    elif name == "slalom":
        some |= {"speed": rng.uniform(30, 65) * KMH, "duration": 7.0}
    elif name == "gentle_curve":
        some |= {"lateral": rng.uniform(0.5, 5.0), "side": side, "duration": 6.0}
    elif name == "friction_jump":
        some |= {"friction_after": rng.uniform(low, high), "jump": rng.uniform(1, 3), "lateral": rng.uniform(0.5, 3)}
        some |= {"side": side, "duration": 6.0, "deceleration": rng.uniform(2.0, 8.0)}
    elif name == "split_friction_braking":
        some |= {"friction_low": rng.uniform(low, 0.5), "side": side, "duration": 6.0}
    else:
        some["duration"] = 4.0
    return MANOEUVRES.make(name, **some)


def driven(number: int) -> Drive:
    """Drive it, as far as the car is not lost."""
    task = drawn(number)
    log = rollout(task.scenario, task.estimator, task.controller, task.seed)
    parts = (log.inputs, log.readings, log.truth[:, TRUTH])
    lost = np.flatnonzero(~(np.abs(log.sideslip) < LOST))  # not a number is lost too
    kept = lost[0] if lost.size else len(log.time)
    return Drive(number, *(part[:kept].astype(np.float32) for part in parts))
