"""Training in segments, so that a run that was interrupted ends where an unbroken one would, to the bit.

Each segment begins with new drives, and with generators seeded by (seed of the run, number of the segment). So all that
one segment hands to the next is what has been learned: parameters, the optimisers' moments, and the replay buffer. That
is written down after each, and a run that is gone on with repeats at most the segment in which it was stopped.
"""

import io
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from environments import Task, held_out, make_envs
from settings import RATES, VIEW, make, rate
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import FloatSchedule, set_random_seed
from stable_baselines3.common.vec_env import VecEnv

from vse_gym.evaluation.files import write_whole
from vse_gym.sensors import stream

CHECKPOINT = "checkpoint.pt"
DRIVES, FIRST_HELD_OUT = 32, 7_000_000  # of each evaluation, and their first seed: of no table and no tuning
FROM, TO = 2**30, 2**31  # between which each row's first seed lies
BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")

Progress = Callable[[int], None]


def quiet(steps: int) -> None:
    """Progress that nobody wants to see."""


class Point(NamedTuple):
    """One point of a learning curve."""

    steps: int
    training: float  # mean return of the segment's last hundred drives, which explored; NaN: none is over yet
    held_out: float  # mean return of drives that did not, on held-out cars, sensors and seeds
    low: float  # of the drives' returns: the tenth of a hundred
    ended_early: float  # share of these drives


@dataclass
class Run:
    """One agent in the making.

    Args:
        algorithm: One of settings.ALGORITHMS.
        task: What it drives.
        settings: As :func:`settings.read` has them.
        seed: Of everything.
        steps: At least so many; a segment ends with a rollout.
        drives: Of each evaluation.
    """

    algorithm: str
    task: Task
    settings: Mapping[str, Any]
    seed: int
    steps: int
    drives: int = DRIVES  # of an evaluation
    segment: int = 0  # that comes next
    seconds: float = 0.0  # that whole segments have taken
    curve: list[Point] = field(default_factory=list)
    best: dict[str, Any] = field(default_factory=dict)  # parameters of the policy that drove best on held-out drives

    def __post_init__(self) -> None:
        kinds, rows = len(self.task.env) * len(self.task.vehicle), self.settings["n_envs"]
        if kinds > rows:
            raise ValueError(f"{kinds} pairs of a manoeuvre and a car do not fit into {rows} rows: raise n_envs")
        view = {name: self.settings[name] for name in VIEW if name in self.settings}
        self.env = make_envs(self.task, rows, **view)
        self.model: Any = make(self.algorithm, self.settings, self.env, self.seed)
        self.judge = Judge(self.task, self.drives)

    @property
    def segments(self) -> int:
        """How many there are."""
        return int(self.settings["segments"])

    @property
    def segment_steps(self) -> int:
        """Steps of each, as the net counts them: whole rollouts."""
        model = self.model
        of_each = model.train_freq.frequency if isinstance(model, OffPolicyAlgorithm) else model.n_steps
        rollout = of_each * self.env.num_envs
        return int(np.ceil(self.steps / self.segments / rollout)) * int(rollout)

    def go_on(self, progress: Progress = quiet, folder: Path | None = None) -> None:
        """Train until the end; after each segment a checkpoint is written into the folder, if there is one."""
        while self.segment < self.segments:
            begin = time.monotonic()
            self._begin()
            told = Told(progress)
            self.model.learn(self.segment_steps, callback=told, reset_num_timesteps=False, log_interval=None)
            self.segment += 1
            self._evaluate()
            self.seconds += time.monotonic() - begin
            if folder is not None:
                self.save(folder / CHECKPOINT)

    def _begin(self) -> None:
        model, seed = self.model, int(stream(self.seed, f"segment/{self.segment}").integers(FROM, TO))
        set_random_seed(seed)
        model.action_space.seed(seed)
        self.env.seed(seed)
        model._last_obs = None  # new drives
        if isinstance(model, OffPolicyAlgorithm) and model.num_timesteps:
            _close_drives(model.replay_buffer)
        model.ep_info_buffer = None  # and their returns
        if self.algorithm == "recurrent_ppo":
            for state in (*model._last_lstm_states.pi, *model._last_lstm_states.vf):
                state.zero_()
        done = self.segment / self.segments
        for name in RATES:
            if name in self.settings:
                place = {"learning_rate": "lr_schedule"}.get(name, name)
                setattr(model, place, FloatSchedule(rate(self.settings[name], done)))

    def _evaluate(self) -> None:
        returns, early = self.judge.drive(self.model)
        recent = [episode["r"] for episode in self.model.ep_info_buffer]
        figures = (float(returns.mean()), float(np.quantile(returns, 0.1)), float(early.mean()))
        point = Point(self.model.num_timesteps, float(np.mean(recent)) if recent else float("nan"), *figures)
        if all(point.held_out > earlier.held_out for earlier in self.curve):
            self.best = {name: value.clone() for name, value in self.model.policy.state_dict().items()}
        self.curve.append(point)
        for name in Point._fields[1:]:
            self.model.logger.record(f"evaluation/{name}", getattr(point, name))
        self.model.logger.dump(point.steps)

    def save(self, path: Path) -> None:
        """Write down what the next segment needs."""
        model = self.model
        _, variables = model._get_torch_save_params()
        state = {
            "segment": self.segment,
            "seconds": self.seconds,
            "num_timesteps": model.num_timesteps,
            "n_updates": model._n_updates,
            "parameters": model.get_parameters(),
            "variables": {name: getattr(model, name).detach() for name in variables},
            "buffer": _buffer_of(model),
            "curve": [list(point) for point in self.curve],
            "best": self.best,
        }
        content = io.BytesIO()
        torch.save(state, content)
        write_whole(path, content.getvalue())

    def load(self, path: Path) -> None:
        """Go on from what was written down; nothing in the file is run."""
        state = torch.load(path, weights_only=True)
        model = self.model
        model.set_parameters(state["parameters"])
        for name, value in state["variables"].items():
            getattr(model, name).data.copy_(value)
        model.num_timesteps, model._n_updates = state["num_timesteps"], state["n_updates"]
        if state["buffer"]:
            _fill(model, state["buffer"])
        self.segment, self.seconds, self.best = state["segment"], state["seconds"], state["best"]
        self.curve = [Point(*point) for point in state["curve"]]


def _close_drives(buffer: Any) -> None:
    """Drives that the last segment broke off end there: returns of several steps would run on into others."""
    last = buffer.pos - 1
    buffer.timeouts[last] = np.maximum(buffer.timeouts[last], 1 - buffer.dones[last])


def _buffer_of(model: Any) -> dict[str, Any]:
    if not isinstance(model, OffPolicyAlgorithm):
        return {}
    buffer: Any = model.replay_buffer
    used = buffer.buffer_size if buffer.full else buffer.pos
    kept = {name: torch.from_numpy(getattr(buffer, name)[:used]) for name in BUFFER}
    return kept | {"pos": buffer.pos, "full": buffer.full}


def _fill(model: Any, kept: Mapping[str, Any]) -> None:
    buffer = model.replay_buffer
    buffer.pos, buffer.full = kept["pos"], kept["full"]
    for name in BUFFER:
        values = kept[name].numpy()
        getattr(buffer, name)[: len(values)] = values


class Told(BaseCallback):
    """Says how far it is."""

    def __init__(self, progress: Progress):
        super().__init__()
        self._progress = progress

    def _on_step(self) -> bool:
        self._progress(self.num_timesteps)
        return True


class Judge:
    """Drives on held-out cars, sensors and seeds, without exploring: the same for every agent of a task."""

    def __init__(self, task: Task, drives: int):
        self.env: VecEnv = make_envs(held_out(task), drives)

    def drive(self, model: BaseAlgorithm | None) -> tuple[np.ndarray, np.ndarray]:
        """Returns of all drives, and which ended early; without a model the agent answers nothing."""
        self.env.seed(FIRST_HELD_OUT)
        seen, rows = self.env.reset(), self.env.num_envs
        returns, early, waiting = np.zeros(rows), np.zeros(rows, dtype=bool), np.ones(rows, dtype=bool)
        answers = np.zeros((rows, *(self.env.action_space.shape or ())), np.float32)
        state, begins = None, np.ones(rows, dtype=bool)
        while waiting.any():
            if model is not None:
                answers, state = model.predict(seen, state, begins, deterministic=True)
            seen, _, begins, infos = self.env.step(answers)
            for row in np.flatnonzero(begins & waiting):
                returns[row] = infos[row]["episode"]["r"]
                early[row] = not infos[row]["TimeLimit.truncated"]
                waiting[row] = False
        return returns, early
