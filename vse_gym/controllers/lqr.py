"""Linear-quadratic regulator of sideslip and yaw rate, scheduled by speed."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.compiled import compiled
from vse_gym.controllers.moment import DEG, MomentControl, beyond, yaw_moment
from vse_gym.models import Nominal
from vse_gym.physics.parameters import Vehicle
from vse_gym.types import Array


class LqrLaw(NamedTuple):
    """Gains by speed, and what is let be."""

    slowest: float  # first speed of the table [m/s]
    spacing: float  # of its speeds [m/s]
    gains: Array  # on sideslip [N m/rad] and on the yaw rate error [N m s/rad], (n, 2)
    sideslip_band: float  # [rad]
    yaw_band: float  # [rad/s]


@yaw_moment.register(LqrLaw)
@compiled
def _(law, error, sideslip, sideslip_rate, speed, friction):
    last = law.gains.shape[0] - 1
    place = min(float(last), max(0.0, (speed - law.slowest) / law.spacing))
    k = min(int(place), last - 1)
    share = place - k
    on_sideslip = (1 - share) * law.gains[k, 0] + share * law.gains[k + 1, 0]
    on_error = (1 - share) * law.gains[k, 1] + share * law.gains[k + 1, 1]
    return -(on_sideslip * beyond(sideslip, law.sideslip_band) + on_error * beyond(error, law.yaw_band))


def lateral_dynamics(vehicle: Vehicle, speed: float) -> tuple[Array, Array]:
    """Linear single track under a yaw moment, Riekert and Schunck (1940): A (2, 2), B (2, 1), sideslip and yaw rate."""
    front, rear = 2 * vehicle.front_tyre.cornering_stiffness, 2 * vehicle.rear_tyre.cornering_stiffness
    lean = vehicle.lf * front - vehicle.lr * rear
    turn = vehicle.lf**2 * front + vehicle.lr**2 * rear
    mass, inertia = vehicle.mass, vehicle.yaw_inertia
    a = [
        [-(front + rear) / (mass * speed), -1 - lean / (mass * speed**2)],
        [-lean / inertia, -turn / (inertia * speed)],
    ]
    return np.array(a), np.array([[0.0], [1 / inertia]])


def regulator(a: Array, b: Array, q: Array, r: Array) -> Array:
    """Gain K of u = -K x that minimises the integral of x'Qx + u'Ru under dx/dt = Ax + Bu. Kalman (1960).

    By the stable half of the Hamiltonian's eigenvectors, Potter (1966): for two states that is a hundred times faster
    than SciPy's general solver, and an environment is made for every drive of a study.
    """
    n = len(a)
    push = b @ np.linalg.solve(r, b.T)
    values, vectors = np.linalg.eig(np.block([[a, -push], [-q, -a.T]]))
    stable = vectors[:, np.argsort(values.real)[:n]]
    cost = np.real(stable[n:] @ np.linalg.inv(stable[:n]))
    gain: Array = np.linalg.solve(r, b.T @ cost)
    return gain


@dataclass(frozen=True)
class LinearQuadraticRegulator(MomentControl):
    """M = -K (sideslip, yaw rate - reference), weights by Bryson's rule: one over the square of what is tolerated.

    At speed v the gain is that of the nominal linear single track at v. Errors within the bands are let be, because
    gentle driving has some of both.
    """

    largest_sideslip: float = 1 * DEG  # tolerated [rad]
    largest_error: float = 10 * DEG  # tolerated, of the yaw rate [rad/s]
    largest_moment: float = 8e3  # tolerated [N m]
    sideslip_band: float = 1.5 * DEG  # [rad]
    yaw_band: float = 2.5 * DEG  # [rad/s]

    def law(self, nominal: Nominal) -> LqrLaw:
        q = np.diag([self.largest_sideslip**-2, self.largest_error**-2])
        r = np.array([[self.largest_moment**-2]])
        gains = [regulator(*lateral_dynamics(nominal.vehicle, speed), q, r)[0] for speed in SPEEDS]
        bands = (float(self.sideslip_band), float(self.yaw_band))
        return LqrLaw(float(SPEEDS[0]), float(SPEEDS[1] - SPEEDS[0]), np.array(gains), *bands)


SPEEDS = np.arange(4.0, 61.0, 2.0)  # at which the Riccati equation is solved [m/s]
