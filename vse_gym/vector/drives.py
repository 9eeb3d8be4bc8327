"""Drives side by side in several threads, and where each of them is."""

import itertools
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from numpy.typing import NDArray

from vse_gym.ending import GOES_ON
from vse_gym.env import StabilityControlEnv
from vse_gym.types import Array
from vse_gym.vector.lanes import some_of
from vse_gym.vector.rows import Rows, check_in_rows, lanes_of

FEWEST = 128  # rows that are worth a thread of their own: fewer are done before another thread has woken up
Flags = NDArray[np.bool_]


class Drives:
    """n drives in all threads together: what the vector environments are made of.

    Args:
        single: The environment that each row is; it says what is driven and is not driven itself.
        count: How many rows.
        threads: How many threads share them; None: as many as cores, each with at least 128 rows.

    Raises:
        ValueError: If a block is not made for compiled rows, or there is no row.
    """

    def __init__(self, single: StabilityControlEnv, count: int, threads: int | None = None):
        check_in_rows(single.episodes, single.controller)
        if count < 1 or (threads is not None and threads < 1):
            raise ValueError(f"rows and threads must be at least 1, not {count} and {threads}")
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        parts = min(count, threads or max(1, min(cores, count // FEWEST)))
        edges = np.linspace(0, count, parts + 1).round().astype(int).tolist()
        self._slices = [slice(a, b) for a, b in itertools.pairwise(edges)]
        self._every = [np.arange(part.stop - part.start) for part in self._slices]
        self._lanes = lanes_of(single.episodes, single.encoder, count)
        what = (single.episodes, single.controller, single.action_kind, single.encoder)
        self.parts = [Rows(*what, some_of(self._lanes, part)) for part in self._slices]
        self._generators: list[np.random.Generator | None] = [None] * count
        self._pool = ThreadPoolExecutor(parts - 1) if parts > 1 else None

    def start(self, i: int, seed: int | None = None) -> None:
        """Begin row i's drive anew: with a seed, which also says what follows, or with the next that follows."""
        part = next(p for p, rows in enumerate(self._slices) if i < rows.stop)
        if seed is not None:
            self._generators[i] = seeding.np_random(seed)[0]
        self.parts[part].start(i - self._slices[part].start, self._next(i) if seed is None else seed)

    def step(self, actions: Array, again: Sequence[int] = ()) -> None:
        """Drive on all rows but those that begin anew.

        Raises:
            ResetNeeded: If they were never started.
        """
        if self._generators[-1] is None:  # a reset starts the rows in order; asking each would cost every step
            raise ResetNeeded("drives begin with reset, before the first step")
        work = []
        for rows, part, every in zip(self.parts, self._slices, self._every, strict=True):
            over = [(i - part.start, self._next(i)) for i in again if part.start <= i < part.stop]
            index = np.setdiff1d(every, [i for i, _ in over]) if over else every
            work.append(partial(rows.step, index, actions[part], over))
        waiting = [self._pool.submit(step) for step in work[1:]] if self._pool else []
        work[0]()
        for done in waiting:
            done.result()

    def all_of(self, name: str) -> NDArray[Any]:
        """A field of the lanes, of all rows; a copy."""
        field: NDArray[Any] = getattr(self._lanes, name)
        return field.copy()

    def over(self) -> tuple[Flags, Flags]:
        """Which rows' drives have ended early, and which have come to their end."""
        terminated = self._lanes.ended != GOES_ON
        return terminated, ~terminated & (self._lanes.k >= self._lanes.steps)

    def describe(self) -> Array:
        """The table of ``lanes.TABLE``, of all rows, (n, columns); a copy."""
        for rows in self.parts:
            rows.describe()
        return self.all_of("table")

    def close(self) -> None:
        """Let the threads go."""
        if self._pool:
            self._pool.shutdown()

    def _next(self, i: int) -> int:
        """The seed of row i's next drive."""
        generator = self._generators[i] or seeding.np_random(None)[0]
        self._generators[i] = generator
        return int(generator.integers(2**62))
