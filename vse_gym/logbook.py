"""A drive's log in the making."""

import numpy as np

from vse_gym.physics import parameters as p
from vse_gym.types import CHANNELS, FOUND, Array, BrakeDemand, Car, Estimate, Log, Reading

Scalars = tuple[float, ...]  # time, hand wheel, steer, friction, NIS and seconds of an instant


class LogBook:
    """Arrays for a drive's log, filled row by row."""

    def __init__(self, rows: int):
        self.rows = 0
        self.truth = np.empty((rows, p.STATE_SIZE))
        self.inputs, self.readings = np.empty((rows, 9)), np.empty((rows, len(CHANNELS)))
        self.estimate, self.cov = np.empty((rows, 5)), np.empty((rows, 3, 3))
        self.found = np.empty((rows, len(FOUND)))
        self.brake, self.added, self.release = np.empty((rows, 4)), np.empty((rows, 4)), np.empty((rows, 4))
        self.scalars = np.empty((rows, 6))

    def write(
        self, truth: Car, reading: Reading, estimate: Estimate, brake: Array, demand: BrakeDemand, scalars: Scalars
    ) -> None:
        """Add the row of one instant."""
        k = self.rows
        self.truth[k] = truth.state
        self.inputs[k], self.readings[k] = reading.inputs, reading.y
        self.estimate[k], self.cov[k], self.found[k] = estimate[:5], estimate.cov, estimate[6:]
        self.brake[k], self.added[k], self.release[k] = brake, demand.added, demand.release
        self.scalars[k] = scalars
        self.rows += 1

    def close(self, ended: str, filled: tuple[str, ...], vehicle: p.Vehicle) -> Log:
        """The log: why the drive ended, what was filled in, and the true car beside the rows."""
        n = self.rows
        time, hand_wheel, steer, friction, nis, seconds = self.scalars[:n].T
        return Log(
            time,
            self.truth[:n],
            hand_wheel,
            steer,
            self.inputs[:n],
            self.readings[:n],
            self.estimate[:n],
            self.cov[:n],
            self.brake[:n],
            self.added[:n],
            self.release[:n],
            friction,
            ended,
            filled,
            nis,
            seconds,
            vehicle,
            self.found[:n],
        )
