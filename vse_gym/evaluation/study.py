"""Studies: cells, how they are drawn, and who is judged; as their TOML files say it."""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vse_gym.evaluation.cells import Cell, Randomise
from vse_gym.manoeuvres.base import si
from vse_gym.registry import UnknownNameError


@dataclass(frozen=True)
class Study:
    """Cells, how they are drawn, and who is judged.

    Raises:
        ValueError: If there are no seeds.
    """

    name: str
    version: int
    cells: tuple[Cell, ...]
    seeds: int = 10
    first_seed: int = 0  # tuning and reporting never share seeds
    estimators: tuple[str, ...] = ()  # empty: all there are
    randomise: Randomise = field(default_factory=Randomise)

    def __post_init__(self) -> None:
        if not self.seeds >= 1:
            raise ValueError(f"study {self.name!r}: seeds must be at least 1, not {self.seeds}")

    @classmethod
    def load(cls, name: str | Path) -> "Study":
        """A study by its name, or from a TOML file.

        Raises:
            UnknownNameError: If there is no such study; the message names those that exist.
            ValueError, TypeError: If the file says something that a study does not know.
        """
        path = Path(name) if str(name).endswith(".toml") else STUDIES / f"{name}.toml"
        if not path.is_file():
            known = ", ".join(study_names())
            raise UnknownNameError(f"no study named {str(name)!r}; known: {known}, or the path of a .toml file")
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        draw: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in si(table.pop("randomise", {})).items()
        }
        cells = tuple(Cell(**cell) for cell in table.pop("cell", ()))
        if not cells:
            raise ValueError(f"{path.name}: a study needs at least one [[cell]]")
        if len({c.name for c in cells}) < len(cells):
            raise ValueError(f"{path.name}: two cells have the same name")
        estimators = tuple(table.pop("estimators", ()))
        return cls(path.stem, cells=cells, estimators=estimators, randomise=Randomise(**draw), **table)


def _studies_folder() -> Path:
    installed = Path(__file__).parent.parent / "studies"  # where the wheel carries them
    return installed if installed.is_dir() else Path(__file__).parent.parent.parent / "benchmarks" / "studies"


STUDIES = _studies_folder()


def study_names() -> list[str]:
    """The studies that come with the package."""
    return sorted(path.stem for path in STUDIES.glob("*.toml"))
