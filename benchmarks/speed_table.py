"""What speed.py prints: rows with samples of here and a peer, and the process that the peers run in."""

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
REQUIREMENTS, PEERS = ROOT / "benchmarks" / "peers-requirements.txt", ROOT / ".venv-peers"


@dataclass
class Row:
    """One line of the table: of a rate, more is better; of anything else, less."""

    what: str
    unit: str
    here: list[float]
    peer: str = ""
    theirs: list[float] = field(default_factory=list)
    target: float | None = None
    of_ratio: bool = False  # the target is for here over peer, not for the figure here

    @property
    def ratio(self) -> float | None:
        """Median of here over peer, repeat by repeat; None without a peer."""
        ratios = [a / b for a, b in zip(self.here, self.theirs, strict=False)]
        return statistics.median(ratios) if ratios else None

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached; None if there is none."""
        value = self.ratio if self.of_ratio else statistics.median(self.here)
        if self.target is None or value is None:
            return None
        return value >= self.target if self.unit == "steps/s" else value <= self.target

    def cells(self) -> list[str]:
        """The line as printed."""
        target = ""
        if self.target is not None:
            sign = ">=" if self.unit == "steps/s" else "<="
            target = f"{sign} {_ratio(self.target) if self.of_ratio else f'{self.target:,g} {self.unit}'}"
        peer = f"{self.peer}: {spread(self.theirs)}" if self.theirs else ""
        verdict = {True: "[green]yes", False: "[bold red]no", None: ""}[self.reached]
        ratio = "" if self.ratio is None else _ratio(self.ratio)
        return [self.what, f"{spread(self.here)} {self.unit}", peer, ratio, target, verdict]


def spread(values: Sequence[float]) -> str:
    """The median, with the least and the greatest."""
    figures = statistics.median(values), min(values), max(values)
    middle, *ends = (f"{v:,.3g}" if v < 1000 else f"{v:,.0f}" for v in figures)
    return f"{middle} ({' - '.join(ends)})"


def _ratio(ratio: float) -> str:
    return f"1/{1 / ratio:.3g}" if ratio < 1 else f"{ratio:,.3g}"


class Peers:
    """The process that peers.py runs in; started when first asked."""

    process: "subprocess.Popen[str] | None" = None

    def __init__(self, drive: Path):
        self.drive = drive

    def ask(self, request: str, *arguments: Any) -> Any:
        """The answer to one request of peers.py.

        Raises:
            RuntimeError: If the process ended; what it said stands above.
        """
        self.process = self.process or self._start()
        print(json.dumps([request, *arguments]), file=self.process.stdin, flush=True)
        if not (answer := self.process.stdout.readline()):
            raise RuntimeError(f"peers.py ended over {request}")
        return json.loads(answer)

    def _start(self) -> "subprocess.Popen[str]":
        python, installed = PEERS / "bin" / "python", PEERS / REQUIREMENTS.name
        if not installed.exists() or installed.read_text() != REQUIREMENTS.read_text():
            subprocess.run([sys.executable, "-m", "venv", PEERS], check=True)
            subprocess.run([python, "-m", "pip", "install", "--quiet", "-r", REQUIREMENTS], check=True)
            installed.write_text(REQUIREMENTS.read_text())
        settings = {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore", "SDL_VIDEODRIVER": "dummy"}
        settings["OPENBLAS_NUM_THREADS"] = "1"  # one thread on either side
        command = [python, ROOT / "benchmarks" / "peers.py", self.drive]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        return subprocess.Popen(command, env=os.environ | settings, text=True, **pipes)

    def close(self) -> None:
        """End the process."""
        if self.process:
            self.process.communicate()
