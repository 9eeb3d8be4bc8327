"""The one way to use numba here: ``@compiled`` for a kernel, ``@generic`` for one whose body its first argument picks.

Two faults of plain ``njit(cache=True)`` are mended. Its cache looks only at the file that holds the function, so a
change in a *called* file leaves stale machine code in use (numba issue 1833): here the cache folder is named by a
digest of every kernel source. And functions handed to kernels as arguments are never cached at all: here a kernel
chooses its body by the *type* of its first argument, a NamedTuple of parameters, which is cached.
"""

import atexit
import hashlib
import inspect
import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Generic, ParamSpec, TypeVar

import numba
from numba import types
from numba.experimental import structref
from numba.extending import overload

P = ParamSpec("P")
R = TypeVar("R")

config: Any = numba.config  # numba has no types of its own
_PACKAGE = Path(__file__).parent
TYPES_IN = ("physics", "inference", "types.py")  # where types that kernels read may be defined without a kernel
_dispatchers: list[Any] = []  # every kernel of the package, to be given a new cache folder when the digest changes


def _package_digest() -> str:
    """Digest of every source file of the package that defines a kernel or a type that kernels read."""
    digest = hashlib.blake2b(numba.__version__.encode(), digest_size=8)
    for path in sorted(_PACKAGE.rglob("*.py")):
        source = path.read_bytes()
        if b"@compiled" in source or path.relative_to(_PACKAGE).parts[0] in TYPES_IN:
            digest.update(source)
    return digest.hexdigest()


_digest = _package_digest()


def cache_folder() -> Path:
    """Where machine code is kept: below $VSE_GYM_CACHE, else below the user's cache folder."""
    base = (
        os.environ.get("VSE_GYM_CACHE") or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vse-gym"
    )
    return Path(base) / f"kernels-{_digest}"


def _forget_old_code() -> None:
    """Every change of a kernel leaves a folder behind; those unused for a month go when a new one begins."""
    if cache_folder().exists():
        with suppress(OSError):
            os.utime(cache_folder())  # in use
    else:
        for folder in cache_folder().parent.glob("kernels-" + 16 * "[0-9a-f]"):
            with suppress(OSError):
                if time.time() - folder.stat().st_mtime > 30 * 24 * 3600:
                    shutil.rmtree(folder)


_forget_old_code()


def _enable_cache(dispatcher: Any) -> None:
    """Point one kernel's cache at the digest's folder; without a writable folder it compiles in every process."""
    if not hasattr(dispatcher, "enable_caching"):  # NUMBA_DISABLE_JIT=1 hands plain functions back
        return
    previous = config.CACHE_DIR  # numba reads the setting once, here, when the cache is attached
    config.CACHE_DIR = str(cache_folder())
    try:
        dispatcher.enable_caching()
    except (OSError, RuntimeError):  # read-only home, full disk
        pass
    finally:
        config.CACHE_DIR = previous


def _is_ours(function: Callable[..., Any]) -> bool:
    return _source_file(function).is_relative_to(_PACKAGE)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code on first call, cached across processes.

    Floats divide as IEEE has it (no ZeroDivisionError) and the interpreter lock is released. A function from outside
    this package is compiled in every process unless it is registered with a generic (see :class:`GenericFunction`).
    """
    dispatcher = numba.njit(error_model="numpy", nogil=True)(function)
    if _is_ours(function):
        _dispatchers.append(dispatcher)
        _enable_cache(dispatcher)
    return dispatcher  # type: ignore[no-any-return]


_foreign: set[type] = set()


def _include_in_digest(kind: type, path: Path) -> None:
    """Kernels specialised for a foreign type hold its machine code and name its module: a cache folder of its own."""
    global _digest
    if kind in _foreign:
        return
    _foreign.add(kind)
    typed_in = not path.is_file()  # into an interpreter: no source to tell its versions apart, so no process shares it
    source = os.urandom(8) if typed_in else path.read_bytes()
    name = f"{_digest}/{kind.__module__}.{kind.__qualname__}"
    _digest = hashlib.blake2b(name.encode() + source, digest_size=8).hexdigest()
    if typed_in:
        atexit.register(shutil.rmtree, cache_folder(), ignore_errors=True)
    for dispatcher in _dispatchers:
        _enable_cache(dispatcher)


def _source_file(thing: Any) -> Path:
    """The file that defines a function or a class; of a class typed into an interpreter, one that does not exist."""
    try:
        return Path(inspect.getfile(inspect.unwrap(thing)))
    except (OSError, TypeError):
        return Path("<typed in>")


def _include_types_of(value: tuple[Any, ...]) -> None:
    if hasattr(value, "_fields") and not type(value).__module__.startswith("vse_gym."):
        _include_in_digest(type(value), _source_file(type(value)))
    for part in value:
        if isinstance(part, tuple):  # asked here: a call for each number of a car would be most of a hold's time
            _include_types_of(part)


class GenericFunction(Generic[P, R]):
    """A function that picks its body by the type of its first argument; made by :func:`generic`."""

    def __init__(self, declaration: Callable[P, R]):
        self.declaration = declaration
        self.bodies: dict[type, Callable[..., R]] = {}

    def body(self, kind: type) -> Callable[..., R]:
        """The body registered for a type, or for the nearest one that it derives from: ``object`` is every type's.

        Raises:
            TypeError: If there is none; the message names those that have one.
        """
        for ancestor in kind.__mro__:
            if ancestor in self.bodies:
                return self.bodies[ancestor]
        known = ", ".join(sorted(k.__name__ for k in self.bodies)) or "none yet"
        raise TypeError(f"{self.declaration.__name__}() is not registered for {kind.__name__}; known: {known}")

    def register(self, kind: type) -> Callable[[Callable[..., R]], Callable[..., R]]:
        """Decorator: use this compiled function when the first argument is a ``kind`` (a NamedTuple class)."""

        def add(body: Callable[..., R]) -> Callable[..., R]:
            source = getattr(body, "py_func", body)
            if not _is_ours(source):
                _include_in_digest(kind, _source_file(source))
            self.bodies[kind] = body
            return body

        return add


def generic(declaration: Callable[P, R]) -> Any:
    """Declare a function whose body is chosen by its first argument's type, in Python and inside kernels alike.

    The declaration holds the docstring and the signature; bodies are added with ``declared.register(Type)``.
    """
    table: GenericFunction[P, R] = GenericFunction(declaration)

    @wraps(declaration)
    def dispatch(first: Any, *rest: Any) -> R:
        return table.body(type(first))(first, *rest)

    # The body itself, inlined: a wrapper would count references to the model's arrays anew at every call, for 90 ns.
    @overload(dispatch, strict=False, inline="always", jit_options={"error_model": "numpy", "nogil": True})
    def choose(first, *rest):
        if isinstance(first, types.BaseNamedTuple):
            body = table.body(first.instance_class)  # type: ignore[attr-defined]
            return getattr(body, "py_func", body)
        return None

    dispatch.register = table.register  # type: ignore[attr-defined]
    dispatch.bodies = table.bodies  # type: ignore[attr-defined]
    return dispatch


class Held(structref.StructRefProxy):  # type: ignore[misc]
    """Constants that compiled code has been handed already; made by :func:`hold`. Copies and pickles by value."""

    value: Any
    _numba_type_ = property(attrgetter("_type"))  # what the base class gives too, but without a call of Python code

    def __reduce__(self) -> tuple[Any, ...]:
        return hold, (self.value,)


@structref.register
class _HeldType(types.StructRef):
    """What numba calls a :class:`Held`."""


structref.define_boxing(_HeldType, Held)
structref.define_constructor(Held, _HeldType, ["value"])


@compiled
def _hold(value):
    return Held(value)


def hold(value: Any) -> Any:
    """Hand a NamedTuple, or a tuple of them, to compiled code once.

    Kernels that are given what comes back find it as ``held.value``. Passing a NamedTuple costs 0.5 us and 0.05 us per
    field at every call, passing a held one 0.5 us however large it is; holding costs some 4 us, once.
    """
    if config.DISABLE_JIT:
        return SimpleNamespace(value=value)
    _include_types_of(value)
    held = _hold(value)
    held.value = value  # for Python's eyes: copying, pickling
    return held
