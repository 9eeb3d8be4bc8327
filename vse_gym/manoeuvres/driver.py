"""What a driver has practised with his car: the gains of optimal preview steering, and what his pedals do."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vse_gym.manoeuvres.script import FASTEST, SLOWEST, Arms, Pedals
from vse_gym.physics.parameters import GRAVITY, Vehicle
from vse_gym.types import Array

DEG = math.pi / 180
FIRM = 0.8 * GRAVITY  # deceleration for which the brakes are balanced [m/s2]
FOOT = 0.3  # time constant of the driver's foot (chosen) [s]


class Skill(NamedTuple):
    """What the gains follow from, beside the car."""

    reach: tuple[float, ...]  # times of the preview points, evenly spaced [s]
    calm: float  # price of the rate of the wanted road-wheel angle, beside an offset from the line [m s/rad]
    heading: float  # price of the speed at which the heading leads away from the line, beside an offset [s]
    lag: float  # of arms and hands [s]
    delay: int  # from seeing to acting [steps]
    dt: float  # [s]


@lru_cache(maxsize=128)
def practised(vehicle: Vehicle, skill: Skill) -> Array:
    """Gains at every practised speed, by linear quadratic optimal preview, (speeds, preview points + 4 + delay).

    Sharp & Valtetsiotis (2001), "Optimal preview car steering control", Vehicle System Dynamics 35 suppl., 101-117. The
    driver knows his car (its linear single track), his delay and his lag. A row times what he sees and feels is the
    road-wheel angle that he wants: the offset of the line at each preview point [m], lateral speed [m/s], yaw rate
    [rad/s], road-wheel angle [rad], and the angles decided on and not yet begun [rad].
    """
    speeds = np.arange(SLOWEST, FASTEST + 1.0)
    f, b = stepped(vehicle, skill, speeds)
    prices = np.zeros((speeds.size, 6))
    prices[:, 0], prices[:, 1] = 1.0, (skill.heading * speeds) ** 2
    price = (skill.calm / skill.dt) ** 2
    cost = riccati(f, b, prices, price)
    table = np.ascontiguousarray(_rows(skill, speeds, f, prices, cost, b, price))
    table.flags.writeable = False
    return table


def stepped(vehicle: Vehicle, skill: Skill, speeds: Array) -> tuple[Array, Array]:
    """The car with the driver's arms in steps: z' = F z + b times the change of the angle decided on, no delay.

    z is the offset, the heading, lateral speed, yaw rate, road-wheel angle, and the angle decided on a step ago, which
    begins now. F is (speeds, 6, 6), b (6,).
    """
    front, rear = 2 * vehicle.front_tyre.cornering_stiffness, 2 * vehicle.rear_tyre.cornering_stiffness
    lf, lr, m, inertia, v = vehicle.lf, vehicle.lr, vehicle.mass, vehicle.yaw_inertia, speeds
    a = np.zeros((v.size, 6, 6))
    a[:, 0, 1], a[:, 0, 2], a[:, 1, 3] = v, 1.0, 1.0
    a[:, 2, 2], a[:, 2, 3], a[:, 2, 4] = -(front + rear) / (m * v), -v - (lf * front - lr * rear) / (m * v), front / m
    a[:, 3, 2], a[:, 3, 3] = -(lf * front - lr * rear) / (inertia * v), -(lf**2 * front + lr**2 * rear) / (inertia * v)
    a[:, 3, 4], a[:, 4, 4], a[:, 4, 5] = lf * front / inertia, -1 / skill.lag, 1 / skill.lag
    # The exponential, all speeds at once: Taylor's series of a fraction of the step, then squared
    halvings, power = 4, np.broadcast_to(np.eye(6), a.shape)
    f = power.copy()
    for k in range(1, 13):
        power = power @ a * (skill.dt / 2**halvings / k)
        f += power
    for _ in range(halvings):
        f = f @ f
    return f, np.eye(6)[5]


def riccati(f: Array, b: Array, prices: Array, price: float) -> Array:
    """Cost-to-go of the linear quadratic regulator at each speed, by doubling, (speeds, 6, 6).

    Chu, Fan, Lin & Wang (2004), International Journal of Control 77(8), 767-788. All speeds at once, for libraries
    spend on each small matrix what a loaded machine's threads make of it.
    """
    one = np.eye(b.size)
    g, h = np.broadcast_to(np.outer(b, b) / price, f.shape), prices[:, :, None] * one
    for _ in range(20):  # each doubles the horizon: 2^20 steps are the infinite one
        across = np.swapaxes(f, 1, 2)
        w = np.linalg.inv(one + g @ h)
        g, h, f = g + f @ w @ g @ across, h + across @ h @ w @ f, f @ w @ f
    return h


def _rows(skill: Skill, v: Array, f: Array, prices: Array, cost: Array, b: Array, price: float) -> Array:
    """Rows of gains. With a delay the best is to do what would be best without, in the state that will be then."""
    scale = price + cost @ b @ b
    prompt = (b @ cost)[:, None] @ f / scale[:, None, None]  # (speeds, 1, 6)
    then = np.tile(np.eye(6, 6 + skill.delay), (v.size, 1, 1))  # from what is and is on its way to what will be
    then[:, 5] = 0.0
    then[:, 5, -1] = 1.0
    for k in range(skill.delay):
        then[:, :5] = f[:, :5, :5] @ then[:, :5]
        then[:, :5, 5 + k] += f[:, :5, 5]
    gain = (prompt @ then)[:, 0]
    # What one metre of offset, and one radian of heading, of the line k steps ahead ask for now
    steps = round(skill.reach[-1] / skill.dt)
    asks, closed = np.zeros((steps + 2, v.size, 2)), np.swapaxes(f - b[:, None] * prompt, 1, 2)
    pull = (prices[:, :, None] * np.eye(6))[:, :, :2]
    for k in range(skill.delay + 1, steps + 1):
        asks[k] = pull[:, -1] / scale[:, None]
        pull = closed @ pull
    fine = asks[..., 0] - np.gradient(asks[..., 1], axis=0) / (v * skill.dt)  # the line's heading is its slope
    # Shared out between the preview points before and behind
    at = np.clip(np.arange(steps + 2.0) * skill.dt / skill.reach[0] - 1, 0.0, len(skill.reach) - 1.0)
    ahead = np.maximum(0.0, 1 - np.abs(at - np.arange(len(skill.reach))[:, None])) @ fine
    gain[:, -1] -= 1.0  # from the change of the angle to the angle
    return np.hstack((ahead.T, -gain[:, 2:]))


@dataclass(frozen=True)
class Steering:
    """Preview steering with a reaction delay, a neuromuscular lag, and arms of finite speed and reach.

    All tunings are chosen, alike for every car: so that each clears the double lane change of ISO 3888-1 on dry road at
    90 km/h or nearly so, and none sways at any speed below its critical one with a delay 30 ms longer.

    Raises:
        ValueError: If a tuning is not positive, or there are fewer than two preview points.
    """

    preview: float = 2.2  # how far ahead he looks [s]
    points: int = 22  # at so many points
    calm: float = 0.2  # [m s/rad]
    heading: float = 0.1  # [s]
    delay: float = 0.10  # from seeing to acting [s]
    lag: float = 0.08  # of arms and hands [s]
    rate: float = 900 * DEG  # fastest turning of the hand wheel [rad/s]
    limit: float = 400 * DEG  # largest angle of the hand wheel [rad]

    def __post_init__(self) -> None:
        for name in ("preview", "calm", "lag", "rate", "limit"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")
        if not (0 <= self.delay < math.inf and 0 <= self.heading < math.inf and self.points >= 2):
            raise ValueError(f"delay and heading must not be negative and points at least 2, not {self}")

    def arms(self, vehicle: Vehicle, dt: float) -> Arms:
        """What compiled code needs of the driver, in a car that he knows and acts in every dt seconds."""
        reach = tuple(self.preview * (k + 1) / self.points for k in range(self.points))
        skill = Skill(reach, self.calm, self.heading, self.lag, round(self.delay / dt), dt)
        gains = practised(vehicle, skill).copy()
        gains[:, : self.points + 2] *= vehicle.steering_ratio  # of road-wheel angles and of hand-wheel angles alike
        return Arms(gains, np.array(reach), 1 - math.exp(-dt / self.lag), self.rate * dt, float(self.limit))


DRIVER = Steering()


def pedals(vehicle: Vehicle, dt: float) -> Pedals:
    """The pedals of a car, for a driver who acts every dt seconds."""
    torque = 0.5 * vehicle.mass * vehicle.wheel_radius
    front = vehicle.front_drive
    load = min(1.0, (vehicle.lr + FIRM / GRAVITY * vehicle.height) / vehicle.wheelbase)
    drive, brake = torque * np.array([[s, s, 1 - s, 1 - s] for s in (front, load)])
    return Pedals(drive, brake, 1 - math.exp(-dt / FOOT))
