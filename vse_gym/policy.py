"""A trained agent as a controller: the net that was exported, without the library that trained it."""

import tomllib
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vse_gym.catalogue import CONTROLLERS
from vse_gym.compiled import compiled, hold
from vse_gym.controllers.allocation import agent_demand, as_torques
from vse_gym.controllers.base import Controller
from vse_gym.controllers.canonical import ACTIONS, canonical, from_canonical, to_canonical
from vse_gym.controllers.network import ACTIVATIONS, SQUASHES, answer, network
from vse_gym.controllers.observation import LAYOUTS, Encoder, heard_at_first, see_motion, see_readings
from vse_gym.models import Nominal
from vse_gym.types import Array, BrakeDemand, Estimate, Reading

WEIGHTS, CARD = "policy.npz", "agent.toml"
FORMAT = 1
ALGORITHMS = ("ppo", "sac", "td3", "recurrent_ppo")
SEEN = tuple(layout for layout in LAYOUTS if layout != "truth")


class PolicyError(ValueError):
    """A folder that holds no agent, or a damaged one; the message says what is wrong and what was expected."""


@dataclass(frozen=True)
class Card:
    """What ``agent.toml`` says of an agent."""

    format: int
    algorithm: str
    observation: str  # layout
    action: str  # kind
    controller: str  # that works underneath, by its name
    activation: str
    squash: str
    sizes: tuple[int, ...]  # widths of the hidden layers, and of the answer
    memory: int  # width of an LSTM in front of them; 0: none
    weights: str  # digest of policy.npz
    trained: Mapping[str, Any] = field(default_factory=dict)  # how, on what, by which command
    evaluation: Mapping[str, Any] = field(default_factory=dict)  # on drives held out of training


class PolicyState(NamedTuple):
    """Constants, and what an agent remembers."""

    constants: Any  # canonical form, net, geometry, and whether it sees readings, answers by a moment; held
    view: Any  # of the observation, held
    memory: Array  # of the observation, (2,)
    heard: Array  # last valid value of each channel, (10,)
    hidden: Array  # of the net, (2 h,)
    base: Any  # of the controller underneath


@compiled
def policy_step(constants, view, memory, heard, hidden, motion, spread, y, steer, base_added, base_release):
    """One step of an agent: what it adds to the demand of the controller underneath, and its memories after.

    Args:
        constants: (Canonical, Network, geometry, whether it sees readings, whether it answers by a moment), held.
        view: The View of the observation, held.
        memory, heard, hidden: As in :class:`PolicyState`.
        motion: Estimated vx, vy, yaw rate, ax, ay, (5,).
        spread: Variances of the first three, (3,).
        y: The reading, (10,), NaN where silent.
        steer: Road-wheel angle [rad].
        base_added, base_release: Of the controller underneath, (4,) each.

    Returns:
        added, release, and memory, heard, hidden after.
    """
    form, net, geometry, by_reading, by_moment = constants.value
    now = np.where(np.isnan(y), heard, y)
    if by_reading:
        observation, after = see_readings(view, memory, now, y, steer)
    else:
        observation, after = see_motion(view, memory, motion, spread, steer)
    seen, side, counts = to_canonical(form, observation)
    out, kept = answer(net, seen, hidden)
    action = from_canonical(form, out.astype(np.float32), side, counts).astype(np.float64)
    added, release = agent_demand(geometry, base_added, base_release, action, by_moment, motion[0], motion[2], steer)
    return added, release, after, now, kept


@dataclass(frozen=True)
class TrainedPolicy(Controller):
    """An agent that was trained in the loop, as ``agents/train.py`` exports it; it answers without exploring.

    Reads ``policy.npz`` (weights) and ``agent.toml`` of a folder, and runs no code that it finds there. What it sees
    and how it acts is what :class:`vse_gym.StabilityControlEnv` made of the same estimates and readings in training.

    Raises:
        PolicyError: If there is no such folder, or what is in it is no agent, or a damaged one.
    """

    path: str
    digest: str = ""  # of the weights; empty: those that are there, else they must be these

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", str(self.path))
        object.__setattr__(self, "digest", self._read()[0].weights)

    @property
    def card(self) -> Card:
        """What is known of the agent.

        Raises:
            PolicyError: If the folder holds another one by now.
        """
        return self._read()[0]

    def _read(self) -> tuple[Card, Any]:
        card, net = _loaded(self.path, *_stamps(self.path))
        if self.digest and self.digest != card.weights:
            raise PolicyError(f"{self.path}: its weights are {card.weights}, not {self.digest}")
        return card, net

    def init(self, nominal: Nominal) -> PolicyState:
        card, net = self._read()
        form = canonical(card.observation, card.action)
        geometry = nominal.vehicle.geometry
        constants = hold((form, net, geometry, card.observation == "reading", card.action == "yaw_moment"))
        underneath: Controller = CONTROLLERS.make(card.controller)
        memories = (np.zeros(2), heard_at_first(nominal), np.zeros(2 * card.memory))
        return PolicyState(
            constants, Encoder(card.observation).view(nominal), *memories, (underneath, underneath.init(nominal))
        )

    def act(self, state: PolicyState, estimate: Estimate, reading: Reading) -> tuple[BrakeDemand, PolicyState]:
        constants, view, memory, heard, hidden, (underneath, base) = state
        asked, base = underneath.act(base, estimate, reading)
        known = (np.array(estimate[:5]), estimate.cov.diagonal().copy(), reading.y, reading.steer)
        demand = as_torques(asked.added, asked.release)
        added, release, memory, heard, hidden = policy_step(constants, view, memory, heard, hidden, *known, *demand)
        return BrakeDemand(added, release), PolicyState(constants, view, memory, heard, hidden, (underneath, base))


# -- the files --------------------------------------------------------------------------------------------------------


def digest(content: bytes) -> str:
    """Of a file of weights."""
    return blake2b(content, digest_size=8).hexdigest()


def _stamps(path: str) -> tuple[int, ...]:
    """When the files changed: who loads a folder again that was written anew gets the new agent."""
    times = []
    for name in (CARD, WEIGHTS):
        file = Path(path) / name
        if not file.is_file():
            raise PolicyError(f"{path} is no agent: it lacks {name}")
        times.append(file.stat().st_mtime_ns)
    return tuple(times)


@lru_cache(maxsize=16)
def _loaded(path: str, *stamps: int) -> tuple[Card, Any]:
    """Card and Network of a folder."""
    try:
        content = (Path(path) / WEIGHTS).read_bytes()
        card = _card((Path(path) / CARD).read_text(encoding="utf-8"))
        if digest(content) != card.weights:
            raise ValueError(f"{WEIGHTS} is not the file that {CARD} was written for: the digests differ")
        with np.load(Path(path) / WEIGHTS, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        inputs = len(LAYOUTS[card.observation])
        return card, network(arrays, inputs, card.sizes, card.memory, card.activation, card.squash)
    except (ValueError, TypeError, KeyError, OSError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise PolicyError(f"{path} is no agent that can be loaded: {error}") from None


def _card(text: str) -> Card:
    table = tomllib.loads(text)
    known = {f.name: f.type for f in fields(Card)}
    if wrong := table.keys() - known.keys():
        raise ValueError(f"{CARD} has no key {', '.join(sorted(wrong))}; known: {', '.join(known)}")
    lacking = known.keys() - table.keys() - {"trained", "evaluation"}
    if lacking:
        raise ValueError(f"{CARD} lacks {', '.join(name for name in known if name in lacking)}")
    if table["format"] != FORMAT:
        raise ValueError(f"{CARD} is of format {table['format']!r}, known is {FORMAT}")
    for name, choices in (
        ("algorithm", ALGORITHMS),
        ("observation", SEEN),
        ("action", tuple(ACTIONS)),
        ("controller", tuple(CONTROLLERS)),
        ("activation", ACTIVATIONS),
        ("squash", SQUASHES),
    ):
        if table[name] not in choices:
            hint = ": no controller sees the truth" if table[name] == "truth" else ""
            raise ValueError(f"{name} must be one of {', '.join(choices)}, not {table[name]!r}{hint}")
    widths = [*table["sizes"], table["memory"]] if isinstance(table["sizes"], list) else [-1]
    if not all(isinstance(w, int) and 0 <= w <= 4096 for w in widths) or not table["sizes"] or 0 in table["sizes"]:
        raise ValueError(f"sizes and memory must be widths of layers, not {table['sizes']!r} and {table['memory']!r}")
    if table["sizes"][-1] != ACTIONS[table["action"]]:
        raise ValueError(
            f"a {table['action']} agent answers with {ACTIONS[table['action']]} numbers, not {table['sizes'][-1]}"
        )
    return Card(**{**table, "sizes": tuple(table["sizes"])})
