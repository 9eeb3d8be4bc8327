"""Tunings files: an estimator's name, its settings, and where they come from."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.contenders import fingerprint
from vse_gym.evaluation.provenance import shipped
from vse_gym.registry import UnknownNameError

Plain = bool | int | float | str
PUBLISHED = "published"


@dataclass(frozen=True)
class Tuning:
    """An estimator with settings of its own.

    Raises:
        UnknownNameError: If there is no such estimator.
        TypeError, ValueError: If it has no such setting, or a value cannot be.
    """

    estimator: str  # its name in the catalogue, or module:Class
    settings: Mapping[str, Plain]  # by dotted names, as "model.vx_noise"; what is not named is the default
    origin: Mapping[str, Any] = field(default_factory=dict)  # how it was found; may nest

    def __post_init__(self) -> None:
        self.make()

    @classmethod
    def of(cls, name: str, estimator: Estimator, origin: Mapping[str, Any]) -> "Tuning":
        """The tuning that makes this very estimator from a name.

        Raises:
            ValueError: If it differs from the name's default in something that a file cannot hold.
        """
        tuning = cls(name, settings_of(estimator), origin)
        if tuning.digest != fingerprint(estimator):
            raise ValueError(f"{estimator!r} is not {name!r} with numbers and words changed")
        return tuning

    def make(self) -> Estimator:
        """The estimator."""
        made: Estimator = changed(default_of(self.estimator), self.settings)
        return made

    @property
    def digest(self) -> str:
        """Of the estimator, see :func:`fingerprint`."""
        return fingerprint(self.make())

    @property
    def label(self) -> str:
        """A row's name: "ekf-tuned (3f2a9c)"."""
        return f"{self.estimator}-tuned ({self.digest[:6]})"

    @classmethod
    def load(cls, path: str | Path) -> "Tuning":
        """What a file says.

        Raises:
            UnknownNameError, TypeError, ValueError, OSError: If it says what cannot be; the message names the file.
        """
        path = Path(path)
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8"))
            if table.keys() - {"origin"} != {"estimator", "settings"}:
                has = ", ".join(table) or "nothing"
                raise ValueError(f"a tunings file has estimator, [settings] and [origin]; this one has {has}")
            return cls(table["estimator"], _flat(table["settings"]), table.get("origin", {}))
        except (UnknownNameError, TypeError, ValueError) as error:
            kind = type(error) if isinstance(error, UnknownNameError | TypeError) else ValueError
            raise kind(f"{path}: {error}") from None

    @property
    def text(self) -> str:
        """The file that :meth:`load` reads; numbers read back bit by bit."""
        lines = [f"estimator = {_word(self.estimator)}"]
        for head, table in (("settings", self.settings), ("origin", _flat(self.origin))):
            lines += ["", f"[{head}]", *(f"{name} = {_word(value)}" for name, value in table.items())]
        return "\n".join(lines) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the file, at once or not at all."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_name(path.name + ".part")
        draft.write_text(self.text, encoding="utf-8")
        draft.replace(path)


def default_of(name: str) -> Estimator:
    """An estimator as it is without settings, by its name in the catalogue or as module:Class.

    Raises:
        UnknownNameError: If the catalogue has no such name.
        ValueError, TypeError: If a module has no such class, or it is no estimator.
    """
    if ":" not in name:
        made: Estimator = ESTIMATORS.make(name)
        return made
    try:
        thing = resolve_name(name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"estimator {name!r} cannot be had: {error}") from error
    made = ESTIMATORS.make(thing if isinstance(thing, Estimator) else thing())
    return made


def load_folder(path: str | Path) -> dict[str, Tuning]:
    """Every tuning of a folder's .toml files, or of one file, by the estimator's name.

    Args:
        path: "published" stands for the tunings that come with the package.

    Raises:
        FileNotFoundError: If there is no such folder or file.
        ValueError: If there is none, or two are of one estimator.
        UnknownNameError, TypeError, OSError: As :meth:`Tuning.load`.
    """
    path = shipped("tunings") if str(path) == PUBLISHED else Path(path)
    if not path.exists():
        told = f"{PUBLISHED!r} are those that come with the package, `vse-gym tune` writes others"
        raise FileNotFoundError(f"there is no tunings file or folder {path}; {told}")
    files = sorted(path.glob("*.toml")) if path.is_dir() else [path]
    if not files:
        raise ValueError(f"no tunings file (.toml) in {path}")
    found: dict[str, Tuning] = {}
    for file in files:
        tuning = Tuning.load(file)
        if tuning.estimator in found:
            raise ValueError(f"{path}: two tunings files of {tuning.estimator!r}")
        found[tuning.estimator] = tuning
    return found


# -- settings of an estimator, by dotted names ------------------------------------------------------------------------


def settings_of(thing: Any) -> dict[str, Plain]:
    """Every number, word and truth value among the fields of a dataclass and of those that it holds."""
    found: dict[str, Plain] = {}
    for name, value in _parts(thing).items():
        if isinstance(value, Plain):
            found[name] = value
        else:
            found |= {f"{name}.{inner}": v for inner, v in settings_of(value).items()}
    return found


def ranges(thing: Any) -> dict[str, tuple[float, float]]:
    """Where `vse-gym tune` may search, for the fields that :func:`vse_gym.models.tuning.tunable` made."""
    found: dict[str, tuple[float, float]] = {}
    metadata = {f.name: f.metadata for f in fields(thing)} if is_dataclass(thing) else {}
    for name, value in _parts(thing).items():
        if "tune" in metadata[name]:
            found[name] = metadata[name]["tune"]
        else:
            found |= {f"{name}.{inner}": limits for inner, limits in ranges(value).items()}
    return found


def changed(thing: Any, settings: Mapping[str, Plain]) -> Any:
    """The dataclass with other settings.

    Raises:
        TypeError: If it has no such setting, or a setting is of another kind; the message says what there is.
        ValueError: If its class refuses the value.
    """
    parts, own = _parts(thing), {}
    for head in dict.fromkeys(name.partition(".")[0] for name in settings):
        if head not in parts:
            has = f"it has {', '.join(parts)}" if parts else "it has none"
            raise TypeError(f"{type(thing).__name__} has no setting {head!r}; {has}")
        inner = {name.partition(".")[2]: v for name, v in settings.items() if name.partition(".")[0] == head}
        own[head] = _alike(head, inner[""], parts[head]) if "" in inner else changed(parts[head], inner)
    return replace(thing, **own) if own else thing


def _parts(thing: Any) -> dict[str, Any]:
    known = is_dataclass(thing) and not isinstance(thing, type)
    return {f.name: getattr(thing, f.name) for f in fields(thing)} if known else {}


def _alike(name: str, value: Plain, default: Any) -> Plain:
    """The value, if it is of the default's kind."""
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not type(default):
        raise TypeError(f"setting {name!r} must be of the kind of {default!r}, not {value!r}")
    return value


# -- TOML, as much of it as is needed ---------------------------------------------------------------------------------


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    """A table without tables in it: their entries by dotted names."""
    out: dict[str, Any] = {}
    for name, value in table.items():
        if isinstance(value, Mapping):
            out |= {f"{name}.{inner}": v for inner, v in _flat(value).items()}
        else:
            out[name] = value
    return out


def _word(value: Plain) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value if isinstance(value, int) else float(value))
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # which TOML wants escaped, unlike JSON
