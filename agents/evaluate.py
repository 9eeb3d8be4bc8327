"""Agents as controllers, in the same drives and the same table as esc: who keeps the car on the road, by whose eyes?

    python agents/evaluate.py ppo_residual --estimators ekf --estimators ukf --study headline-v1 --seeds 5
    python agents/evaluate.py ppo_residual ppo_alone --estimators all --jobs 2 --out results/agents

An agent is the folder that train.py wrote, or the name of one of agents/trained. The matrix has the agents as rows
and the estimators that they drive with as columns; below it stands what each was trained with.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import tables
import typer
from matplotlib.figure import Figure
from rich.markup import escape

from vse_gym.catalogue import ESTIMATORS
from vse_gym.cli_screen import Jobs, bar, screen, sentences
from vse_gym.controllers.base import Controller
from vse_gym.evaluation.battery import OWN, battery
from vse_gym.evaluation.study import Study
from vse_gym.policy import CARD, TrainedPolicy
from vse_gym.report.text import Sheet, in_blocks, markdown, on_screen

TRAINED = Path(__file__).parent / "trained"
BESIDE = ("none", "esc", "lqr")
USUAL = ("truth", "ekf", "ukf", "ekf_double_track", "kinematic", "pf")


def main(
    agents: Annotated[list[str], typer.Argument(help="Folders, or names of agents/trained.")],
    estimators: Annotated[list[str], typer.Option(help="What they see the car through; all: every one.")] = USUAL,
    beside: Annotated[list[str], typer.Option(help="Controllers in the same table.")] = BESIDE,
    study: Annotated[str, typer.Option(help="Whose cells and draws: a name, or a TOML file.")] = "headline-v1",
    seeds: Annotated[int | None, typer.Option(min=1, help="Without it the study's own.")] = None,
    jobs: Jobs = 1,
    out: Annotated[Path | None, typer.Option(help="Folder for runs.parquet, agents.md and agents.png.")] = None,
) -> None:
    """Drive a study with agents in the place of the cells' controllers, and beside them others."""
    with sentences():
        trained = {Path(name).name: TrainedPolicy(str(folder_of(name))) for name in agents}
        if len(trained) < len(agents):
            raise ValueError(f"agents need folders of different names, not {', '.join(agents)}")
        controllers: dict[str, str | Controller] = {name: name for name in dict.fromkeys(("none", "esc", *beside))}
        if taken := (controllers.keys() | {OWN}) & trained.keys():
            raise ValueError(f"an agent has the name of a controller: {', '.join(taken)}")
        judged = tuple(ESTIMATORS) if tuple(estimators) == ("all",) else tuple(estimators)
        with bar("cells and seeds") as progress:
            runs = battery(Study.load(study), controllers | {OWN: OWN} | trained, judged, seeds, jobs, progress)
        order = [*controllers, OWN, *trained]
        sheets = {
            f"{study}, {runs['seed'].n_unique()} seeds, {len(judged)} estimators": tables.summary(runs, order),
            "paired differences": tables.against(runs, order, ["none", "esc"]),
            "slide deg, who controls by which estimator": tables.matrix(runs, order),
            "regret, who controls by which estimator": tables.matrix(runs, order, tables.REGRET),
        }
        for title, sheet in sheets.items():
            for block in in_blocks(*sheet, columns=4):
                screen.print(on_screen(*block, title))
        screen.print(tables.LEGEND, highlight=False)
        for name, agent in trained.items():
            screen.print(f"{escape(name)}: {trained_with(agent)}", highlight=False)
        if out is not None:
            write(out, runs, sheets, trained)


def folder_of(name: str) -> Path:
    """Where an agent is.

    Raises:
        ValueError: If there is none of that name.
    """
    for folder in (Path(name), TRAINED / name):
        if (folder / CARD).is_file():
            return folder
    known = ", ".join(sorted(path.parent.name for path in TRAINED.glob(f"*/{CARD}"))) or "none yet"
    raise ValueError(f"{name} is neither an agent's folder nor one of agents/trained: {known}")


def trained_with(agent: TrainedPolicy) -> str:
    """A sentence about an agent."""
    card = agent.card
    task = card.trained.get("task", {})
    by = ", ".join(task.get("estimator", ["unknown"]))
    return f"{card.algorithm}, {card.action} on top of {card.controller}, trained with {by}"


def write(out: Path, runs: object, sheets: dict[str, Sheet], trained: dict[str, TrainedPolicy]) -> None:
    """The table, all that was printed, and the matrix as a picture."""
    import polars as pl

    assert isinstance(runs, pl.DataFrame)
    out.mkdir(parents=True, exist_ok=True)
    runs.write_parquet(out / "runs.parquet")
    parts = [f"## {title}\n\n{markdown(*sheet)}" for title, sheet in sheets.items()]
    told = "\n".join(f"- {name}: {trained_with(agent)}" for name, agent in trained.items())
    (out / "agents.md").write_text("\n".join([*parts, tables.LEGEND, "", told, ""]), encoding="utf-8")
    draw(out / "agents.png", runs)


def draw(path: Path, runs: object) -> None:
    """The matrix of slides as a picture: who controls, by which estimator; both in the order of their mean slide."""
    import polars as pl

    assert isinstance(runs, pl.DataFrame)
    columns = {e: tables.cube(runs, tables.SLIDE, [e]) for e in runs["estimator"].unique().to_list()}
    names = next(iter(columns.values()))[0]
    slides = {e: values.mean(axis=(1, 2)) for e, (_, values) in columns.items()}
    estimators = sorted(slides, key=lambda e: float(slides[e].mean()))
    table = np.array([slides[e] for e in estimators]).T
    rows = np.argsort(table.mean(axis=1))
    table = table[rows]
    figure = Figure(figsize=(2.6 + 0.34 * len(estimators), 1.6 + 0.3 * len(names)), layout="constrained")
    axes = figure.subplots()
    shades = axes.imshow(table, cmap="YlOrRd", vmin=0, vmax=tables.MOST / 2, aspect="auto")
    for (row, column), value in np.ndenumerate(table):
        ink = "white" if value > 0.75 * tables.MOST / 2 else "black"
        axes.text(column, row, f"{value:.1f}", ha="center", va="center", fontsize=6, color=ink)
    axes.set_xticks(range(len(estimators)), estimators, rotation=60, ha="right", rotation_mode="anchor", fontsize=7)
    axes.set_yticks(range(len(names)), [names[k] for k in rows], fontsize=7)
    axes.set_title("Slide deg, mean: who controls, by which estimator", fontsize=9)
    figure.colorbar(shades, extend="max")
    figure.savefig(path, dpi=130)


app = typer.Typer(add_completion=False)
app.command()(main)

if __name__ == "__main__":
    app()
