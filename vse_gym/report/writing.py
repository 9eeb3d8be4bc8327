"""The folder of a study: its table of runs, and what is made of it."""

from contextlib import suppress
from pathlib import Path

import polars as pl

from vse_gym.report import figures
from vse_gym.report.page import page
from vse_gym.report.question import answer
from vse_gym.report.question_figure import question_figure
from vse_gym.report.question_text import answer_text
from vse_gym.report.sections import sections
from vse_gym.report.tables import summary
from vse_gym.report.text import markdown


def write(runs: pl.DataFrame, folder: Path, command: str) -> None:
    """The table of runs, and all that :func:`write_tables` makes of it."""
    folder.mkdir(parents=True, exist_ok=True)
    runs.write_parquet(folder / "runs.parquet")
    write_tables(runs, folder, command)


def write_tables(runs: pl.DataFrame, folder: Path, command: str) -> None:
    """Tables and the answer to the question as Markdown; with the extra [report] four figures and a page too.

    ``table.md``, ``question.md``, ``regret.png``, ``ranks.png``, ``improvement.png``, ``question.png``,
    ``report.html`` and the script that it needs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    summarised = summary(runs)
    found = sections(runs, summarised)
    seeds, cells = runs["seed"].n_unique(), runs["cell"].n_unique()
    parts = [f"`{command}`: {cells} cells, {seeds} seeds.\n"]
    for section in found:
        parts += [f"## {section.title}\n", f"{section.text}\n", markdown(*section.sheet)]
    (folder / "table.md").write_text("\n".join(parts), encoding="utf-8")
    with suppress(ModuleNotFoundError):  # without the extra [report], tables alone
        figures.regret(runs, folder / "regret.png")
        figures.places(summarised, folder / "ranks.png")
        figures.improvement(runs, folder / "improvement.png")
        page(runs, summarised, found, folder / "report.html", command)
    _write_answer(runs, folder, command)


def _write_answer(runs: pl.DataFrame, folder: Path, command: str) -> None:
    """How far the shadow error predicts regret; why not, where a table cannot say."""
    title = f"`{command}`\n\n## Does a small error make a good drive?\n\n"
    try:
        found = answer(runs)
    except ValueError as error:
        said = f"This table does not say: {error}.\n"
        (folder / "question.png").unlink(missing_ok=True)  # of an earlier table
    else:
        said = answer_text(found)
        with suppress(ModuleNotFoundError):
            question_figure(found, folder / "question.png")
    (folder / "question.md").write_text(title + said, encoding="utf-8")
