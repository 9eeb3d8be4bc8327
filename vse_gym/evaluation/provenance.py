"""Where a row comes from: versions, the commit, the machine."""

import os
import platform
import subprocess
from functools import lru_cache
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGE = Path(__file__).parent.parent
SHIPPED = ("studies", "tunings")  # data that a wheel carries inside the package, a checkout in benchmarks


def shipped(kind: str) -> Path:
    """The folder of what comes with the package, one of SHIPPED."""
    installed = PACKAGE / kind
    return installed if installed.is_dir() else PACKAGE.parent / "benchmarks" / kind


@lru_cache(maxsize=1)
def package_version() -> str:
    """Of vse-gym."""
    try:
        return version("vse-gym")
    except PackageNotFoundError:  # a source tree that is not installed
        return "0.0.0"


@lru_cache(maxsize=1)
def commit() -> str:
    """Of the checkout that this package is run from, with a plus if files differ from it; empty if installed."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=PACKAGE, capture_output=True, text=True, check=True, timeout=10)
        return done.stdout.strip()

    try:
        if not git("ls-files", "__init__.py"):  # installed below somebody else's checkout
            return ""
        head = git("rev-parse", "--short=10", "HEAD")
        return head + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return ""


@lru_cache(maxsize=1)
def source_digest() -> str:
    """Of all code and vehicle files of this package: alike in two runs, the same drives come out."""
    total = blake2b(digest_size=6)
    found = (path for ending in ("*.py", "*.toml") for path in PACKAGE.rglob(ending))
    for path in sorted(path for path in found if not set(SHIPPED) & set(path.relative_to(PACKAGE).parts)):
        total.update(path.relative_to(PACKAGE).as_posix().encode())
        total.update(path.read_bytes())
    return total.hexdigest()


@lru_cache(maxsize=1)
def libraries() -> str:
    """Versions of those that numbers depend on."""
    return ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))


@lru_cache(maxsize=1)
def machine() -> str:
    """Processor, cores, system and Python: what times depend on."""
    return f"{_processor()}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
