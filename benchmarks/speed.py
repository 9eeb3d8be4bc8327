"""How fast this package is, beside its peers: one table, measured in one run.

    python benchmarks/speed.py                     everything
    python benchmarks/speed.py --only filterpy     one group of rows; the others: env, vector, particles, plant, drive,
                                                   start, blocks

A figure is the median of repeats, with the least and the greatest beside it. Here and peer take turns, and a ratio is
the median of the repeats' own ratios, so that a machine that slows down for a while slows both sides; one repeat more
than asked for is made first and thrown away. Times are processor time, which waiting for other people's processes does
not lengthen; only the starts of processes, and the vector environment with its two threads, are timed by the clock on
the wall. Everything else runs in one thread.

Peers run in a virtual environment of their own, .venv-peers, made when missing, on the same readings with the same
compiled model; that they give the same estimates is checked before.
"""

import json
import os
import platform
import tempfile
import time
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from speed_rows import GROUPS, Bench


def _machine() -> str:
    info = Path("/proc/cpuinfo")
    names = [line for line in info.read_text().splitlines() if line.startswith("model name")] if info.exists() else []
    processor = names[0].partition(": ")[2] if names else platform.processor()
    return f"{processor}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {platform.platform(terse=True)}"


def main(
    repeats: Annotated[int, typer.Option(min=1, help="Of each measurement but the starts and whole drives.")] = 11,
    only: Annotated[list[str] | None, typer.Option(help=f"Groups of rows: {', '.join(GROUPS)}.")] = None,
    json_path: Annotated[Path | None, typer.Option("--json", help="Write every sample here.")] = None,
    check: Annotated[bool, typer.Option("--check", help="Exit with 1 if a target is missed.")] = False,
) -> None:
    """Measure this package beside its peers and print one table."""
    if unknown := set(only or ()) - set(GROUPS):
        raise typer.BadParameter(f"no group {', '.join(sorted(unknown))}; known: {', '.join(GROUPS)}")
    began, console, rows = time.perf_counter(), Console(), []
    table = Table("what", "here", "peer", "here/peer", "target", "reached", title="Speed: median (least - greatest)")
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(repeats, Path(folder))
        for group in only or GROUPS:
            for row in getattr(bench, group)():
                rows.append(row)
                table.add_row(*row.cells())
            table.add_section()
        peers = bench.peers.ask("versions") if bench.peers.process else {}
        bench.peers.close()
    here = {"python": platform.python_version()} | {name: version(name) for name in ("numba", "numpy", "gymnasium")}
    setting = {"machine": _machine(), "here": here, "peers": peers or "not asked", "repeats": repeats}
    setting["seconds"] = round(time.perf_counter() - began)
    console.print(table)
    for note in bench.notes:
        console.print(f"- {note}", highlight=False)
    for key, value in setting.items():
        text = ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else value
        console.print(f"{key}: {text}", highlight=False)
    if json_path:
        results = [asdict(row) | {"ratio": row.ratio, "reached": row.reached} for row in rows]
        json_path.write_text(json.dumps({"setting": setting, "notes": bench.notes, "rows": results}, indent=1))
    if check and any(row.reached is False for row in rows):
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
