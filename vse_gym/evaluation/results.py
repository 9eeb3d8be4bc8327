"""A folder of results: each finished cell is a file at once, and what was begun can be gone on with.

run.json         what is driven, and whence the rows come
parts/           a file per finished cell and seed; its name ends with a digest of its bytes
runs.parquet     all rows, sorted; the same for everybody who drives the same
times.parquet    what differs between two runs of the same drive: times and the machine
"""

import io
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vse_gym.evaluation.contenders import POTENTIAL, Contender
from vse_gym.evaluation.files import (
    Asked,
    ResultsError,
    alive,
    digest_of,
    in_order,
    read_manifest,
    sound,
    tunings_of,
    write_whole,
)
from vse_gym.evaluation.provenance import commit, libraries, package_version, source_digest
from vse_gym.evaluation.runs import Row, table
from vse_gym.evaluation.study import Study

if TYPE_CHECKING:
    import polars

FORMAT = 1


class Finished:
    """Finished cells, in memory."""

    def __init__(self) -> None:
        self._parts: dict[tuple[str, int], list[polars.DataFrame]] = {}
        self.damaged: list[str] = []  # files that were found unreadable and set aside

    def missing(self, cell: str, seed: int, contenders: Sequence[Contender]) -> tuple[tuple[Contender, ...], bool]:
        """Who has no row yet of a cell and seed, and whether the car without control lacks one."""
        had: set[tuple[str, str]] = set()
        for part in self._parts.get((cell, seed), ()):
            had.update(part.select("estimator", "tuning_digest").iter_rows())
        lacking = tuple(c for c in contenders if (c.name, c.digest) not in had)
        return lacking, (POTENTIAL, "") not in had

    def add(self, rows: Sequence[Row]) -> None:
        """Keep the rows of one cell and seed."""
        self._shelve(table(rows))

    def _shelve(self, frame: "polars.DataFrame") -> None:
        self._parts.setdefault((str(frame["cell"][0]), int(frame["seed"][0])), []).append(frame)

    def collect(self, contenders: Sequence[Contender], seeds: Sequence[int] | None = None) -> "polars.DataFrame":
        """All rows of these contenders, and of these seeds alone if given, as one sorted table with its times.

        Raises:
            ResultsError: If there are none.
        """
        return self._table([(c.name, c.tuning, c.digest) for c in contenders], seeds)

    def _table(self, asked: Sequence[Asked], seeds: Sequence[int] | None) -> "polars.DataFrame":
        import polars

        frames = [part for key in sorted(self._parts) for part in self._parts[key]]
        if not frames:
            raise ResultsError("no cell is finished")
        rows = in_order(frames, asked)
        return rows if seeds is None else rows.filter(polars.col("seed").is_in(list(seeds)))


class Results(Finished):
    """Finished cells of one study in a folder.

    Args:
        folder: Made if there is none.
        study: What is driven.
        contenders: By whom.
        command: With which command.
        seeds: How many; 0: the study's own.
        resume: Go on with what is there.
        overwrite: Throw away what is there.

    Raises:
        ResultsError: If the folder holds results and is to be neither resumed nor overwritten, or they are of another
            study or another version of the code.
        OSError: If it cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        study: Study,
        contenders: Sequence[Contender] = (),
        command: str = "",
        seeds: int = 0,
        resume: bool = False,
        overwrite: bool = False,
    ):
        super().__init__()
        self.folder, self.study = folder, study
        self._before: list[Asked] = []  # whom an earlier run judged here
        if folder.exists() and not folder.is_dir():
            raise ResultsError(f"{folder} is a file: results go into a folder")
        begun = self._manifest.exists() or any(self._shelf.glob("*.parquet"))
        if begun and overwrite:
            self._clear()
        elif begun and not resume:
            held = read_manifest(folder).get("study", "another study")
            raise ResultsError(
                f"{folder} holds results of {held} already: --resume goes on with them, --overwrite throws them away"
            )
        elif begun:
            held = read_manifest(folder)
            self._check(held)
            self._before = tunings_of(held)
            for name in ("runs", "times"):  # of fewer parts than there will be
                (folder / f"{name}.parquet").unlink(missing_ok=True)
        self._shelf.mkdir(parents=True, exist_ok=True)
        self._describe(command, contenders, seeds)
        self._read()

    @property
    def _manifest(self) -> Path:
        return self.folder / "run.json"

    @property
    def _shelf(self) -> Path:
        return self.folder / "parts"

    @property
    def _all(self) -> list[Asked]:
        """Everybody who was ever judged here, each with the latest tuning."""
        now = {name for name, _, _ in self._judged}
        return [*(asked for asked in self._before if asked[0] not in now), *self._judged]

    def everybody(self, seeds: Sequence[int] | None = None) -> "polars.DataFrame":
        """As :meth:`collect`, of all who were ever judged here."""
        return self._table(self._all, seeds)

    def _describe(self, command: str, contenders: Sequence[Contender], seeds: int) -> None:
        """Write down what is driven, by whom, with which command."""
        self._judged = [(c.name, c.tuning, c.digest) for c in contenders]
        told = {
            "format": FORMAT,
            "study": self.study.name,
            "version": self.study.version,
            "study_digest": self.study.digest,
            "package": package_version(),
            "commit": commit(),
            "source": source_digest(),
            "libraries": libraries(),
            "command": command,
            "cells": [cell.name for cell in self.study.cells],
            "seeds": seeds or self.study.seeds,
            "tunings": {name: [tuning, digest] for name, tuning, digest in self._all},
        }
        write_whole(self._manifest, (json.dumps(told, indent=1) + "\n").encode())

    def add(self, rows: Sequence[Row]) -> None:
        """Keep the rows of one cell and seed: whole or not at all, whatever happens meanwhile.

        Raises:
            OSError: If it cannot be written; what was there before stays.
        """
        frame, buffer = table(rows), io.BytesIO()
        frame.write_parquet(buffer)
        cell, seed = str(frame["cell"][0]), int(frame["seed"][0])
        name = (
            f"{re.sub(r'[^a-z0-9]+', '-', cell.lower()).strip('-')}-{seed:04d}-{digest_of(buffer.getvalue())}.parquet"
        )
        write_whole(self._shelf / name, buffer.getvalue())
        self._shelve(frame)

    def _check(self, held: Mapping[str, Any]) -> None:
        own = {
            "format": FORMAT,
            "study_digest": self.study.digest,
            "source": source_digest(),
            "libraries": libraries(),
        }
        what = {
            "format": "in another format",
            "study_digest": f"of {held.get('study')} with other cells or draws",
            "source": f"of another state of the code (commit {held.get('commit') or 'unknown'})",
            "libraries": f"made with {held.get('libraries')}",
        }
        for key, value in own.items():
            if held.get(key) != value:
                raise ResultsError(
                    f"{self.folder} cannot be resumed, its results are {what[key]}: choose another folder, or "
                    "--overwrite them"
                )

    def _read(self) -> None:
        for path in sorted(self._shelf.iterdir()):
            if path.name.startswith("."):  # a run was killed while it wrote
                if not alive(path.name):
                    path.unlink(missing_ok=True)
            elif path.suffix == ".parquet":
                frame = sound(path)
                if frame is not None:
                    self._shelve(frame)
                    continue
                aside = path.with_suffix(".damaged")
                path.replace(aside)
                self.damaged.append(str(aside))

    def _clear(self) -> None:
        derived = [path for ending in ("parquet", "md", "png", "html") for path in self.folder.glob(f"*.{ending}")]
        for path in (*self._shelf.glob("*"), *derived, self._manifest):
            path.unlink(missing_ok=True)
