"""Cars, one TOML file each; the keys are the fields of :class:`Vehicle`, each marked published or chosen."""

import tomllib
from pathlib import Path
from typing import Any

from vse_gym.physics.parameters import TYRES, RollingBody, Vehicle, check_vehicle
from vse_gym.registry import UnknownNameError

FOLDER = Path(__file__).parent


def names() -> list[str]:
    """The cars that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(vehicle: str | Path | Vehicle) -> Vehicle:
    """A car by its name, from a TOML file of yours, or as it is; its numbers are checked.

    Raises:
        UnknownNameError: If no car has that name; the message names those that exist.
        ValueError: If a field is missing, unknown or out of range.
    """
    if isinstance(vehicle, Vehicle):
        return check_vehicle(vehicle)
    path = Path(vehicle) if str(vehicle).endswith(".toml") else FOLDER / f"{vehicle}.toml"
    if not path.is_file():
        raise UnknownNameError(
            f"no vehicle named {str(vehicle)!r}; known: {', '.join(names())}, or the path of a .toml file"
        )
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    for axle in ("front_tyre", "rear_tyre"):
        table[axle] = _tyre(path.name, axle, table.get(axle, {}))
    if "body" in table:  # a car without this table does not roll
        _check_keys(f"{path.name}: body", table["body"], RollingBody)
        table["body"] = RollingBody(**table["body"])
    _check_keys(path.name, table, Vehicle, unknown_to_files=("steering_offset", "radius_error"))
    return check_vehicle(Vehicle(**table))


def _tyre(file: str, axle: str, table: dict[str, Any]) -> Any:
    table = dict(table)
    law = table.pop("law", None)
    if law not in TYRES:
        raise ValueError(f"{file}: {axle}.law must be one of {', '.join(TYRES)}, not {law!r}")
    kind: Any = TYRES[law]
    _check_keys(f"{file}: {axle}", table, kind)
    return kind(**table)


def _check_keys(where: str, table: dict[str, Any], kind: Any, unknown_to_files: tuple[str, ...] = ()) -> None:
    """A file says every field that has no default, and those with one if it likes."""
    missing = sorted(set(kind._fields) - set(kind._field_defaults) - set(table))
    unknown = sorted(set(table) - set(kind._fields) | set(table) & set(unknown_to_files))
    if missing or unknown:
        raise ValueError(f"{where}: missing {missing or 'nothing'}, unknown {unknown or 'nothing'}")
