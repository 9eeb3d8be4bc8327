"""How well the brake unit's ABS stops a car: a foot hard on the pedal, on uniform and on split friction.

    python benchmarks/abs.py
    python benchmarks/abs.py --cars qin2014 bmw_320i

Stopping distances from 80 km/h [m]: with locked wheels (ABS off), with the ABS on true speeds and on those of ``ekf``,
and with the best constant slip: a fictitious unit holds every wheel at one slip, the best of a scan; its torque rises
no faster than the hydraulics let the driver's. On split friction (left 0.9, right 0.3) a driver holds the heading;
below are the largest heading deviations, his and with the hand wheel left straight, without and with stability control,
whose brake demand may release the driver's torque.
"""

import argparse
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vse_gym.controllers.esc import StabilityControl
from vse_gym.manoeuvres.base import Manoeuvre, Verdict
from vse_gym.models import Nominal
from vse_gym.physics import parameters as p
from vse_gym.physics.brakes import BrakeUnit
from vse_gym.physics.double_track import CONTACT, FX, contact, wheel_velocity
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout
from vse_gym.types import Car, Driver, Log

CARS = ("qin2014", "qin2014_understeer", "tian2018_electric", "bmw_320i")
SURFACES = ((0.9, 0.9), (0.4, 0.4), (0.2, 0.2), (0.9, 0.3))  # left, right
SLIPS = (0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2)
PANIC = np.array([3000.0, 3000.0, 1500.0, 1500.0])  # what the driver asks for [N m]
FOOT = 0.1  # when [s]
UNIT = BrakeUnit()
LOCKED = UNIT._replace(slip=9.0, slip_added=9.0, enter=math.inf)
AT_ONCE = LOCKED._replace(dead_time=0.0, lag=1e-6, rise=math.inf, fall=math.inf, slowest=0.0)
STEERING = 0.8
LOST = math.radians(30)  # heading from which nobody would speak of stopping [rad]


@dataclass(frozen=True)
class Stop(Manoeuvre):
    """Full braking; the driver keeps straight on if he steers, 0.15 s late and at most 10 rad/s fast."""

    right: float = 0.9  # friction under the right wheels [-]
    steering: float = 0.0  # road-wheel angle per heading; 0: the hand wheel straight [-]
    duration: float = 25.0

    def road(self) -> p.Road:
        return p.road((0.0, self.friction))._replace(friction_right=np.array([self.right]))

    def init(self, nominal: Nominal) -> Any:
        return nominal, (0.0,) * round(0.15 / nominal.dt), 0.0

    def drive(self, state: Any, time: float, car: Car) -> tuple[Driver, Any]:
        nominal, seen, hand_wheel = state
        if self.steering:
            wish = -nominal.vehicle.steering_ratio * self.steering * (car.yaw + 0.2 * car.yaw_rate + 0.03 * car.y)
            seen = (*seen, max(-2 * math.pi, min(2 * math.pi, wish)))
            hand_wheel += max(-10 * nominal.dt, min(10 * nominal.dt, seen[0] - hand_wheel))
            seen = seen[1:]
        return Driver(hand_wheel, brake=PANIC * (time >= FOOT - 1e-9)), (nominal, seen, hand_wheel)

    def off_course(self, car: Car, vehicle: p.Vehicle) -> bool:
        return math.hypot(car.vx, car.vy) < 0.5

    def verdict(self, log: Log, nominal: Nominal) -> Verdict:
        return Verdict(())


@dataclass(frozen=True)
class ConstantSlip(Stop):
    """Every wheel held at one slip, with knowledge of everything."""

    slip: float = 0.1

    def init(self, nominal: Nominal) -> Any:
        return super().init(nominal), np.zeros(4)

    def drive(self, state: Any, time: float, car: Car) -> tuple[Driver, Any]:
        (nominal, *_), built = state
        driver, own = super().drive(state[0], time, car)
        vehicle, dt, x = nominal.vehicle, nominal.dt, car.state
        wish = PANIC * (time >= FOOT + UNIT.dead_time - 1e-9)
        built = built + np.minimum(UNIT.rise * dt, -math.expm1(-dt / UNIT.lag) * (wish - built))
        wheels, torques = np.empty((4, CONTACT)), built.copy()
        steer = driver.hand_wheel / vehicle.steering_ratio
        contact(vehicle, self.road(), x, steer, wheels)
        for i in range(4):
            along, _ = wheel_velocity(vehicle, i, car.vx, car.vy, car.yaw_rate, steer)
            if along > UNIT.slowest:
                target = (1 - self.slip) * along / vehicle.wheel_radius
                slowing = (car.wheel_speeds[i] - target) / 0.005 - (1 - self.slip) * car.ax / vehicle.wheel_radius
                torque = -vehicle.wheel_radius * wheels[i, FX] + vehicle.wheel_inertia * slowing
                torques[i] = max(0.0, min(built[i], torque))
        return driver._replace(brake=torques), (own, built)


def stop(
    car: str, test: Stop, unit: BrakeUnit = UNIT, estimator: Any = "truth", law: Any = "none"
) -> tuple[float, float]:
    """Distance from the foot on the pedal to standstill [m], NaN if the car turned away; largest |heading| [rad]."""
    cell = scenario(test, car, "gaussian")
    if isinstance(test, ConstantSlip):
        cell = replace(cell, nominal=replace(cell.nominal, dt=cell.substep))
    log = rollout(replace(cell, brake_unit=unit), estimator, law, seed=0)
    turned = float(np.abs(log.truth[:, p.YAW]).max())
    way = float(log.truth[-1, p.DISTANCE]) - FOOT * test.speed
    return (way if turned < LOST and log.ended == "off course" else math.nan), turned


def main() -> None:
    """Drive and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cars", nargs="+", default=CARS)
    args = parser.parse_args()
    print("car                  friction   locked  ABS truth  ABS ekf  best slip       ratio    ekf")
    for car in args.cars:
        for left, right in SURFACES:
            steering = 0.0 if left == right else STEERING
            test = Stop(friction=left, right=right, steering=steering)
            locked, true, told = (stop(car, test, *how)[0] for how in ((LOCKED,), (UNIT,), (UNIT, "ekf")))
            scan = {}
            for slip in SLIPS:
                held = ConstantSlip(friction=left, right=right, steering=steering, slip=slip)
                scan[slip] = stop(car, held, AT_ONCE)[0]
            best = min(scan, key=lambda s: math.inf if math.isnan(scan[s]) else scan[s])
            print(
                f"{car:20s} {left}/{right} {locked:10.1f} {true:10.1f} {told:8.1f} {scan[best]:10.1f} at {best:4.2f}",
                end="",
            )
            print(f"{true / scan[best]:9.3f}{told / scan[best]:9.3f}")
    print("\nsplit friction, largest |heading| [deg] and distance: hands off, then steered")
    print(f"{'car':20s}" + "".join(f"{who:>19s}" for who in ("none", "esc", "esc, no release", "none", "esc")))
    laws = ("none", "esc", StabilityControl(whole_release=math.inf))
    for car in args.cars:
        ways = [stop(car, Stop(friction=0.9, right=0.3), law=law) for law in laws]
        ways += [stop(car, Stop(friction=0.9, right=0.3, steering=STEERING), law=law) for law in laws[:2]]
        print(f"{car:20s}" + "".join(f"{math.degrees(turned):8.1f} ({way:6.1f} m)" for way, turned in ways))


if __name__ == "__main__":
    main()
