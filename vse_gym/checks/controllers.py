"""What every controller promises."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from vse_gym.checks.blocks import COMMON_CHECKS, check_is_symmetric
from vse_gym.controllers.base import Controller
from vse_gym.models import Nominal
from vse_gym.probing import Block, require, who
from vse_gym.types import CHANNELS, WHEELS, BrakeDemand, Estimate, Reading


def check_demand_is_feasible(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> None:
    """On a drive ``added`` lies between 0 and the brakes' caps, and ``release`` in [0, 1], as float arrays (4,)."""
    _is_feasible(controller, nominal, estimates, readings)


def check_answers_any_estimate(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> None:
    """The demand stays feasible for every finite estimate, however wild: standing, backwards, spinning."""
    extremes = itertools.product((0.0, -5.0, 1e-9, 80.0), (0.0, 40.0, -40.0), (0.0, 5.0, -5.0), (0.0, 30.0, -30.0))
    wild = [Estimate(vx, vy, yaw_rate, 0.0, ay) for vx, vy, yaw_rate, ay in extremes]
    _is_feasible(controller, nominal, wild, list(itertools.islice(itertools.cycle(readings), len(wild))))


def _is_feasible(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> None:
    for k, demand in enumerate(Block(controller, nominal, [estimates, readings]).drive()):
        told = f"{who(controller)}, for vx, vy, yaw_rate, ax, ay = {estimates[k][:5]}: {demand}"
        require(isinstance(demand, BrakeDemand), f"{told}, expected a BrakeDemand.")
        for array in demand:
            shaped = isinstance(array, np.ndarray) and array.shape == (4,) and array.dtype == np.float64
            require(shaped, f"{told}, expected arrays of four floats.")
        caps = nominal.vehicle.brake_caps
        within = bool(np.all((demand.added >= 0) & (demand.added <= caps * (1 + 1e-12))))
        require(within, f"{told}, expected added between 0 and the caps {caps}: clip it.")
        within = bool(np.all((demand.release >= 0) & (demand.release <= 1)))
        require(within, f"{told}, expected release in [0, 1]: clip it.")


def check_leaves_straight_driving_alone(
    controller: Controller, nominal: Nominal, estimates: Sequence[Estimate], readings: Sequence[Reading]
) -> None:
    """Going straight at any speed, undisturbed, nothing is braked and nothing released."""
    for speed in (0.0, 1.0, 10.0, nominal.speed, 60.0):
        y = np.zeros(len(CHANNELS))
        y[WHEELS] = speed / nominal.vehicle.wheel_radius
        straight = [Reading(k * nominal.dt, np.zeros(9), y) for k in range(round(2 / nominal.dt))]
        seen = [Estimate(speed, 0.0, 0.0, 0.0, 0.0)] * len(straight)
        for demand in Block(controller, nominal, [seen, straight]).drive():
            told = f"{who(controller)} asks for {demand} going straight at {speed} m/s"
            require(not (demand.added.any() or demand.release.any()), f"{told}, expected nothing: add a dead band.")


CONTROLLER_CHECKS: tuple[Callable[..., None], ...] = (
    check_demand_is_feasible,
    check_answers_any_estimate,
    check_leaves_straight_driving_alone,
    *COMMON_CHECKS,
    check_is_symmetric,
)
