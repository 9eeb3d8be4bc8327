"""Folders of results as they are compared: the table of runs, the times, and whence they come."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

KEYS = ("cell", "seed", "estimator")
ORIGIN = ("study", "version", "study_digest", "package", "commit", "source", "command")
TUNING = ("tuning", "tuning_digest")
UPDATE = "shadow_update_us"
TIMES = ("loop_update_us", UPDATE, "seconds", "machine")


class Results(NamedTuple):
    """One side of a comparison."""

    path: Path
    runs: pl.DataFrame  # without times
    times: pl.DataFrame  # keys and what there is of TIMES
    origin: dict[str, str]  # of ORIGIN, what is known
    tunings: dict[str, str]  # by estimator, label and digest


def read_results(path: Path) -> Results:
    """A folder with ``runs.parquet`` and perhaps ``times.parquet`` and ``run.json``, or a parquet file alone.

    Raises:
        ValueError: If there is none, a file is damaged, or it holds no table of runs.
    """
    if not path.exists():
        raise ValueError(
            f"there is no {path}: a folder that `vse-gym bench --out` wrote is expected, or a parquet file"
        )
    folder, file = (path, path / "runs.parquet") if path.is_dir() else (path.parent, path)
    if not file.exists():
        unfinished = " its run was not finished, which --resume does;" if (path / "parts").is_dir() else ""
        raise ValueError(f"{path} holds no runs.parquet:{unfinished} a folder that `vse-gym bench --out` wrote has one")
    runs = _read_table(file, (*KEYS, "regret"))
    held = [c for c in TIMES if c in runs.columns]
    times = runs.select(*KEYS, *held)
    told: dict[str, Any] = {}
    if path.is_dir():
        told = _read_manifest(folder / "run.json")
        if (folder / "times.parquet").exists():
            times = _read_table(folder / "times.parquet", KEYS)
    return Results(path, runs.drop(held), times, _origin(runs, told), _tunings(runs, told))


def _read_table(path: Path, needed: tuple[str, ...]) -> pl.DataFrame:
    try:
        table = pl.read_parquet(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise ValueError(f"{path} cannot be read, it is damaged or no parquet file: {error}") from error
    if "bound_sideslip_deg" in table.columns:
        raise ValueError(f"{path} is of a matched study, which has no regret: compare the two bound.md")
    if missing := [c for c in needed if c not in table.columns]:
        raise ValueError(f"{path} is no table of runs: it lacks {', '.join(missing)}")
    if table.is_empty():
        raise ValueError(f"{path} holds no run")
    if table.select(KEYS).is_duplicated().any():
        raise ValueError(f"{path} has two rows of one cell, seed and estimator: runs cannot be paired")
    return table


def _read_manifest(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    if not isinstance(told, dict):
        raise ValueError(f"{path} holds no JSON object")
    return told


def _origin(runs: pl.DataFrame, told: dict[str, Any]) -> dict[str, str]:
    """What the manifest says; without it what the rows say."""
    rows = {k: ", ".join(map(str, runs[k].unique().sort())) for k in ORIGIN if k in runs.columns}
    return rows | {k: str(told[k]) for k in ORIGIN if k in told}


def _tunings(runs: pl.DataFrame, told: dict[str, Any]) -> dict[str, str]:
    found: dict[str, str] = {}
    if set(TUNING) <= set(runs.columns):
        pairs = runs.select("estimator", *TUNING).unique().sort("estimator", *TUNING)
        for name, *parts in pairs.iter_rows():
            if any(parts):
                found[name] = ", ".join(filter(None, (found.get(name), " ".join(filter(None, parts)))))
    listed = told.get("tunings")
    return found | {k: " ".join(map(str, v)) for k, v in (listed if isinstance(listed, dict) else {}).items()}
