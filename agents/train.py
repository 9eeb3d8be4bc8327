"""Train an agent in the loop, and export it so that it runs without the library that trained it.

    python agents/train.py ppo --env vse_gym/DoubleLaneChange-v0 --estimator ukf --seed 0
    python agents/train.py sac --env vse_gym/SineWithDwell-v0 --env vse_gym/DoubleLaneChange-v0 --controller esc \
        --estimator random --steps 400000 --out results/agents/mine

The folder gets policy.npz and agent.toml (the agent), curve.csv, curve.png, TensorBoard's events, model.zip (for
stable-baselines3), and checkpoint.pt, from which --resume goes on. An option that draws (--estimator, --sensors,
--vehicle, --env) may be given several times.
"""

import csv
import json
import shlex
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import torch
import typer
from curve import draw_curve
from environments import SOME, Task
from export import toml, write_agent
from rich.markup import escape
from segments import CHECKPOINT, Judge, Point, Run
from settings import read
from stable_baselines3.common.logger import configure

from vse_gym.cli_screen import bars, screen, sentences
from vse_gym.evaluation.provenance import commit, machine, package_version
from vse_gym.policy import CARD, WEIGHTS, TrainedPolicy

ASKED = "run.json"
WRITTEN = (CHECKPOINT, ASKED, WEIGHTS, CARD, "curve.csv", "curve.png", "model.zip")
DEFAULT = Task()
LIBRARIES = ("stable-baselines3", "sb3-contrib", "torch", "numpy", "numba", "gymnasium")


def main(
    algorithm: Annotated[str, typer.Argument(help="ppo, sac, td3 or recurrent_ppo.")],
    env: Annotated[list[str], typer.Option(help="Id of an environment.")] = DEFAULT.env,
    estimator: Annotated[
        list[str], typer.Option(help=f"What the agent sees the car through; random: drawn from {', '.join(SOME)}.")
    ] = DEFAULT.estimator,
    controller: Annotated[str, typer.Option(help="That the agent's action is added to.")] = DEFAULT.controller,
    action: Annotated[str, typer.Option(help="brakes or yaw_moment.")] = DEFAULT.action,
    observation: Annotated[str, typer.Option(help="estimate or reading; truth trains, but is no controller.")] = (
        DEFAULT.observation
    ),
    sensors: Annotated[list[str], typer.Option(help="Suite.")] = DEFAULT.sensors,
    vehicle: Annotated[list[str], typer.Option(help="Car.")] = DEFAULT.vehicle,
    friction: Annotated[tuple[float, float], typer.Option(help="From, to.")] = DEFAULT.friction,
    speed: Annotated[tuple[float, float], typer.Option(help="From, to, in km/h.")] = DEFAULT.speed_kmh,
    steer: Annotated[float, typer.Option(help="+/- of the hand wheel's amplitude, relative.")] = DEFAULT.steer,
    mass: Annotated[tuple[float, float], typer.Option(help="Times, from, to.")] = DEFAULT.mass,
    stiffness: Annotated[tuple[float, float], typer.Option(help="Of the tyres, times, from, to.")] = DEFAULT.stiffness,
    seed: Annotated[int, typer.Option(min=0, help="Of everything.")] = 0,
    steps: Annotated[int | None, typer.Option(min=1, help="Without it as in the settings.")] = None,
    settings: Annotated[Path | None, typer.Option(help="TOML; without it agents/settings/ALGORITHM.toml.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder; without it results/agents/NAME.")] = None,
    threads: Annotated[int, typer.Option(min=1, help="Of torch; another number may end elsewhere.")] = 1,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what is in the folder.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Begin anew in a folder that has a run.")] = False,
) -> None:
    """Train an agent; Ctrl-C stops, and the same command with --resume goes on and ends where it would have."""
    with sentences(RuntimeError):
        chosen = read(algorithm, settings)
        drawn = SOME if tuple(estimator) == ("random",) else tuple(estimator)
        ranges = {"friction": friction, "speed_kmh": speed, "steer": steer, "mass": mass, "stiffness": stiffness}
        names = {"env": tuple(env), "sensors": tuple(sensors), "vehicle": tuple(vehicle)}
        view = {"observation": observation, "action": action, "controller": controller}
        task = Task(estimator=drawn, **names, **view, **ranges)
        folder = out or Path("results/agents") / f"{algorithm}-{env[0].partition('/')[2]}-{estimator[0]}-{seed}"
        count = steps or chosen["n_timesteps"]
        asked = {"algorithm": algorithm, "task": task.table, "settings": chosen, "seed": seed, "steps": count}
        torch.set_num_threads(threads)
        run = Run(algorithm, task, chosen, seed, count)  # which refuses what cannot be, before anything is written
        prepare(folder, asked | {"threads": threads}, resume, overwrite)
        train(folder, run, resume)


def prepare(folder: Path, asked: dict[str, Any], resume: bool, overwrite: bool) -> None:
    """A folder for the run.

    Raises:
        FileExistsError: If it has a run and neither option is given.
        ValueError: If it has another run than the one to be resumed.
    """
    card = folder / ASKED
    text = json.dumps(asked, indent=1)
    if card.exists() and resume:
        if card.read_text(encoding="utf-8") != text:
            raise ValueError(f"{folder} holds another run, see {card}: give its options, or another --out")
        return
    if card.exists() and not overwrite:
        raise FileExistsError(f"{folder} holds a run: --resume goes on with it, --overwrite begins anew")
    for path in folder.glob("*"):
        if path.name in WRITTEN or path.name.startswith("events."):
            path.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    card.write_text(text, encoding="utf-8")


def train(folder: Path, run: Run, resume: bool) -> None:
    """Train, and write what has come of it."""
    if resume and (folder / CHECKPOINT).exists():
        run.load(folder / CHECKPOINT)
    run.model.set_logger(configure(str(folder), ["tensorboard"]))
    with bars() as progress:
        total = run.segment_steps * run.segments
        bar = progress.add_task(escape(folder.name), total=total, completed=run.model.num_timesteps)
        try:
            run.go_on(lambda steps: progress.update(bar, completed=steps), folder)
        except KeyboardInterrupt:
            screen.print(
                f"stopped after {len(run.curve)} of {run.segments} segments: --resume goes on", highlight=False
            )
            raise
    finish(folder, run)


def finish(folder: Path, run: Run) -> None:
    """Write the agent that drove best on held-out drives, its card, its curve and the model as it is at the end."""
    with (folder / "curve.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerows([Point._fields, *([f"{value:.6g}" for value in point] for point in run.curve)])
    idle, _ = run.judge.drive(None)
    nobody, _ = Judge(Task(**{**vars(run.task), "controller": "none"}), run.drives).drive(None)
    best = max(run.curve, key=lambda point: point.held_out)
    evaluation = {
        "drives": run.drives,
        "mean_return": round(best.held_out, 2),
        "ended_early_percent": round(100 * best.ended_early, 1),
        "controller_alone": round(float(idle.mean()), 2),
        "nobody": round(float(nobody.mean()), 2),
    }
    draw_curve(folder / "curve.png", run.curve, evaluation, folder.name)
    run.model.save(folder / "model.zip")
    run.model.policy.load_state_dict(run.best)
    view = {name: getattr(run.task, name) for name in ("observation", "action", "controller")}
    trained = {
        "command": shlex.join(["python", "agents/train.py", *sys.argv[1:]]),
        "seed": run.seed,
        "steps": run.model.num_timesteps,
        "best_after": best.steps,
        "seconds": round(run.seconds),
        "commit": commit(),
        "machine": machine(),
        "versions": {"vse-gym": package_version()} | {name: version(name) for name in LIBRARIES},
        "task": run.task.table,
        "settings": dict(run.settings),
    }
    if run.task.observation != "truth":  # which no controller sees
        write_agent(folder, run.algorithm, run.model, view, trained, evaluation)
        TrainedPolicy(str(folder))
    screen.print(toml(evaluation), highlight=False)
    screen.print(f"written: {escape(str(folder))}", highlight=False)


app = typer.Typer(add_completion=False)
app.command()(main)

if __name__ == "__main__":
    app()
