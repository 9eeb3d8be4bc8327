"""What the body adds to the plant: nothing if it is rigid, an eighth degree of freedom if it rolls.

Equations: patent application CN110532590A (2019), in the standard form of a sprung mass that rolls about an axis in the
plane of symmetry; vx and vy are those of the axis below the centre of gravity, phi > 0 leans right, A = dvy/dt + r vx +
g sin(bank) is the specific force across the car:

    m A - ms e dp/dt = sum Fy
    (Ixx + ms e^2) dp/dt - Ixz dr/dt = ms e A + (ms g e - K) phi - C p
    Iz dr/dt - Ixz dp/dt = sum Mz
    m (dvx/dt - r vy + g sin(slope)) + ms e r p = sum Fx

The last term along the car is not in the patent's pages that are known: the turning of the axes carries ms e p, which
the body's swing takes from the lateral momentum, into the longitudinal one. Without it a turning car would gain or lose
energy by rolling.

Springs and dampers lean on the wheels with K phi + C p. What goes through the roll centres follows the acceleration
through the lag of :mod:`vse_gym.physics.double_track`, and is as much as makes the whole m ay h in a steady turn: there
the loads are those of the rigid car, the body's leaning weight included. Both are shared alike between the axles.
"""

import math

from vse_gym.compiled import compiled, generic
from vse_gym.physics.parameters import (
    AX,
    AY,
    GRAVITY,
    LOAD_AY,
    ROLL,
    ROLL_RATE,
    YAW_RATE,
    RigidBody,
    RollingBody,
)


@generic
def overturning(body, vehicle, x):
    """Moment about the car's long axis that moves load from the left wheels to the right ones [N m]."""


@overturning.register(RigidBody)
@compiled
def _(body, vehicle, x):
    return vehicle.mass * x[LOAD_AY] * vehicle.height


@overturning.register(RollingBody)
@compiled
def _(body, vehicle, x):
    swing = body.sprung_mass * body.roll_arm
    through_springs = swing * body.roll_stiffness / (body.roll_stiffness - swing * GRAVITY)  # in a steady turn, per ay
    through_centres = (vehicle.mass * vehicle.height - through_springs) * x[LOAD_AY]
    return body.roll_stiffness * x[ROLL] + body.roll_damping * x[ROLL_RATE] + through_centres


@generic
def accelerations(body, vehicle, x, ax, ay, yaw, h):
    """How the car gathers way under the tyres' forces.

    Args:
        body: Rigid or rolling.
        vehicle: The car.
        x: The plant's state.
        ax: Sum of the tyres' forces along the car, over its mass [m/s2].
        ay: The same across [m/s2].
        yaw: Sum of the yaw moments over the yaw inertia [rad/s2].
        h: Step over which spring and damper act at the mean of its begin and its end; 0 for the derivative [s].

    Returns:
        ax, ay: Specific force on the roll axis [m/s2].
        yaw, roll: Accelerations [rad/s2].
    """


@accelerations.register(RigidBody)
@compiled
def _(body, vehicle, x, ax, ay, yaw, h):
    return ax, ay, yaw, 0.0


@accelerations.register(RollingBody)
@compiled
def _(body, vehicle, x, ax, ay, yaw, h):
    swing, product = body.sprung_mass * body.roll_arm, body.roll_yaw_product
    stiffness = body.roll_stiffness - swing * GRAVITY
    inertia = body.roll_inertia + swing * body.roll_arm
    inertia -= swing * swing / vehicle.mass + product * product / vehicle.yaw_inertia  # car and yaw give way
    inertia += 0.5 * h * (body.roll_damping + 0.5 * h * stiffness)
    moment = swing * ay + product * yaw
    moment -= stiffness * (x[ROLL] + 0.5 * h * x[ROLL_RATE]) + body.roll_damping * x[ROLL_RATE]
    roll = moment / inertia
    ahead = ax - swing / vehicle.mass * x[YAW_RATE] * x[ROLL_RATE]
    return ahead, ay + swing / vehicle.mass * roll, yaw + product / vehicle.yaw_inertia * roll, roll


@generic
def roll_on(body, x, roll, h):
    """Turn the body on by h at a roll acceleration [rad/s2], exact for a constant one."""


@roll_on.register(RigidBody)
@compiled
def _(body, x, roll, h):
    pass


@roll_on.register(RollingBody)
@compiled
def _(body, x, roll, h):
    x[ROLL] += h * (x[ROLL_RATE] + 0.5 * h * roll)
    x[ROLL_RATE] += h * roll


@generic
def differentiate(body, x, roll, dx):
    """Write what the body adds to the state's derivative into ``dx``."""


@differentiate.register(RigidBody)
@compiled
def _(body, x, roll, dx):
    pass


@differentiate.register(RollingBody)
@compiled
def _(body, x, roll, dx):
    dx[AX] = dx[AY] = 0.0
    dx[ROLL], dx[ROLL_RATE] = x[ROLL_RATE], roll


@generic
def added_derivatives(body):
    """How many numbers of the state, counted on from the rigid car's, have a derivative too."""


@added_derivatives.register(RigidBody)
@compiled
def _(body):
    return 0


@added_derivatives.register(RollingBody)
@compiled
def _(body):
    return 4  # the outputs between, whose derivative is 0, then roll and roll rate


@generic
def felt(body, x, ay, gy):
    """What an accelerometer in the body reads across the car: leaning, it feels gravity too [m/s2].

    Args:
        body: Rigid or rolling.
        x: The plant's state.
        ay: Specific force on the roll axis, in the plane of the road [m/s2].
        gy: Acceleration by gravity across the car, -g sin(bank) [m/s2].
    """


@felt.register(RigidBody)
@compiled
def _(body, x, ay, gy):
    return ay


@felt.register(RollingBody)
@compiled
def _(body, x, ay, gy):
    upright = math.sqrt(GRAVITY * GRAVITY - gy * gy)
    return ay + gy + upright * math.sin(x[ROLL]) - gy * math.cos(x[ROLL])
