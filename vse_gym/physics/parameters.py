"""What the physics kernels read: the car, its tyres, the road, and the layout of the plant's state.

Wheel order everywhere: front left, front right, rear left, rear right.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

GRAVITY = 9.81  # m/s2

# The plant's state, one float array of STATE_SIZE. AX and AY are outputs of the step that led here.
X, Y, YAW = 0, 1, 2  # position of the centre of gravity [m] and heading [rad], earth-fixed
VX, VY, YAW_RATE = 3, 4, 5  # velocity of the centre of gravity in body axes [m/s], [rad/s]
WHEEL_SPEEDS = slice(6, 10)  # [rad/s]
WHEEL = 6  # index of the first wheel speed
LOAD_AX, LOAD_AY = 10, 11  # specific force that the load transfer has followed so far [m/s2]
DISTANCE = 12  # path length travelled [m]
BRAKE_WORK = 13  # heat in the brakes so far [J]
LAG_X, LAG_Y = 14, 18  # indices of the first wheel's unsteady slips, kappa and tan(alpha), four each [-]
AX, AY = 22, 23  # specific force at the centre of gravity: what an accelerometer feels, leaning as the body does [m/s2]
ROLL, ROLL_RATE = 24, 25  # of the body, positive leans right [rad], [rad/s]; 0 where the plant has no roll
STATE_SIZE = 26


class PolynomialTyre(NamedTuple):
    """The default tyre: Fiala's polynomial on the slip vector, so that braking and cornering share the friction."""

    slip_stiffness: float  # force per unit slip ratio [N]
    cornering_stiffness: float  # lateral force per unit tan(slip angle) [N/rad]
    reference_load: float = 0.0  # load at which they hold; they are in proportion to it. 0: at every load alike [N]


class MagicFormulaTyre(NamedTuple):
    """Pacejka's Magic Formula along and across, combined by similarity; stiffness in proportion to load."""

    slip_stiffness: float  # at the reference load [N]
    cornering_stiffness: float  # at the reference load [N/rad]
    reference_load: float  # [N]
    shape_x: float  # C of the longitudinal force, in [1, 2) [-]
    shape_y: float  # C of the lateral force [-]
    curvature_x: float  # E of the longitudinal force, at most 1 [-]
    curvature_y: float  # E of the lateral force [-]
    peak_x: float  # largest longitudinal force over friction times load [-]
    peak_y: float  # largest lateral force over friction times load [-]


class DugoffTyre(NamedTuple):
    """Dugoff's closed form of a tyre that sticks and slides, both forces sharing the friction."""

    slip_stiffness: float  # [N]
    cornering_stiffness: float  # [N/rad]


class FialaTyre(NamedTuple):
    """The law as Qin et al. (2014) print it: no friction limit on the longitudinal force, no coupling."""

    slip_stiffness: float  # [N]
    cornering_stiffness: float  # [N/rad]
    trail: float  # L, the length that scales the aligning moment [m]


class EllipseTyre(NamedTuple):
    """The printed law held inside a friction ellipse."""

    slip_stiffness: float  # [N]
    cornering_stiffness: float  # [N/rad]
    trail: float  # L, the length that scales the aligning moment [m]


class LinearTyre(NamedTuple):
    """Force in proportion to slip, without limit: for comparison with linear theory."""

    slip_stiffness: float  # [N]
    cornering_stiffness: float  # [N/rad]


Tyre = PolynomialTyre | MagicFormulaTyre | DugoffTyre | FialaTyre | EllipseTyre | LinearTyre
TYRES: dict[str, type] = {
    "polynomial": PolynomialTyre,
    "magic_formula": MagicFormulaTyre,
    "dugoff": DugoffTyre,
    "fiala": FialaTyre,
    "ellipse": EllipseTyre,
    "linear": LinearTyre,
}


class PerWheel(NamedTuple):
    """One number for each wheel."""

    front_left: float = 0.0
    front_right: float = 0.0
    rear_left: float = 0.0
    rear_right: float = 0.0


class Geometry(NamedTuple):
    """As much of a car as brakes and their control must know; few numbers, because they travel at every step."""

    lf: float  # [m]
    lr: float  # [m]
    track_front: float  # [m]
    track_rear: float  # [m]
    wheel_radius: float  # [m]
    wheel_inertia: float  # [kg m2]
    brake_cap_front: float  # [N m]
    brake_cap_rear: float  # [N m]


class RigidBody(NamedTuple):
    """A body that does not roll on its suspension: what the car's own numbers say is all."""


class RollingBody(NamedTuple):
    """A sprung mass that rolls about an axis along the car; springs, anti-roll bars and dampers of both axles."""

    sprung_mass: float  # [kg]
    roll_arm: float  # e, roll axis to the sprung mass's centre of gravity [m]
    roll_inertia: float  # Ixx of the sprung mass about its own centre of gravity [kg m2]
    roll_yaw_product: float  # Ixz of the sprung mass, the integral of x z dm, of either sign [kg m2]
    roll_stiffness: float  # K_phi [N m/rad]
    roll_damping: float  # C_phi [N m s/rad]


class Vehicle(NamedTuple):
    """Constants of a car with seven degrees of freedom: vx, vy, yaw rate, four wheel speeds; roll is the eighth."""

    mass: float  # [kg]
    yaw_inertia: float  # [kg m2]
    lf: float  # centre of gravity to front axle [m]
    lr: float  # centre of gravity to rear axle [m]
    height: float  # of the centre of gravity [m]
    track_front: float  # [m]
    track_rear: float  # [m]
    width: float  # over all [m]
    front_overhang: float  # front axle to the foremost point of the body [m]
    rear_overhang: float  # rear axle to the hindmost point [m]
    wheel_radius: float  # [m]
    wheel_inertia: float  # of one wheel about its axle [kg m2]
    steering_ratio: float  # hand wheel over road wheel [-]
    front_transfer: float  # xi: share of the lateral load transfer that the front axle carries [-]
    load_lag: float  # time constant of the load transfer [s]
    front_drive: float  # share of the drive torque at the front axle [-]
    brake_cap_front: float  # largest torque that the stability control may ask of a front wheel [N m]
    brake_cap_rear: float  # the same for a rear wheel [N m]
    front_tyre: Any  # one of TYRES, per tyre
    rear_tyre: Any
    relaxation_x: float = 0.0  # length over which the longitudinal slip builds up; 0: steady tyres [m]
    relaxation_y: float = 0.0  # the same of the lateral slip; both or none [m]
    body: Any = RigidBody()  # or a RollingBody
    # How this very car differs from its data sheet; nobody is told, and vehicle files do not say.
    steering_offset: float = 0.0  # road-wheel angle with the hand wheel straight, positive left [rad]
    radius_error: PerWheel = PerWheel()  # of each tyre's radius, relative: -0.02 is a worn or soft tyre [-]

    @property
    def wheelbase(self) -> float:
        """Distance between the axles [m]."""
        return self.lf + self.lr

    @property
    def understeer_gradient(self) -> float:
        """K in yaw rate = v steer/(l + K v^2) at small slip [rad s2/m]; negative: the car oversteers."""
        front, rear = 2 * self.front_tyre.cornering_stiffness, 2 * self.rear_tyre.cornering_stiffness
        return float(self.mass * (self.lr * rear - self.lf * front) / (self.wheelbase * front * rear))

    @property
    def critical_speed(self) -> float:
        """Speed above which straight driving is unstable [m/s]; infinite if the car understeers."""
        gradient = self.understeer_gradient
        return float(np.sqrt(-self.wheelbase / gradient)) if gradient < 0 else float("inf")

    @property
    def geometry(self) -> Geometry:
        """What brakes and their control must know of the car."""
        return Geometry(*(getattr(self, name) for name in Geometry._fields))

    @property
    def brake_caps(self) -> NDArray[np.float64]:
        """The largest torque that the stability control may ask of each wheel, (4,) [N m]."""
        front, rear = self.brake_cap_front, self.brake_cap_rear
        return np.array([front, front, rear, rear])


class Road(NamedTuple):
    """Segments along the manoeuvre's line, each from ``start`` to the next; every field has the shape (segments,).

    The line is the path travelled when a manoeuvre has no course: then left and right are the car's own sides.
    """

    start: NDArray[np.float64]  # distance at which the segment begins, the first 0 [m]
    friction_left: NDArray[np.float64]  # friction coefficient under the left wheels [-]
    friction_right: NDArray[np.float64]  # the same under the right wheels [-]
    slope: NDArray[np.float64]  # positive uphill [rad]
    bank: NDArray[np.float64]  # positive where the left side is higher [rad]


class Inputs(NamedTuple):
    """What acts on the car during one control step."""

    steer: float  # road-wheel angle, positive left [rad]
    drive: NDArray[np.float64]  # drive torque per wheel, (4,) [N m]
    brake: NDArray[np.float64]  # brake torque per wheel, not negative, (4,) [N m]


def road(*segments: tuple[float, float], slope: float = 0.0, bank: float = 0.0) -> Road:
    """A road of one slope and bank whose friction changes: pairs of (start [m], friction).

    Raises:
        ValueError: If a friction is not in (0, 2], or the starts do not begin at 0 and increase.
    """
    start = np.array([s for s, _ in segments], dtype=float)
    friction = np.array([mu for _, mu in segments], dtype=float)
    if not segments or start[0] != 0 or not np.all(np.diff(start) > 0):
        raise ValueError(f"a road's segments start at 0 m and increase, not at {start.tolist()}")
    if not np.all((friction > 0) & (friction <= 2)):
        raise ValueError(f"friction must lie in (0, 2], not {friction.tolist()}")
    level = np.ones_like(start)
    return Road(start, friction, friction.copy(), slope * level, bank * level)


def tilted(flat: Road, slope: float, bank: float) -> Road:
    """The road with so much more slope and bank everywhere [rad]."""
    return flat._replace(slope=flat.slope + slope, bank=flat.bank + bank)


SHARES = ("front_transfer", "front_drive")
MAY_BE_ZERO = ("height", "front_overhang", "rear_overhang", "trail", "roll_arm", "roll_damping")


def _complaint(name: str, value: Any, default: float | None) -> str:
    """What is wrong with one number of a car; nothing if it can be. Tyres' numbers are named ``front_tyre.shape_x``."""
    part, _, field = name.rpartition(".")
    if not isinstance(value, int | float | np.number) or isinstance(value, bool) or not np.isfinite(value):
        return f"{name} = {value!r} is not a finite number"
    if field == "roll_yaw_product":
        return ""
    if field in SHARES:
        return "" if 0 <= value <= 1 else f"{name} = {value} must lie in [0, 1]"
    if field == "steering_offset" or part == "radius_error":
        return "" if -0.5 < value < 0.5 else f"{name} = {value} must lie within 0.5"
    if field in ("relaxation_x", "relaxation_y"):  # below, a step of 1 ms is unstable at high speed
        return "" if value == 0 or 0.05 <= value <= 2 else f"{name} = {value} must be 0 or lie in [0.05, 2]"
    if field in MAY_BE_ZERO or default == 0:
        return "" if value >= 0 else f"{name} = {value} must not be negative"
    if field in ("shape_x", "shape_y"):  # above 2 a sliding tyre would push the car on
        return "" if 1 <= value < 2 else f"{name} = {value} must lie in [1, 2)"
    if field in ("curvature_x", "curvature_y"):
        return "" if value <= 1 else f"{name} = {value} must not exceed 1"
    return "" if value > 0 else f"{name} = {value} must be positive"


def _misfit(vehicle: Vehicle) -> str:
    """What is wrong with numbers that are each in their range but do not fit each other."""
    if (vehicle.relaxation_x > 0) != (vehicle.relaxation_y > 0):
        return "relaxation_x and relaxation_y must both be 0 (steady tyres) or neither"
    body = vehicle.body
    if not isinstance(body, RollingBody):
        return ""
    if body.sprung_mass > vehicle.mass:
        return f"body.sprung_mass = {body.sprung_mass} must not exceed the car's mass of {vehicle.mass} kg"
    if body.roll_stiffness <= (toppling := body.sprung_mass * GRAVITY * body.roll_arm):
        return f"body.roll_stiffness = {body.roll_stiffness} must exceed {toppling:.0f} N m/rad, or the body topples"
    if body.roll_yaw_product**2 >= body.roll_inertia * vehicle.yaw_inertia:
        return f"body.roll_yaw_product = {body.roll_yaw_product} is more than any body of these inertias has"
    return ""


def check_vehicle(vehicle: Vehicle) -> Vehicle:
    """Hand back a car whose numbers a plant can use, every one of them a float.

    Raises:
        ValueError: Naming each field that is not finite or out of its range.
    """
    parts = ("front_tyre", "rear_tyre", "body", "radius_error")
    numbers: dict[str, Any] = {k: v for k, v in vehicle._asdict().items() if k not in parts}
    defaults: dict[str, Any] = dict(Vehicle._field_defaults)
    for part in parts:
        kind = type(getattr(vehicle, part))
        if part.endswith("_tyre") and kind not in TYRES.values():
            raise ValueError(f"{part} must be one of {', '.join(TYRES)}, not {kind.__name__}")
        if part == "body" and kind not in (RigidBody, RollingBody):
            raise ValueError(f"body must be a RigidBody or a RollingBody, not {kind.__name__}")
        numbers |= {f"{part}.{k}": v for k, v in getattr(vehicle, part)._asdict().items()}
        defaults |= {f"{part}.{k}": v for k, v in kind._field_defaults.items()}
    complaints = (_complaint(name, value, defaults.get(name)) for name, value in numbers.items())
    wrong = [complaint for complaint in complaints if complaint]
    if not wrong and (misfit := _misfit(vehicle)):
        wrong.append(misfit)
    if wrong:
        raise ValueError("vehicle: " + "; ".join(wrong))
    # an int field would compile a second kernel
    plain: dict[str, Any] = {k: float(v) for k, v in vehicle._asdict().items() if k not in parts}
    nested = {part: type(getattr(vehicle, part))(*map(float, getattr(vehicle, part))) for part in parts}
    return Vehicle(**plain, **nested)
