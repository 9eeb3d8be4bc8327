"""Drives side by side in several threads, and where each of them is."""

import itertools
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vse_gym.ending import GOES_ON
from vse_gym.env import StabilityControlEnv
from vse_gym.types import Array
from vse_gym.vector.rows import Rows, check_in_rows

FEWEST = 128  # rows that are worth a thread of their own: fewer are done before another thread has woken up
Flags = NDArray[np.bool_]
NOBODY: Mapping[int, int] = {}


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
        self.count = count
        self.edges = np.linspace(0, count, parts + 1).round().astype(int)
        what = (single.episodes, single.controller, single.action_kind, single.encoder)
        self.parts = [Rows(*what, int(size)) for size in np.diff(self.edges)]
        self._every = [np.arange(rows.count) for rows in self.parts]
        self._slices = [slice(a, b) for a, b in itertools.pairwise(self.edges.tolist())]
        self._pool = ThreadPoolExecutor(parts - 1) if parts > 1 else None

    def start(self, i: int, seed: int) -> None:
        """Begin row i's drive anew."""
        part = int(np.searchsorted(self.edges, i, side="right")) - 1
        self.parts[part].start(i - int(self.edges[part]), seed)

    def step(self, actions: Array, again: Mapping[int, int] = NOBODY) -> None:
        """Drive on all rows but those that begin anew, by row and seed."""
        work = []
        for rows, part, every in zip(self.parts, self._slices, self._every, strict=True):
            over = [(i - part.start, seed) for i, seed in again.items() if part.start <= i < part.stop]
            index = np.setdiff1d(every, [i for i, _ in over]) if over else every
            work.append(partial(rows.step, index, actions[part], over))
        waiting = [self._pool.submit(step) for step in work[1:]] if self._pool else []
        work[0]()
        for done in waiting:
            done.result()

    def all_of(self, name: str) -> NDArray[Any]:
        """A field of the lanes, of all rows; a copy."""
        return np.concatenate([getattr(rows.lanes, name) for rows in self.parts])

    def over(self) -> tuple[Flags, Flags]:
        """Which rows' drives have ended early, and which have come to their end."""
        terminated = self.all_of("ended") != GOES_ON
        return terminated, ~terminated & (self.all_of("k") >= self.all_of("steps"))

    def describe(self) -> Array:
        """The table of ``lanes.TABLE``, of all rows."""
        return np.concatenate([rows.describe() for rows in self.parts])

    def close(self) -> None:
        """Let the threads go."""
        if self._pool:
            self._pool.shutdown()
