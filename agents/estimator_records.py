"""Drives for training, driven once and kept on disk."""

from collections.abc import Iterator, Sequence
from hashlib import blake2b
from pathlib import Path
from typing import Any

import estimator_drives
import numpy as np
from estimator_drives import Drive, driven
from rich.progress import track

import vse_gym
from vse_gym.evaluation.parallel import in_parallel

CHUNK = 50  # drives in a file
SHORTEST = 50  # steps of a drive that is worth learning from


def _shaping_digest() -> str:
    """Of all code that has a say in a drive; training anew does not drive anew."""
    package, total = Path(vse_gym.__file__).parent, blake2b(digest_size=5)
    aside = {"estimators", "inference", "evaluation", "report", "checks", "procedures"}
    files = [f for f in package.rglob("*") if f.suffix in (".py", ".toml")]
    for file in sorted(f for f in files if not aside & set(f.relative_to(package).parts)):
        total.update(file.read_bytes())
    total.update(Path(estimator_drives.__file__).read_bytes())
    return total.hexdigest()


def _keep(first: int, count: int, folder: Path) -> None:
    drives = [d for d in map(driven, range(first, first + count)) if len(d.truth) >= SHORTEST]
    joined = {name: np.concatenate([getattr(d, name) for d in drives]) for name in Drive._fields[1:]}
    whose = {"numbers": np.array([d.number for d in drives]), "lengths": np.array([len(d.truth) for d in drives])}
    draft = _file(folder, first).with_suffix(".part")
    with draft.open("wb") as file:
        np.savez(file, allow_pickle=False, **joined, **whose)
    draft.replace(_file(folder, first))


def _file(folder: Path, first: int) -> Path:
    return folder / f"drives-{first:06d}.npz"


def drives(first: int, count: int, folder: Path, jobs: int = 1) -> list[Drive]:
    """The drives of so many numbers from the first on, those that are long enough; driven where not on disk.

    Args:
        first, count: Multiples of CHUNK.
        folder: Where they are kept, in a folder named by the digest of what shapes them.
        jobs: Processes.
    """
    folder = folder / _shaping_digest()
    folder.mkdir(parents=True, exist_ok=True)
    starts = range(first, first + count, CHUNK)
    missing = [(start, CHUNK, folder) for start in starts if not _file(folder, start).exists()]
    if missing:
        told = f"driving {CHUNK * len(missing)} times"
        for _ in track(in_parallel(_keep, missing, jobs), description=told, total=len(missing)):
            pass
    return [drive for start in starts for drive in _kept(_file(folder, start))]


def _kept(path: Path) -> Iterator[Drive]:
    with np.load(path, allow_pickle=False) as file:
        ends = np.cumsum(file["lengths"])[:-1]
        parts: Sequence[Any] = [np.split(file[name], ends) for name in Drive._fields[1:]]
        yield from (Drive(int(n), *each) for n, *each in zip(file["numbers"], *parts, strict=True))
