"""The command compare: what changed between two folders of results."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from vse_gym.cli_screen import screen, sentences

LEGEND = (
    "B - A: mean of differences paired by cell and seed; 95 %: its interval over\n"
    "seeds; better, worse (of coverage more, less): the interval is clear of 0;\n"
    "same: it is not; ?: there is none. About one in twenty changes that are none is\n"
    "called better or worse, for nothing is adjusted for how many are looked at."
)
COLOURS = {"better": "green", "worse": "red"}


def compare(
    a: Annotated[Path, typer.Argument(help="What `vse-gym bench --out` wrote, or a parquet file of runs.")],
    b: Annotated[Path, typer.Argument(help="Another; what is printed is B minus A.")],
    by_cell: Annotated[
        bool, typer.Option("--by-cell", help="Regret in every cell, not only where most changed.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Write the same as Markdown into this file.")] = None,
) -> None:
    """What changed between two folders of results, with intervals; the exit code is 0 whatever did.

    First where the two come from and whether their common runs are the same, then differences of runs paired by cell
    and seed: regret, the shadow's error and coverage, drives that ended badly, times.
    """
    from vse_gym.report.compare import compare_results, sections, unchanged
    from vse_gym.report.results import read_results

    with sentences():
        found = compare_results(read_results(a), read_results(b))
        tables = sections(found, by_cell)
        lines = [line for line in (*found.origin, found.equality, unchanged(found)) if line]
        if out is not None:
            _write(found, tables, lines, f"A: {a}, B: {b}", out)
    screen.print(f"A: {escape(str(a))}\nB: {escape(str(b))}", style="italic", highlight=False)
    for line in lines:
        screen.print(escape(line), highlight=False)
    for title, heads, rows in tables:
        _show(title, heads, rows)
    if found.machines:
        screen.print(escape(found.machines), highlight=False)
    screen.print(LEGEND, style="dim", highlight=False)
    if out is not None:
        screen.print(f"written: {escape(str(out))}", highlight=False)


def _show(title: str, heads: list[str], rows: list[list[str]]) -> None:
    from vse_gym.report.text import on_screen

    def coloured(word: str) -> str:
        return f"[{COLOURS[word]}]{word}[/]" if word in COLOURS else escape(word)

    table = on_screen(heads, [[*map(escape, row[:-1]), coloured(row[-1])] for row in rows], title)
    if heads[0] == "cell":  # its name is a phrase, an estimator's is a word
        table.columns[0].no_wrap, table.columns[1].no_wrap = False, True
    screen.print(table)


def _write(found: Any, tables: list[Any], lines: list[str], title: str, out: Path) -> None:
    from vse_gym.report.text import markdown

    parts = [f"{title}\n", *(f"- {line}" for line in lines), ""]
    for name, heads, rows in tables:
        parts += [f"{name[0].upper()}{name[1:]}:\n", markdown(heads, rows)]
    parts += [f"{found.machines}\n"] if found.machines else []
    parts.append(" ".join(LEGEND.split()) + "\n")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text("\n".join(parts), encoding="utf-8")
