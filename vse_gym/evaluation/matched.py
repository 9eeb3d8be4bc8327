"""Matched drives: drawn from an estimator's own model, where the least possible error is known.

The steering is that of an ordinary drive. The car is the model itself, moved by its own process noise from its own
prior, and sensors add noise by their own law; so what separates an estimator from the posterior Cramer-Rao bound is
the estimator alone, not a wrong model.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from time import perf_counter
from typing import Any

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.cells import Cell
from vse_gym.evaluation.contenders import Contender
from vse_gym.evaluation.runs import Row, heading, shadow_columns, took
from vse_gym.evaluation.study import Study
from vse_gym.inference.bound import Expectations, bound, draw_states, expectations
from vse_gym.inference.model import heed, observe
from vse_gym.models import DoubleTrackTuning, ModelTuning, SingleTrackTuning
from vse_gym.noise import contamination, fisher_information
from vse_gym.physics import parameters as p
from vse_gym.scenarios import Scenario
from vse_gym.sensors import SUITES, Sensors, stream
from vse_gym.simulation import rollout
from vse_gym.types import CHANNELS, U_STEER, Y_AX, Y_AY, Y_ROLL_RATE, Y_YAW_RATE, Array, Log

# Nothing stands for a wrong model, for there is none. Per step the process noise is of the size of what the loud set's
# readings of that step tell, so that neither decides alone.
TRUST: dict[str, Any] = {
    "vx_noise": 0.2,
    "vy_noise": 0.3,
    "yaw_noise": 0.1,
    "vx_prior": 0.5,
    "vy_prior": 0.2,
    "yaw_prior": 0.02,
}
EXACT: dict[str, Any] = {"ax_error": 0.0, "ay_error": 0.0, "yaw_rate_error": 0.0, "wheel_error": 0.0, "slip": 0.0}
TUNINGS: dict[type, Any] = {kind: kind(**TRUST, **EXACT) for kind in (SingleTrackTuning, DoubleTrackTuning)}

INERTIAL = [Y_AX, Y_AY, Y_YAW_RATE, Y_ROLL_RATE]  # channels that a suite's alpha makes heavy-tailed
SAMPLES, BATCHES = 400, 8  # drives that the bound's expectations are averaged over, and parts to see their error
# Settings of sensors that leave the noise's law, and what they do to a reading
SPOILS = {
    "growth": "grows",
    "acceleration_bias": "has a bias",
    "yaw_rate_bias": "has a bias",
    "acceleration_walk": "has a bias that walks",
    "yaw_rate_walk": "has a bias that walks",
    "burst_rate": "comes in bursts",
    "silence_rate": "drops out",
    "delay": "is late",
    "resolution": "is rounded",
    "freedom": "is Student's, which no estimator expects",
}


@dataclass(frozen=True)
class Bound:
    """Least root mean square error of a drive, over its time and over all drives of a cell."""

    sideslip: float  # [rad]
    vx: float  # [m/s]
    error: float  # standard error of the sideslip's, by Monte Carlo, relative [-]


def noise_information(sensors: Sensors) -> Array:
    """Fisher information of each channel's noise, times the sheet's variance, (10,) [-].

    Raises:
        ValueError: If the noise is not independent from one reading to the next, or has no law that a bound can use.
    """
    if why := _spoilt(sensors):
        known = ", ".join(name for name, known in SUITES.items() if not _spoilt(known))
        raise ValueError(
            f"no bound is known for these sensors, as their noise {why}; it must be of one known law and independent "
            f"from one reading to the next, as that of {known}"
        )
    out = np.ones(len(CHANNELS))
    out[INERTIAL] = fisher_information(contamination(sensors.alpha, sensors.alpha_rule))
    return out


def _spoilt(sensors: Sensors) -> str:
    """What makes the noise unfit for a bound; empty: nothing does. The range does not count: it is left out."""
    if not sensors.noise:
        return "is switched off"
    return next((why for name, why in SPOILS.items() if getattr(sensors, name) != getattr(Sensors, name)), "")


@lru_cache(maxsize=64)
def steering(scenario: Scenario) -> Array:
    """Inputs of the readings (T, 9) of the drive with true states and no control: the road wheels' angle, exactly.

    Torques are left out. A wheel under torque slips, and its speed is input and reading of a double track at once,
    which no bound foresees.
    """
    log = rollout(scenario, "truth", "none", 0)
    inputs = np.zeros_like(log.inputs)
    inputs[:, U_STEER] = log.steer
    return inputs


def matched_drive(scenario: Scenario, tuning: ModelTuning, seed: int) -> Log:
    """A drive of the model itself, as a log of which only what :func:`shadow` reads is filled.

    States and noise come from streams of their own: every estimator over the same model meets the same drive, and
    models of one size the same draws.

    Raises:
        ValueError: If the noise is not independent from one reading to the next.
    """
    noise_information(scenario.sensors)
    model, inputs = tuning.build(scenario.nominal), steering(scenario)
    steps, none = len(inputs), np.zeros((len(inputs), 4))
    unheard = np.full((steps, len(CHANNELS)), np.nan)
    states = draw_states(model, inputs, unheard, 1, stream(seed, "matched/states"))[1:]
    held = [heed(model, u, y) for u, y in zip(inputs, unheard, strict=True)]
    clean = np.array([observe(model, x, u)[:, 0] for x, u in zip(states, held, strict=True)])
    record = scenario.sensors.record(steps, scenario.dt, seed)
    readings = np.where(record.silent, np.nan, clean + record.added)
    truth = np.zeros((steps, p.STATE_SIZE))
    truth[:, [p.VX, p.VY, p.YAW_RATE]], truth[:, [p.AX, p.AY]] = states[:, :, 0], clean[:, Y_AX : Y_AX + 2]
    return Log(
        time=scenario.dt * np.arange(steps, dtype=float),
        truth=truth,
        hand_wheel=inputs[:, U_STEER] * scenario.vehicle.steering_ratio,
        steer=inputs[:, U_STEER],
        inputs=inputs,
        readings=readings,
        estimate=np.full((steps, 5), np.nan),
        cov=np.full((steps, 3, 3), np.nan),
        brake=none,
        added=none,
        release=none,
        friction=np.full(steps, scenario.nominal.friction),
        ended="",
        filled=(),
    )


@lru_cache(maxsize=64)
def matched_bound(scenario: Scenario, tuning: ModelTuning, samples: int = SAMPLES) -> Bound:
    """The posterior Cramer-Rao bound of a model's drives, root of the mean over the drive's time.

    Args:
        scenario: Whose steering, sensors and nominal car are taken.
        tuning: Of the model.
        samples: Drives that expectations are averaged over, from a stream of their own.
    """
    model, inputs = tuning.build(scenario.nominal), steering(scenario)
    information, precision = noise_information(scenario.sensors), np.linalg.inv(model.process_cov)
    silent = scenario.sensors.record(len(inputs), scenario.dt, 0).silent
    readings, rng = np.where(silent, np.nan, 0.0), stream(0, "matched/bound")  # what is not read is all that counts

    def root_mean(*averages: Array) -> Array:
        *terms, slope = averages
        cov = bound(model.prior_cov, precision, Expectations(*terms))
        variances = np.einsum("ti,tij,tj->t", slope, cov, slope), cov[:, 0, 0]
        least: Array = np.sqrt(np.mean(variances, axis=1))
        return least

    parts = []
    for _ in range(BATCHES):
        states = draw_states(model, inputs, readings, samples // BATCHES, rng)
        terms = expectations(model, inputs, readings, states, precision, information)
        parts.append((*terms, _sideslip_slope(states[1:])))
    sideslip, vx = root_mean(*(np.mean(part, axis=0) for part in zip(*parts, strict=True)))
    spread = np.std([root_mean(*part)[0] for part in parts], ddof=1)
    return Bound(float(sideslip), float(vx), float(spread / math.sqrt(BATCHES) / sideslip))


def _sideslip_slope(states: Array) -> Array:
    """Mean derivative of atan2(vy, vx) with respect to vx, vy, yaw rate, (T, 3), over states (T, 3, N)."""
    vx, vy, square = states[:, 0], states[:, 1], states[:, 0] ** 2 + states[:, 1] ** 2
    slope: Array = np.mean([-vy / square, vx / square, np.zeros_like(vx)], axis=2).T
    return slope


def run_matched(study: Study, cell: Cell, seed: int, contenders: Sequence[Contender]) -> list[Row]:
    """Rows of one matched cell at one seed, one per estimator: errors in shadow, and the bound that they cannot beat.

    An estimator with a single or double track hears drives of that model and believes in it with their very process
    noise; if it expects a Cauchy share, it is the suite's. Any other listens, as it is, to the single track's drives.

    Raises:
        ValueError: If the sensors' noise is not independent from one reading to the next.
    """
    scenario = cell.scenario(study.randomise, seed)
    try:
        noise_information(scenario.sensors)
    except ValueError as error:
        raise ValueError(f"cell {cell.name!r}, sensors {cell.sensors!r}: {error}") from error
    head = heading(study, cell, seed)
    drives: dict[ModelTuning, Log] = {}
    rows = []
    for contender in contenders:
        begin = perf_counter()
        tuning = TUNINGS.get(type(getattr(contender.estimator, "model", None)), TUNINGS[SingleTrackTuning])
        if tuning not in drives:
            drives[tuning] = matched_drive(scenario, tuning, seed)
        log, least = drives[tuning], matched_bound(scenario, tuning)
        rows.append(
            head
            | contender.columns
            | {"model": type(tuning).__name__.removesuffix("Tuning")}
            | shadow_columns(log, matched(contender.estimator, scenario.sensors), scenario.nominal, seed)
            | {"bound_sideslip_deg": math.degrees(least.sideslip), "bound_vx_mps": least.vx}
            | {"bound_error_percent": 100 * least.error}
            | took(begin)
        )
    return rows


def matched(estimator: Estimator, sensors: Sensors) -> Estimator:
    """The estimator with the trust that its own model's drives are drawn with, and the sensors' Cauchy share."""
    settings: dict[str, Any] = {}
    if (kind := type(getattr(estimator, "model", None))) in TUNINGS:
        settings["model"] = TUNINGS[kind]
    if hasattr(estimator, "heavy"):
        settings["heavy"] = tuple(CHANNELS[k] for k in INERTIAL)
        share = contamination(sensors.alpha, sensors.alpha_rule)
        settings["alpha"] = math.sqrt(4 / (1 + 3 * share))  # whose share, by the filter's own rule, is that
    return replace(estimator, **settings) if settings else estimator  # type: ignore[type-var]
