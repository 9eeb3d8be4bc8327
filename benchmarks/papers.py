"""The five published systems' experiments, claim by claim: does it hold here?

    python benchmarks/papers.py                  all of them, 20 seeds
    python benchmarks/papers.py A D --seeds 40
    python benchmarks/papers.py B --tune         search the tunings again (benchmarks/papers_tunings), then run
    python benchmarks/papers.py --out docs/papers        write what the documentation shows again

Each test is driven as published, as far as the print says; what it does not say is chosen, and listed. The plant is
this project's in place of ADAMS or CarSim. Estimators hear the same readings of a drive without stability control.
Settings are the published ones where the print gives them; else everybody in a system's table has the tuning that the
same search found, of the same budget, on seeds that no table uses. Each page says which. A figure is the median over
seeds; a claim that one estimator is better than another is judged by the median of paired differences and its 90 %
interval: "holds" or "fails" if zero lies outside, else "open". Seeds draw the noise, not the drive: a verdict is one
about the page's manoeuvre, car and sensors.
"""

import time
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from papers_common import Claim, Outcome, Paper
from papers_search import search_rows, tune_for
from rich.console import Console
from rich.progress import track

from vse_gym.report.text import markdown, on_screen

SYSTEMS = {
    "A": "model-adaptive particle filter, Qin et al. (2014)",
    "B": "adaptive cubature particle filter, CN110532590A (2019)",
    "C": "least squares and fuzzy-adaptive EKF, Wang et al. (2017)",
    "D": "switching estimator, Chen et al. (2024)",
    "E": "SR-UKF and stiffness by least squares, Tian et al. (2018)",
}
HEADS = ["system", "claim", "published", "here: median [90 %]", "verdict", "why, as far as measured"]
WORDS = (0, 1, 4, 5)


def main(
    systems: Annotated[list[str] | None, typer.Argument(help="Some of A, B, C, D, E; all if none is named.")] = None,
    seeds: Annotated[int, typer.Option(min=6, max=1000, help="How many, from 0 on.")] = 20,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    tune: Annotated[bool, typer.Option("--tune", help="Search the tunings first.")] = False,
    budget: Annotated[int | None, typer.Option(min=1, help="Trials of a search; without it the system's own.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for pages and pictures.")] = Path("results/papers"),
) -> None:
    """Put the papers' claims to the test."""
    wanted = [name.upper() for name in systems or SYSTEMS]
    if unknown := set(wanted) - set(SYSTEMS):
        known = ", ".join(SYSTEMS)
        raise typer.BadParameter(f"no system {', '.join(sorted(unknown))}; known: {known}")
    out.mkdir(parents=True, exist_ok=True)
    console = Console()
    for system in wanted:
        begin = time.perf_counter()
        module: Any = import_module(f"papers_{system.lower()}")
        if tune:
            for name in track(module.TUNED, f"{system}: searching tunings", transient=True):
                tune_for(system, name, module.training_drive, module.loss, budget or module.BUDGET)
        outcome: Outcome = module.run(Paper(system, range(seeds), jobs, out))
        text = _page(system, outcome, seeds, time.perf_counter() - begin)
        (out / f"{system}.md").write_text(text, encoding="utf-8")
        (out / "claims.md").write_text(_all_claims(out), encoding="utf-8")
        console.print(on_screen(HEADS, [list(c) for c in outcome.claims], SYSTEMS[system], words=WORDS))
        for title, sheet in outcome.tables.items():
            console.print(on_screen(sheet.heads, sheet.rows, title))
        for note in outcome.notes:
            console.print(f"- {note}", highlight=False)
    console.print(f"wrote {out}/claims.md, and a page with pictures for each system beside it")


def _table(claims: list[Claim]) -> str:
    return markdown(HEADS, [list(claim) for claim in claims], WORDS)


def _all_claims(out: Path) -> str:
    """The claims of every page in the folder, each page's first table, as one."""
    pages = [path.read_text(encoding="utf-8") for path in sorted(out.glob("[A-E].md"))]
    tables = [page.split("\n\n")[1].splitlines() for page in pages]
    return "\n".join([*tables[0][:2], *(line for table in tables for line in table[2:])]) + "\n"


def _page(system: str, outcome: Outcome, seeds: int, seconds: float) -> str:
    parts = [f"# {system}: {SYSTEMS[system]}", _table(outcome.claims)]
    parts += [f"## {title}\n\n{markdown(sheet.heads, sheet.rows)}" for title, sheet in outcome.tables.items()]
    searched = search_rows(system)
    if searched.rows:
        parts.append(f"## Tunings\n\n{markdown(searched.heads, searched.rows)}")
    parts.append("## Chosen where the print is silent\n\n" + "\n".join(f"- {note}" for note in outcome.notes))
    parts.append(f"`python benchmarks/papers.py {system} --seeds {seeds}`, {seconds:.0f} s")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    typer.run(main)
