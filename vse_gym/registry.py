"""Names for classes, which are imported when first asked for."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import entry_points
from pkgutil import resolve_name
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class UnknownNameError(KeyError):
    """A name that no registry entry has; the message says which names there are."""

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError would show the sentence in quotes


class Registry(Mapping[str, type[T]], Generic[T]):
    """A read-only mapping from names to classes: ours, and those that other packages publish as entry points."""

    def __init__(self, group: str, builtin: Mapping[str, str], base: str = ""):
        self._group, self._builtin, self._base = group, dict(builtin), base

    @property
    def kind(self) -> str:
        """What the registry names, in the singular: "estimator"."""
        return self._group.rpartition(".")[2].removesuffix("s")

    def _paths(self) -> dict[str, str]:
        plugins = {e.name: e.value for e in entry_points(group=self._group)}
        if taken := plugins.keys() & self._builtin.keys():
            raise ValueError(f"{self._group}: a plugin reuses the name {sorted(taken)}")
        return self._builtin | plugins

    def __getitem__(self, name: str) -> type[T]:
        paths = self._paths()
        if name not in paths:
            raise UnknownNameError(f"no {self.kind} named {name!r}; known: {', '.join(paths)}")
        found: type[T] = resolve_name(paths[name])
        return found

    def __contains__(self, name: object) -> bool:
        return name in self._paths()  # without importing the class

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths())

    def __len__(self) -> int:
        return len(self._paths())

    def make(self, thing: str | T, **settings: Any) -> T:
        """The instance itself, or one of the class with that name and these settings.

        Raises:
            UnknownNameError: If no class has that name.
            TypeError: If the class has no such setting, settings come with an instance, or it is of another kind.
        """
        if isinstance(thing, str):
            kind: Any = self[thing]
            known = [f.name for f in fields(kind)] if is_dataclass(kind) else list(settings)
            if wrong := sorted(settings.keys() - set(known)):
                raise TypeError(f"{self.kind} {thing!r} has no setting {', '.join(wrong)}; it has {', '.join(known)}")
            made: T = kind(**settings)
            return made
        if isinstance(thing, type):
            raise TypeError(f"{thing.__name__} is a class: give an instance, {thing.__name__}(...), or a name")
        if self._base and not isinstance(thing, resolve_name(self._base)):
            raise TypeError(f"neither a name of the catalogue nor a {self._base.rpartition(':')[2]}: {thing!r}")
        if settings:
            raise TypeError(f"settings {sorted(settings)} go into {type(thing).__name__}(...) itself")
        return thing
