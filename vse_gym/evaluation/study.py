"""Studies: cells, how they are drawn, and who is judged; as their TOML files say it."""

import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vse_gym.evaluation.cells import Cell
from vse_gym.evaluation.contenders import digest
from vse_gym.evaluation.provenance import shipped
from vse_gym.randomise import Randomise
from vse_gym.registry import UnknownNameError
from vse_gym.schema import check, kinds_of, needed_of
from vse_gym.vehicles import load


@dataclass(frozen=True)
class Study:
    """Cells, how they are drawn, and who is judged.

    Raises:
        ValueError: If there are no seeds, or no cells, or two of one name.
    """

    name: str
    version: int
    cells: tuple[Cell, ...]
    seeds: int = 10
    first_seed: int = 0  # tuning and reporting never share seeds
    estimators: tuple[str, ...] = ()  # empty: all there are
    randomise: Randomise = field(default_factory=Randomise)
    attribution: bool = False  # rows too in which a part alone of each estimate is used and the rest is true
    matched: bool = False  # drives drawn from the estimators' own model, where a bound on the error exists; no loop

    def __post_init__(self) -> None:
        if not self.seeds >= 1:
            raise ValueError(f"study {self.name!r}: seeds must be at least 1, not {self.seeds}")
        if not self.cells:
            raise ValueError(f"study {self.name!r}: it needs at least one [[cell]]")
        if len({c.name for c in self.cells}) < len(self.cells):
            raise ValueError(f"study {self.name!r}: two cells have the same name")

    @property
    def digest(self) -> str:
        """Of what is driven: two studies of one digest drive the same at the same seed, whoever is judged."""
        cars = [load(cell.vehicle) for cell in self.cells]  # a file of one's own may change under its name
        told = (self.name, self.version, self.attribution, self.matched, self.randomise, *self.cells, *cars)
        return digest(*map(repr, told))

    @classmethod
    def load(cls, name: str | Path) -> "Study":
        """A study by its name, or from a TOML file.

        Raises:
            UnknownNameError: If there is no such study; the message names those that exist.
            ValueError, TypeError: If the file says something that a study does not know; the message names the file.
        """
        path = Path(name) if str(name).endswith(".toml") else STUDIES / f"{name}.toml"
        if not path.is_file():
            known = ", ".join(study_names())
            raise UnknownNameError(f"no study named {str(name)!r}; known: {known}, or the path of a .toml file")
        with _inside(str(path)):
            table = tomllib.loads(path.read_text(encoding="utf-8"))
            check(table, _kinds(), ["version"], "a study has no")
            with _inside("randomise"):
                draw = Randomise().with_changes(table.pop("randomise", {}))
            cells = tuple(_cell(written, number) for number, written in enumerate(table.pop("cell", ()), 1))
            estimators = tuple(table.pop("estimators", ()))
            return cls(path.stem, cells=cells, estimators=estimators, randomise=draw, **table)


def _kinds() -> dict[str, Any]:
    """What the top of a study's file may say."""
    kinds = {name: kind for name, kind in kinds_of(Study).items() if name not in ("name", "cells")}
    return kinds | {"randomise": Mapping[str, Any], "cell": tuple[Mapping[str, Any], ...]}


def _cell(written: Mapping[str, Any], number: int) -> Cell:
    with _inside(f"cell {written.get('name', number)!r}"):
        check(written, kinds_of(Cell), needed_of(Cell), "a cell has no")
        return Cell(**written)


@contextmanager
def _inside(where: str) -> Iterator[None]:
    """Whatever is wrong there says where."""
    try:
        yield
    except (UnknownNameError, TypeError, ValueError) as error:
        kind = type(error) if isinstance(error, UnknownNameError | TypeError) else ValueError
        raise kind(f"{where}: {error}") from None


STUDIES = shipped("studies")


def study_names() -> list[str]:
    """The studies that come with the package."""
    return sorted(path.stem for path in STUDIES.glob("*.toml"))
