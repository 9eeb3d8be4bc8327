"""The driver who follows a line and holds a speed: optimal preview steering with human limits, and two pedals."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vse_gym.manoeuvres.path import Path
from vse_gym.models import Nominal
from vse_gym.physics.parameters import GRAVITY, VX, VY, YAW, YAW_RATE, Vehicle, X, Y
from vse_gym.types import Array, Car

DEG = math.pi / 180
SLOWEST, FASTEST = 3, 60  # speeds that the driver has practised, every metre per second between them [m/s]
FASTEST_TURN = 10.0  # a car that turns faster is felt as if it turned so fast [rad/s]


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
    table = np.array([_row(skill, *each, b, price) for each in zip(speeds, f, prices, cost, strict=True)])
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


def _row(skill: Skill, v: float, f: Array, prices: Array, cost: Array, b: Array, price: float) -> Array:
    """A row of gains. With a delay the best is to do what would be best without, in the state that will be then."""
    scale = price + b @ cost @ b
    prompt = b @ cost @ f / scale
    then = np.eye(6, 6 + skill.delay)  # from what is and is on its way to what will be
    then[5] = 0.0
    then[5, -1] = 1.0
    for k in range(skill.delay):
        then[:5] = f[:5, :5] @ then[:5]
        then[:5, 5 + k] += f[:5, 5]
    gain = prompt @ then
    # What one metre of offset, and one radian of heading, of the line k steps ahead ask for now
    steps = round(skill.reach[-1] / skill.dt)
    asks, closed, pull = np.zeros((steps + 2, 2)), f - np.outer(b, prompt), np.diag(prices)[:, :2]
    for k in range(skill.delay + 1, steps + 1):
        asks[k] = pull[-1] / scale
        pull = closed.T @ pull
    fine = asks[:, 0] - np.gradient(asks[:, 1]) / (v * skill.dt)  # the line's heading is the slope of its offsets
    # Shared out between the preview points before and behind
    at = np.clip(np.arange(fine.size) * skill.dt / skill.reach[0] - 1, 0.0, len(skill.reach) - 1.0)
    ahead = np.maximum(0.0, 1 - np.abs(at - np.arange(len(skill.reach))[:, None])) @ fine
    gain[-1] -= 1.0  # from the change of the angle to the angle
    return np.concatenate((ahead, -gain[2:]))


class Hands(NamedTuple):
    """Where the driver's hands are, and what is on its way to them."""

    gains: Array  # at each practised speed, see practised()
    reach: Array  # times of the preview points [s]
    follow: float  # share of the way to the wanted angle that the arms make in a step [-]
    most: float  # change of the road-wheel angle that they can make in a step [rad]
    limit: float  # of the road-wheel angle [rad]
    pending: tuple[float, ...]  # road-wheel angles decided on, the oldest first [rad]
    angle: float  # of the road wheel [rad]


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

    def init(self, nominal: Nominal) -> Hands:
        """Hands at rest on a straight hand wheel."""
        dt, ratio = nominal.dt, nominal.vehicle.steering_ratio
        reach = tuple(self.preview * (k + 1) / self.points for k in range(self.points))
        skill = Skill(reach, self.calm, self.heading, self.lag, round(self.delay / dt), dt)
        follow, pending = 1 - math.exp(-dt / self.lag), (0.0,) * (skill.delay + 1)
        gains = practised(nominal.vehicle, skill)
        return Hands(gains, np.array(reach), follow, self.rate * dt / ratio, self.limit / ratio, pending, 0.0)

    def steer(self, hands: Hands, path: Path, car: Car) -> Hands:
        """The hands one step on."""
        gains, reach, follow, most, limit, pending, angle = hands
        state = car.state.tolist()
        speed = min(max(state[VX], SLOWEST), FASTEST)
        sideways = min(max(state[VY], -speed), speed)
        turning = min(max(state[YAW_RATE], -FASTEST_TURN), FASTEST_TURN)
        offsets = path.look(state[X], state[Y], state[YAW], speed * reach)
        low = min(int(speed) - SLOWEST, FASTEST - SLOWEST - 1)
        between = speed - SLOWEST - low  # two practised speeds
        felt = (sideways, turning, angle, *pending)
        slower, faster = (gains[low : low + 2] @ np.concatenate((offsets, felt))).tolist()
        wanted = min(max((1 - between) * slower + between * faster, -limit), limit)
        change = follow * (pending[0] - angle)
        angle += min(max(change, -most), most)
        return Hands(gains, reach, follow, most, limit, (*pending[1:], wanted), angle)


DRIVER = Steering()

FIRM = 0.8 * GRAVITY  # deceleration for which the brakes are balanced [m/s2]
# How the driver holds a speed (chosen). He reads a needle: a drive torque that followed the speed exactly would tell
# estimators, who know the torque, what no sensor does.
NEEDLE = 2 / 3.6  # speed to which the speedometer can be read [m/s]
STRONGEST = 2.5  # acceleration for which he presses at most [m/s2]
EAGER = 2.0  # acceleration that he wants for each metre per second too slow [1/s]
FOOT = 0.3  # time constant of his foot [s]


class Pedals(NamedTuple):
    """Torque at each wheel for an acceleration, and for a deceleration, of 1 m/s2 on a level road, (4,) [N m s2/m].

    The brakes are balanced as the wheels' loads are at 0.8 g (chosen), so that the front ones lock first below it.
    """

    drive: Array
    brake: Array
    follow: float  # share of the way to what he wants that his foot makes in a step [-]
    pressed: float = 0.0  # acceleration for which the accelerator stands [m/s2]

    def hold(self, speed: float, car: Car) -> "Pedals":
        """The pedals one step on, with a foot that brings the car back to a speed from below; from above it lifts."""
        seen = NEEDLE * round(math.hypot(car.vx, car.vy) / NEEDLE)
        wanted = min(max(EAGER * (speed - seen), 0.0), STRONGEST)
        return self._replace(pressed=self.pressed + self.follow * (wanted - self.pressed))

    @property
    def torque(self) -> Array:
        """Drive torque at each wheel, (4,) [N m]."""
        return self.drive * self.pressed


def pedals(vehicle: Vehicle, dt: float) -> Pedals:
    """The pedals of a car, for a driver who acts every dt seconds."""
    torque = 0.5 * vehicle.mass * vehicle.wheel_radius
    front = vehicle.front_drive
    load = min(1.0, (vehicle.lr + FIRM / GRAVITY * vehicle.height) / vehicle.wheelbase)
    drive, brake = torque * np.array([[s, s, 1 - s, 1 - s] for s in (front, load)])
    return Pedals(drive, brake, 1 - math.exp(-dt / FOOT))
