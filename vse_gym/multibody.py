"""An independent truth: CommonRoad's multi-body car behind the layout of our own plant's state.

Althoff, Wuersching (2020), CommonRoad: Vehicle Models: a sprung mass with six degrees of freedom, two axles that
roll, heave and shift, four wheels, Magic Formula tyres with camber; 29 states. The derivative is the library's own,
because a judge that we had written would share our mistakes. Here is what stands between it and the loop: axes, wheel
order, wheel torques, friction, start and end. Its wheels never lift off: their loads become negative, and a wheel
that then runs away from rolling turns the library's cars over in the limit. Here such a wheel rolls on.

Axes. The library's states are named z-down, its yaw counts as ours. Read in ISO axes its left wheels are the right
ones, and a positive roll leans left. Ours is the projection: position, velocity and specific force of the library's
reference point, the centre of gravity of the sprung mass (within 4 cm of the whole car's). The specific force is
taken in the plane of the road, as in the plant with seven degrees of freedom: an accelerometer that rolls with the
body would read ay cos(roll) + g sin(roll).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import road_friction
from vse_gym.types import Array
from vse_gym.vehicles import load

CARS = {"ford_escort": 1, "bmw_320i": 2, "vw_vanagon": 3}  # vehicle file: the library's number
Bodies = tuple[float, ...]  # the library's state, (29,)

# The library's state
STEER, SPEED, YAW, YAW_RATE, ROLL, ROLL_RATE, PITCH, LATERAL, HEAVE = 2, 3, 4, 5, 6, 7, 8, 10, 11
LEAN_FRONT, HEAVE_FRONT, LEAN_REAR, HEAVE_REAR, SPIN = 13, 16, 18, 21, 23
SPINS = range(SPIN, SPIN + 4)
SIDES_SWAPPED = [1, 0, 3, 2]  # its left is our right

SUBSTEP = 2e-3  # of the Runge-Kutta method [s]
STABLE = 2.5  # largest step times eigenvalue; the method of order four is stable up to 2.78
STANDSTILL = 0.1  # below this the library turns kinematic, without brakes: the car stands from there on [m/s]
SLOWEST_START = 1.0  # [m/s]
NO_CHANGE = (0.0, 0.0)  # steering rate, which it limits to 0.4 rad/s, and acceleration: both are set in other ways

# Fields of a car that another car of the same make may have otherwise: those that the loop itself reads, and those
# that have a counterpart. Of a tyre: the counterparts.
ELSEWHERE = {
    *("steering_ratio", "steering_offset", "width", "front_overhang", "rear_overhang", "front_drive"),
    *("brake_cap_front", "brake_cap_rear"),
}
COUNTERPARTS = {"mass", "yaw_inertia", "lf", "lr", "height", "wheel_inertia", "front_tyre", "rear_tyre"}
OF_TYRES = {"slip_stiffness": "p_kx1", "cornering_stiffness": "p_ky1", "peak_x": "p_dx1", "peak_y": "p_dy1"}
# Offsets of the tyre's lateral force, ply steer and conicity, which the library gives the sign of the camber angle. A
# car that runs straight has none, so that the force jumps by 2 % of the load from side to side and the car hunts.
OFFSETS = {"p_hy1": 0.0, "p_vy1": 0.0}


@cache
def _dynamics() -> Any:
    """The library's derivative of its state.

    Raises:
        ModuleNotFoundError: If the library is not installed; the message says how to install it.
    """
    try:
        from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "the plant 'commonroad_mb' needs CommonRoad's vehicle models: pip install 'vse-gym[multibody]'"
        ) from None
    return vehicle_dynamics_mb


@cache
def library_parameters(number: int) -> Any:
    """The library's parameters of one of its cars as plain Python objects of floats; not to be edited."""
    from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

    return setup_vehicle_parameters(number)


def identify(vehicle: p.Vehicle) -> str:
    """The name of the car among those that the library knows: the one with this wheelbase and these tracks.

    Raises:
        ValueError: If there is none; the message names those that exist.
    """
    for name in CARS:
        car = load(name)
        ours, theirs = ((v.wheelbase, v.track_front, v.track_rear) for v in (vehicle, car))
        if np.allclose(ours, theirs, rtol=1e-4, atol=0):
            return name
    raise ValueError(
        f"the plant 'commonroad_mb' knows {', '.join(CARS)}, by wheelbase and tracks: not a car with a wheelbase of "
        f"{vehicle.wheelbase:.3f} m and tracks of {vehicle.track_front:.3f} and {vehicle.track_rear:.3f} m"
    )


def parameters(vehicle: p.Vehicle) -> Any:
    """The library's parameters of a car, changed as the car differs from its file.

    Mass is added to or taken from the sprung mass, height moves its centre of gravity, stiffness and peaks scale the
    tyres' coefficients.

    Raises:
        ValueError: If the library does not know the car, or has no counterpart of what was changed.
    """
    name = identify(vehicle)
    car, library = load(name), library_parameters(CARS[name])
    fixed = [f for f in p.Vehicle._fields if f not in ELSEWHERE | COUNTERPARTS]
    if wrong := [f for f in fixed if getattr(vehicle, f) != getattr(car, f)]:
        raise ValueError(
            f"the plant 'commonroad_mb' cannot change {', '.join(wrong)} of {name}; it can change mass, yaw_inertia, "
            f"lf, lr, height, wheel_inertia, and of both tyres {', '.join(OF_TYRES)}"
        )
    mass = library.m * vehicle.mass / car.mass
    sprung = library.m_s + (mass - library.m)
    if sprung <= 0:
        raise ValueError(f"mass = {vehicle.mass:.0f} kg leaves nothing to the body of {name}")
    tyre = replace(library.tire, **_tyre_changes(name, vehicle, car))
    return replace(
        library,
        m=mass,
        m_s=sprung,
        I_z=library.I_z * vehicle.yaw_inertia / car.yaw_inertia,
        I_y_w=library.I_y_w * vehicle.wheel_inertia / car.wheel_inertia,
        a=library.a + (vehicle.lf - car.lf),
        b=library.b + (vehicle.lr - car.lr),
        h_s=library.h_s + (vehicle.height - car.height) * mass / sprung,
        tire=tyre,
    )


def _tyre_changes(name: str, vehicle: p.Vehicle, car: p.Vehicle) -> dict[str, float]:
    """What the library's one tyre takes over from two that were changed alike."""
    ratios = []
    for ours, theirs in ((vehicle.front_tyre, car.front_tyre), (vehicle.rear_tyre, car.rear_tyre)):
        if type(ours) is not type(theirs):
            raise ValueError(f"the plant 'commonroad_mb' drives {name} on the tyre law of its file, not on another")
        changed = {f: getattr(ours, f) / getattr(theirs, f) for f in ours._fields if getattr(theirs, f)}
        if wrong := [f for f, ratio in changed.items() if f not in OF_TYRES and ratio != 1]:
            raise ValueError(
                f"the plant 'commonroad_mb' cannot change {', '.join(wrong)} of tyres, only {', '.join(OF_TYRES)}"
            )
        ratios.append({f: ratio for f, ratio in changed.items() if f in OF_TYRES})
    front, rear = ratios
    if not all(math.isclose(front[f], rear[f], rel_tol=1e-9) for f in front):
        raise ValueError("the plant 'commonroad_mb' has one tyre for both axles: change front and rear alike")
    tyre = library_parameters(CARS[name]).tire
    return {OF_TYRES[f]: getattr(tyre, OF_TYRES[f]) * ratio for f, ratio in front.items()}


@dataclass(frozen=True)
class MultiBody:
    """One car of the library on one road: ``start`` and ``advance`` hand back the library's state and ours.

    Raises:
        ModuleNotFoundError: If the library is not installed.
        ValueError: If the library cannot represent the car or the road; the message says what of it.
    """

    vehicle: p.Vehicle
    road: p.Road
    offsets: bool = False  # whether tyres keep the library's offsets of the lateral force
    library: Any = field(init=False, repr=False)  # parameters at a friction of 1
    everywhere: Any = field(init=False, repr=False)  # the same on the road, if all of it has one friction, else None

    def __post_init__(self) -> None:
        _dynamics()
        q = parameters(self.vehicle)
        object.__setattr__(self, "library", q if self.offsets else replace(q, tire=replace(q.tire, **OFFSETS)))
        if np.any(self.road.friction_left != self.road.friction_right):
            raise ValueError("the plant 'commonroad_mb' has one tyre for all wheels: no friction split left and right")
        if np.any(self.road.slope) or np.any(self.road.bank):
            raise ValueError("the plant 'commonroad_mb' drives on a level plane: no slope, no bank")
        frictions = np.unique(self.road.friction_left)
        one = _gripping(self.library, float(frictions[0])) if frictions.size == 1 else None
        object.__setattr__(self, "everywhere", one)

    def start(self, speed: float) -> tuple[Bodies, Array]:
        """Straight running at a speed [m/s] from the origin, the body at rest on its springs.

        Raises:
            ValueError: If the speed is below 1 m/s, where the library's slips are no longer defined for long.
        """
        if not speed >= SLOWEST_START:
            raise ValueError(f"the plant 'commonroad_mb' starts at {SLOWEST_START} m/s or more, not at {speed} m/s")
        from vehiclemodels.init_mb import init_mb

        q = self.library
        x = [float(value) for value in init_mb([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], q)]
        # The library leaves the body where the tyres carry no load; its springs are at rest this much lower.
        x[PITCH] = (x[HEAVE_REAR] - x[HEAVE_FRONT]) / (q.a + q.b)
        x[HEAVE] = x[HEAVE_FRONT] + q.a * x[PITCH]
        rate = _Rate(self._on(np.zeros(p.STATE_SIZE)), p.Inputs(0.0, np.zeros(4), np.zeros(4)))
        for _ in range(4):  # Newton's method for wheels that roll free: their tyres' curves miss the origin
            pulls = rate(list(x))
            for k, weight in zip(SPINS, loads(q, x), strict=True):
                x[k] += pulls[k] * q.I_y_w * speed / (q.tire.p_kx1 * weight * q.R_w**2)
        return tuple(x), project(x, rate(list(x)), 0.0, 0.0)

    def advance(self, bodies: Bodies, state: Array, inputs: p.Inputs, dt: float) -> tuple[Bodies | None, Array]:
        """The states after dt seconds of held inputs, by Runge-Kutta steps of 2 ms; shorter ones at walking pace.

        A car that comes to a stop stands for the rest of the drive. Where the library has no answer, as for a wheel
        that is carried backwards, its state is None and ours stays what it was.
        """
        x = list(bodies)
        if x[SPEED] == 0.0:
            return bodies, state
        x[STEER] = inputs.steer
        rate = _Rate(self._on(state), inputs)
        torques = inputs.brake[SIDES_SWAPPED].tolist()
        distance, work, left = float(state[p.DISTANCE]), float(state[p.BRAKE_WORK]), dt
        try:
            while left > 1e-12 and x[SPEED] > STANDSTILL:
                h = min(left, dt / math.ceil(dt / self._stable_step(x) - 1e-9))
                after = _runge_kutta(rate, x, h)
                distance += 0.5 * h * (math.hypot(x[SPEED], x[LATERAL]) + math.hypot(after[SPEED], after[LATERAL]))
                work += 0.5 * h * sum(t * (x[k] + after[k]) for k, t in enumerate(torques, SPIN))
                x, left = after, left - h
            if x[SPEED] <= STANDSTILL and math.hypot(x[SPEED], x[LATERAL]) < SLOWEST_START:
                for k in (SPEED, YAW_RATE, LATERAL, ROLL_RATE, *SPINS):
                    x[k] = 0.0
                return tuple(x), project(x, [0.0] * len(x), distance, work)
            return tuple(x), project(x, rate(list(x)), distance, work)
        except (ZeroDivisionError, OverflowError, ValueError):
            return None, state

    def _on(self, state: Array) -> Any:
        """The library's parameters on the road under the car; its one tyre takes the mean friction of the axles."""
        if self.everywhere is not None:
            return self.everywhere
        return _gripping(self.library, float(road_friction(self.vehicle, self.road, state[p.DISTANCE])))

    def _stable_step(self, x: list[float]) -> float:
        """The longest step that the wheels' spin allows, whose eigenvalue grows as the speed falls [s]."""
        q = self.library
        slowest = max(STANDSTILL, x[SPEED] - 0.5 * max(q.T_f, q.T_r) * abs(x[YAW_RATE]))
        load = 0.5 * q.m * p.GRAVITY  # of the heaviest wheel in a violent turn
        eigenvalue: float = q.tire.p_kx1 * load * q.R_w**2 / (q.I_y_w * slowest)
        return min(SUBSTEP, STABLE / eigenvalue)


def _gripping(library: Any, friction: float) -> Any:
    """The library's parameters with the tyre's peaks on a road of a friction."""
    tyre = library.tire
    return replace(library, tire=replace(tyre, p_dx1=tyre.p_dx1 * friction, p_dy1=tyre.p_dy1 * friction))


def loads(library: Any, x: Sequence[float]) -> list[float]:
    """The library's wheel loads, in its own order, negative where a wheel should have lifted off [N]."""
    q = library
    out: list[float] = []
    for heave, lean, track in ((HEAVE_FRONT, LEAN_FRONT, q.T_f), (HEAVE_REAR, LEAN_REAR, q.T_r)):
        middle, across = x[heave] + q.R_w * (math.cos(x[lean]) - 1), 0.5 * track * math.sin(x[lean])
        out += (q.K_zt * (middle - across), q.K_zt * (middle + across))
    return out


class _Rate:
    """The library's derivative, with the wheels' torques."""

    def __init__(self, library: Any, inputs: p.Inputs):
        self.dynamics, self.library = _dynamics(), library
        self.drive = (inputs.drive[SIDES_SWAPPED] / library.I_y_w).tolist()
        self.brake = (inputs.brake[SIDES_SWAPPED] / library.I_y_w).tolist()

    def __call__(self, x: list[float]) -> list[float]:
        """(29,) to (29,); a negative wheel speed in ``x`` is set to zero by the library."""
        dx: list[float] = self.dynamics(x, NO_CHANGE, self.library)
        for k, drive, brake, weight in zip(SPINS, self.drive, self.brake, loads(self.library, x), strict=True):
            # A tyre under a negative load would drive a slipping wheel away from rolling: its spin takes the magnitude
            push = drive + (dx[k] if weight > 0 else -dx[k])
            # Coulomb: against a turning wheel; a standing one is held, and the library knows no turning back
            dx[k] = push - brake if x[k] > 0 or push > brake else 0.0
        return dx


def _runge_kutta(rate: _Rate, x: list[float], h: float) -> list[float]:
    """The state one step on, by the classical method of order four; no wheel turns backwards."""
    half, sixth = 0.5 * h, h / 6
    k1 = rate(x)
    k2 = rate([a + half * b for a, b in zip(x, k1, strict=True)])
    k3 = rate([a + half * b for a, b in zip(x, k2, strict=True)])
    k4 = rate([a + h * b for a, b in zip(x, k3, strict=True)])
    after = [a + sixth * (b + 2 * (c + d) + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)]
    for k in SPINS:
        after[k] = max(0.0, after[k])
    return after


def project(x: list[float], dx: list[float], distance: float, work: float) -> Array:
    """Our state, (STATE_SIZE,), of the library's state and its derivative."""
    state = np.zeros(p.STATE_SIZE)
    state[p.X], state[p.Y], state[p.YAW] = x[0], x[1], x[YAW]
    state[p.VX], state[p.VY], state[p.YAW_RATE] = x[SPEED], x[LATERAL], x[YAW_RATE]
    state[p.WHEEL_SPEEDS] = [x[SPIN + k] for k in SIDES_SWAPPED]
    state[p.DISTANCE], state[p.BRAKE_WORK] = distance, work
    state[p.AX] = dx[SPEED] - x[YAW_RATE] * x[LATERAL]
    state[p.AY] = dx[LATERAL] + x[YAW_RATE] * x[SPEED]
    state[p.ROLL], state[p.ROLL_RATE] = -x[ROLL], -x[ROLL_RATE]
    return state
