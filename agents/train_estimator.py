"""Train a learned estimator, `gru` or `kalman_gru`, on simulated drives of randomised cars; needs torch (extra [rl]).

    python agents/train_estimator.py gru --seed 0 --jobs 2
    python agents/train_estimator.py kalman_gru --seed 0 --jobs 2

Writes NAME.npz, the weights, and NAME.toml, which says where they come from. They are used as
ESTIMATORS.make("gru", weights="results/estimators/gru.npz"), and shipped by a copy of both files to
vse_gym/estimators/trained. The drives are kept on disk, for both. Ctrl-C does no harm: the same command goes on after
the last whole epoch and ends where an unbroken run would.
"""

import json
import platform
import shlex
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from estimator_drives import FIRST, HEADLINE, MOST, RANGES, Drive, cars, drawn
from estimator_records import CHUNK, drives
from estimator_scores import Scores, score, table
from estimator_training import Parity, Recording, Training, exported, outputs_of, train
from rich.console import Console
from rich.progress import track

from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.estimators.learned import CorrectedKalmanFilter, LearnedEstimator, RecurrentEstimator
from vse_gym.estimators.learned_features import LIMIT, MOTION, OUTPUTS, hear_drive
from vse_gym.estimators.learned_weights import save_weights
from vse_gym.inference.gaussian import filter_drive

KINDS: dict[str, type[LearnedEstimator]] = {"gru": RecurrentEstimator, "kalman_gru": CorrectedKalmanFilter}
SETTINGS = Training()
FARTHEST = 20.0  # units that the plain motion may be off in training: 10 m/s, 45 deg, 57 deg/s, 10 m/s2


def parity(kind: type[LearnedEstimator]) -> Parity:
    """What changes its sign in a mirror."""
    return Parity(np.array(list(kind.features.values())), np.array(list(OUTPUTS.values())))


class Heard:
    """Drives as an estimator's front end hears them."""

    def __init__(self, kind: type[LearnedEstimator], recorded: list[Drive], what: str):
        self.truth = [drive.truth for drive in recorded]
        self.recordings, self.plain, self.units = [], [], []
        for drive in track(recorded, description=f"hearing {what}"):
            front, values = kind.front(drawn(drive.number).scenario.nominal)
            x, motion, units = hear_drive(front, values, drive.inputs.astype(float), drive.readings.astype(float))
            target = np.clip((drive.truth - motion) / units, -FARTHEST, FARTHEST)
            self.recordings.append(Recording(x.astype(np.float32), target.astype(np.float32)))
            self.plain.append(motion.astype(np.float32))
            self.units.append(units.astype(np.float32))

    def scores(self, net: Any, sides: Parity) -> Scores:
        """Of a net on these drives."""
        m = len(MOTION)
        said = outputs_of(net, self.recordings, sides)
        told = [p + u * s[:, :m] for p, u, s in zip(self.plain, self.units, said, strict=True)]
        return score(self.truth, told, [u * np.exp(s[:, m:]) for u, s in zip(self.units, said, strict=True)])


def filtered(recorded: list[Drive]) -> Scores:
    """The scores of `ekf`, default settings."""
    means, deviations = [], []
    for drive in recorded:
        state = ExtendedKalmanFilter().init(drawn(drive.number).scenario.nominal, np.random.default_rng(0))
        rule, model = state.constants.value
        heard = drive.inputs.astype(float), drive.readings.astype(float)
        mean, cov = filter_drive(rule, model, state.mean, state.cov, model.memory, *heard)
        means.append(mean)
        deviations.append(np.sqrt(cov.diagonal(axis1=1, axis2=2)))
    return score([drive.truth for drive in recorded], means, deviations)


def _toml(table: Mapping[str, Any]) -> str:
    """A table of plain values and of such tables."""
    lines = [f"{name} = {json.dumps(value)}" for name, value in table.items() if not isinstance(value, Mapping)]
    for name, inner in ((n, v) for n, v in table.items() if isinstance(v, Mapping)):
        lines += ["", f"[{name}]", *(f"{key} = {json.dumps(value)}" for key, value in inner.items())]
    return "\n".join(lines) + "\n"


def _rounded(scores: Scores) -> dict[str, float]:
    return {name: round(value, 4) for name, value in scores._asdict().items() if value == value}


def main(
    name: Annotated[str, typer.Argument(help=f"Which: {' or '.join(KINDS)}.")],
    seed: Annotated[int, typer.Option(min=0, max=7, help="Of the drives, the first weights and the order.")] = 0,
    count: Annotated[int, typer.Option("--drives", min=CHUNK, help="To learn from; rounded up to fifties.")] = 3000,
    held: Annotated[int, typer.Option("--validation", min=CHUNK, help="Drives to choose the epoch by.")] = 400,
    epochs: Annotated[int, typer.Option(min=1)] = SETTINGS.epochs,
    hidden: Annotated[int, typer.Option(min=1, help="Units.")] = SETTINGS.hidden,
    out: Annotated[Path, typer.Option(help="Where weights and checkpoints go.")] = Path("results/estimators"),
    data: Annotated[Path, typer.Option(help="Where drives are kept.")] = Path("results/training_drives"),
    jobs: Annotated[int, typer.Option(help="Processes that drive.")] = 1,
) -> None:
    """Drive, train, print the scores beside the EKF's, write the weights."""
    if name not in KINDS:
        raise typer.BadParameter(f"no learned estimator named {name!r}; known: {', '.join(KINDS)}")
    count, held = (CHUNK * -(-n // CHUNK) for n in (count, held))
    if count + held > MOST:
        raise typer.BadParameter(f"one seed has {MOST} drives, not {count} and {held}")
    kind, console, began = KINDS[name], Console(), time.perf_counter()
    out.mkdir(parents=True, exist_ok=True)
    first = seed * MOST
    try:
        learnt = Heard(kind, drives(first, count, data, jobs), "what is learnt from")
        kept_back = drives(first + MOST - held, held, data, jobs)
        validation, ekf = Heard(kind, kept_back, "what is held back"), filtered(kept_back)
        ready = time.perf_counter()
        sides, settings = parity(kind), Training(seed=seed, epochs=epochs, hidden=hidden)

        def tell(epoch: int, loss: float, held_back: float, net: Any) -> None:
            now = validation.scores(net, sides)
            spent = time.perf_counter() - ready
            told = f"sideslip {now.sideslip_rmse_deg:.2f} deg (ekf {ekf.sideslip_rmse_deg:.2f})"
            console.print(
                f"epoch {epoch + 1}/{epochs}: loss {loss:.3f}, validation {held_back:.3f}, {told}, {spent:.0f} s"
            )

        checkpoint = out / f"{name}.checkpoint"
        net, history, chosen = train(learnt.recordings, validation.recordings, sides, settings, checkpoint, tell)
    except KeyboardInterrupt:
        console.print("Interrupted: the same command goes on from here.")
        raise typer.Exit(130) from None
    scores = validation.scores(net, sides)
    console.print(table({name: scores, "ekf": ekf}, f"{len(validation.truth)} drives held back"))
    digest = save_weights(out / f"{name}.npz", name, exported(net), kind.features, OUTPUTS)
    told = {
        "estimator": name,
        "digest": digest,
        "command": shlex.join(["python", *sys.argv]),
        "held_out": f"all cars of {HEADLINE}, so each of its cells; seeds below {FIRST} and from {FIRST + 9 * MOST} on",
        "architecture": {
            "net": "one gated recurrent layer and a dense one, on the drive and on its mirror image",
            "hidden": hidden,
            "features": list(kind.features),
            "outputs": list(OUTPUTS),
            "normalisation": f"fixed units, see vse_gym.estimators.learned_features; features within {LIMIT}",
        },
        "training": asdict(settings)
        | {
            "drives": len(learnt.truth),
            "instants": sum(map(len, learnt.truth)),
            "loss": "heteroscedastic Gaussian likelihood of vx, vy, yaw rate, ax, ay",
            "best_epoch": chosen + 1,
            "losses": [[round(x, 4) for x in pair] for pair in history],
        },
        "ranges": {"cars": cars()} | {key: list(pair) for key, pair in RANGES.items()},
        "validation": {"drives": len(validation.truth)} | _rounded(scores),
        "validation_of_ekf": _rounded(ekf),
        "versions": {"python": platform.python_version()}
        | {lib: version(lib) for lib in ("torch", "numpy", "numba", "vse-gym")},
    }
    (out / f"{name}.toml").write_text(_toml(told), encoding="utf-8")
    console.print(f"written: {out / name}.npz and .toml, {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    typer.run(main)
