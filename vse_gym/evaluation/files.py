"""The files of a results folder, read and written; see :mod:`vse_gym.evaluation.results` for what lies where."""

import io
import json
import os
from collections.abc import Mapping, Sequence
from hashlib import blake2b
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vse_gym.evaluation.contenders import POTENTIAL
from vse_gym.evaluation.runs import KEYS, TIMES

if TYPE_CHECKING:
    import polars

Asked = tuple[str, str, str]  # name, tuning and digest of a row's estimator

FIRST = ("cell", "seed", "estimator", "parent", "part", "tuning", "regret")  # columns that a reader looks for


class ResultsError(Exception):
    """A folder that cannot be used as asked; the message says why and what can be done."""


def unfinished(runs: "polars.DataFrame", folder: Path) -> str:
    """What is missing of what was to be driven, as a sentence; empty: nothing is."""
    told = read_manifest(folder)
    cells, seeds = told.get("cells", []), told.get("seeds", 0)
    pairs = runs.select("cell", "seed").unique()
    lacking = len(cells) * seeds - len(pairs)
    if lacking <= 0:
        return ""
    never = sorted(set(cells) - set(pairs["cell"]))
    which = f", none of {', '.join(never)}" if never else ""
    return f"unfinished: {len(pairs)} of {len(cells) * seeds} cells x seeds are driven{which}; --resume goes on"


def read_runs(folder: Path) -> "polars.DataFrame":
    """The table of a results folder with its times; of one whose run was killed, what had been finished.

    Raises:
        ResultsError: If there is none, or it cannot be read.
    """
    import polars

    if not folder.is_dir():
        raise ResultsError(f"there is no folder {folder}")
    runs, times = folder / "runs.parquet", folder / "times.parquet"
    try:
        if not runs.exists():
            return _unfinished(folder)
        table = polars.read_parquet(runs)
        return table.join(polars.read_parquet(times), on=KEYS, how="left") if times.exists() else table
    except (polars.exceptions.PolarsError, OSError) as error:
        raise ResultsError(f"{folder} cannot be read: {error}") from error


def write_runs(folder: Path, runs: "polars.DataFrame") -> None:
    """Write the table of runs, and the table of times beside it.

    Raises:
        OSError: If they cannot be written.
    """
    times = [c for c in TIMES if c in runs.columns]
    for name, frame in (("runs", runs.drop(times)), ("times", runs.select(*KEYS, *times))):
        buffer = io.BytesIO()
        frame.write_parquet(buffer)
        write_whole(folder / f"{name}.parquet", buffer.getvalue())


def _unfinished(folder: Path) -> "polars.DataFrame":
    """What a run had finished when it was killed; parts that are damaged do not count."""
    frames = [frame for path in sorted((folder / "parts").glob("*.parquet")) if (frame := sound(path)) is not None]
    if not frames:
        raise ResultsError(f"{folder} holds neither runs.parquet nor any finished cell")
    return in_order(frames, tunings_of(read_manifest(folder)))


def tunings_of(manifest: Mapping[str, Any]) -> list[Asked]:
    """Whom a folder's runs judged, each with the latest tuning."""
    return [(name, label, digest) for name, (label, digest) in manifest.get("tunings", {}).items()]


def sound(path: Path) -> "polars.DataFrame | None":
    """The rows of a part; None if its bytes are not those that were written."""
    import polars

    content = path.read_bytes()
    return polars.read_parquet(io.BytesIO(content)) if path.stem.rpartition("-")[2] == digest_of(content) else None


def in_order(frames: Sequence["polars.DataFrame"], asked: Sequence[Asked]) -> "polars.DataFrame":
    """One sorted table of the rows of these estimators, by name, tuning and digest, and of the car without control."""
    import polars

    names = ["estimator", "tuning", "tuning_digest"]  # one digest may have had another label
    keys = polars.DataFrame([*asked, (POTENTIAL, "", "")], schema=names, orient="row")
    rows = polars.concat(frames, how="diagonal_relaxed").drop("tuning")
    rows = rows.join(keys, on=["estimator", "tuning_digest"], how="inner")
    ordered = [c for c in FIRST if c in rows.columns]
    ordered += sorted(set(rows.columns) - set(ordered))
    return rows.select(ordered).unique(KEYS, keep="last", maintain_order=True).sort(KEYS)


def read_manifest(folder: Path) -> dict[str, Any]:
    """What was to be driven in a folder, by whom, with what.

    Raises:
        ResultsError: If that cannot be read.
    """
    path = folder / "run.json"
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(told, dict):
            raise ValueError("it holds no table")
    except (OSError, ValueError) as error:
        raise ResultsError(
            f"{path}, which says whose the finished cells in parts/ are, cannot be read: {error}; put it back, choose "
            "another folder, or --overwrite this one"
        ) from error
    return told


def alive(name: str) -> bool:
    """Whether the process that writes a temporary file still runs on this machine."""
    try:
        os.kill(int(name.rpartition(".")[2]), 0)
    except (ValueError, OverflowError, ProcessLookupError):
        return False
    except PermissionError:
        pass
    return True


def digest_of(content: bytes) -> str:
    """Of a file's bytes."""
    return blake2b(content, digest_size=6).hexdigest()


def write_whole(path: Path, content: bytes) -> None:
    """A file that is there whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
