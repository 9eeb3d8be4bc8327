"""The command check: does somebody's estimator, controller or manoeuvre keep the published promises?"""

import importlib
import sys
import traceback
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from inspect import isabstract, isfunction
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vse_gym.catalogue import CONTROLLERS, ESTIMATORS, MANOEUVRES
from vse_gym.cli_screen import first_sentence, mark, refuse, screen
from vse_gym.registry import Registry

KINDS = (ESTIMATORS, CONTROLLERS, MANOEUVRES)


class TargetError(ValueError):
    """What was named cannot be had; the message says why and what to do."""


def check(
    target: Annotated[str, typer.Argument(help="my_package:Mine (a class, instance or factory), or a catalogue name.")],
    seed: Annotated[int, typer.Option(help="Of the example drive's noise.")] = 0,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show the traceback of what fails.")] = False,
) -> None:
    """Run the conformance checks on an estimator, a controller or a manoeuvre; exit code 1 if any fails.

    Modules are found in the current directory too: `vse-gym check my_file:Mine`.
    """
    from vse_gym.testing import conformance

    failed: list[Any] = []
    try:
        for thing in find(target):
            table = Table("check", "", "what is promised", title=escape(f"{target}: {type(thing).__name__}"))
            with screen.status("checking"):
                for finding in conformance(thing, seed):
                    kept = finding.error is None
                    table.add_row(_named(finding), mark(kept), escape(first_sentence(finding.check)))
                    failed += [] if kept else [finding]
            screen.print(table)
    except TargetError as error:
        if verbose and error.__cause__ is not None:
            _print_traceback(error.__cause__)
        raise refuse(error) from None
    except KeyboardInterrupt:
        Console(stderr=True).print("stopped")
        raise typer.Exit(130) from None
    _explain(failed, verbose)
    screen.print(f"verdict: {mark(not failed, 'keeps every promise', f'{len(failed)} promises broken')}")
    raise typer.Exit(1 if failed else 0)


def _explain(failed: Sequence[Any], verbose: bool) -> None:
    """What was found wrong; several checks that stumbled over the same share one explanation."""
    said = {f: str(f.error) if isinstance(f.error, AssertionError) else _raised(f.error) for f in failed}
    for what in dict.fromkeys(said.values()):
        alike = [f for f in failed if said[f] == what]
        screen.print(f"[red]{', '.join(map(_named, alike))}[/red]: {escape(what)}", highlight=False)
        if verbose:
            _print_traceback(alike[0].error)
    if failed and not verbose:
        screen.print("(--verbose shows where)", style="dim")


def find(target: str) -> Iterator[Any]:
    """What a target stands for: an instance of each catalogue's entry of that name, or what a module holds.

    Raises:
        TargetError: If there is no such thing, or it cannot be made.
    """
    module, colon, name = target.partition(":")
    if module and colon and name:
        yield _from_module(module, name)
        return
    if named := [registry[target] for registry in KINDS if target in registry]:
        yield from map(_made, named)
        return
    known = [name for registry in KINDS for name in registry]
    module, _, last = target.rpartition(".")
    dotted = [f"{module}:{'Class' if last == 'py' else last}"] if module.replace(".", "").isidentifier() else []
    near = dotted or get_close_matches(target, known, 3)
    hint = f"; did you mean {' or '.join(near)}?" if near else ""
    raise TargetError(f"{target!r} is no name that `vse-gym list` shows; write module:Name for one of your own{hint}")


def of_kind(target: str, catalogue: Registry[Any]) -> Any:
    """A name of the catalogue as it is, module:Class as an instance.

    Raises:
        TargetError: If there is no such class, or it is of another kind.
    """
    if not {":", "."} & set(target):
        return target
    thing = next(iter(find(target)))
    try:
        return catalogue.make(thing)
    except TypeError:
        raise TargetError(f"{target} makes a {type(thing).__name__}, which is no {catalogue.kind}") from None


def _from_module(module: str, name: str) -> Any:
    if module.endswith(".py") or "/" in module:
        raise TargetError(f"{module} is a path: {_instead(Path(module.removesuffix('.py')), name)}")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    try:
        thing: Any = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name and (module == error.name or module.startswith(f"{error.name}.")):
            raise TargetError(f"there is no module {error.name!r}, neither installed nor in {here}") from error
        raise TargetError(f"{module} cannot be imported: {error}") from error
    except (Exception, SystemExit) as error:
        raise TargetError(f"{module} cannot be imported: it {_raised(error)}") from error
    for part in name.split("."):
        if not hasattr(thing, part):
            has = ", ".join(_usable(thing, module)) or "no estimator, controller or manoeuvre"
            raise TargetError(f"{module} has no {name!r}; it has {has}")
        thing = getattr(thing, part)
    return _made(thing)


def _instead(path: Path, name: str) -> str:
    if path.is_absolute() or ".." in path.parts:
        return f"call the command in {path.parent} and write {path.name}:{name}"
    return f"write {'.'.join(path.parts)}:{name}"


def _usable(thing: Any, module: str) -> list[str]:
    """Names of a module, or of a class, that stand for an estimator, a controller or a manoeuvre, or may make one."""
    found = []
    for name, value in vars(thing).items():
        if isinstance(value, type):
            usable = issubclass(value, _bases()) and not isabstract(value)
        else:
            usable = isinstance(value, _bases()) or (isfunction(value) and value.__module__ == module)
        if usable and not name.startswith("_"):
            found.append(name)
    return sorted(found)


def _bases() -> tuple[type, ...]:
    from vse_gym.controllers.base import Controller
    from vse_gym.estimators.base import Estimator
    from vse_gym.manoeuvres.base import Manoeuvre

    return Estimator, Controller, Manoeuvre


def _made(thing: Any) -> Any:
    """An instance: the thing itself, or what a class or a factory makes without arguments."""
    bases = _bases()
    if isinstance(thing, type) and not issubclass(thing, bases):
        raise TargetError(f"{thing.__name__} derives neither from Estimator nor from Controller nor from Manoeuvre")
    if isabstract(thing):
        raise TargetError(f"{thing.__name__} lacks {', '.join(sorted(thing.__abstractmethods__))}: write them")
    if not isinstance(thing, bases) and callable(thing):
        try:
            thing = thing()
        except Exception as error:
            advice = "give its settings defaults, or name a function without arguments that makes one"
            raise TargetError(f"{getattr(thing, '__name__', thing)}() {_raised(error)}; {advice}") from error
    if not isinstance(thing, bases):
        raise TargetError(f"neither an Estimator nor a Controller nor a Manoeuvre: {thing!r:.100}")
    return thing


def _named(finding: Any) -> str:
    return str(finding.check.__name__).removeprefix("check_").replace("_", " ")


def _raised(error: BaseException) -> str:
    return f"raised {type(error).__name__}: {error}"


def _print_traceback(error: BaseException) -> None:
    screen.print("".join(traceback.format_exception(error)), style="dim", highlight=False, markup=False, soft_wrap=True)
