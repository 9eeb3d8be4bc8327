"""The agents that come with the project: small, described, sound, and better than nobody."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from vse_gym.evaluation.study import Study
from vse_gym.policy import CARD, WEIGHTS, TrainedPolicy
from vse_gym.simulation import rollout
from vse_gym.testing import conformance

TRAINED = Path(__file__).parents[2] / "agents" / "trained"
NAMES = sorted(path.parent.name for path in TRAINED.glob(f"*/{CARD}"))


def test_there_are_residual_agents_by_two_algorithms_and_one_that_brakes_alone():
    kinds = {(card.algorithm, card.controller) for card in (TrainedPolicy(str(TRAINED / n)).card for n in NAMES)}
    assert {("ppo", "esc"), ("sac", "esc"), ("ppo", "none")} <= kinds


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_agent_is_small_and_says_how_it_was_made(name):
    folder = TRAINED / name
    shipped = {
        path.name: path.stat().st_size for path in folder.iterdir() if path.suffix in (".npz", ".toml", ".csv", ".png")
    }
    assert shipped.keys() == {WEIGHTS, CARD, "curve.csv", "curve.png"}
    assert sum(shipped.values()) < 1_000_000
    card = tomllib.loads((folder / CARD).read_text())
    assert {"command", "seed", "steps", "versions", "task", "settings"} <= card["trained"].keys()
    assert card["trained"]["command"].startswith(f"python agents/train.py {card['algorithm']}")
    assert {"torch", "stable-baselines3", "vse-gym"} <= card["trained"]["versions"].keys()
    assert card["evaluation"]["mean_return"] > card["evaluation"]["nobody"]
    assert "headline" not in str(card["trained"]["task"])


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_agent_keeps_every_promise_of_a_controller(name):
    for finding in conformance(TrainedPolicy(str(TRAINED / name))):
        assert finding.error is None, finding


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_agent_holds_cars_that_it_never_saw_and_that_nobody_holds(name):
    """The headline's two slippery cells that spin a car without control, seeds that its table does not use."""
    study, agent = Study.load("headline-v1"), TrainedPolicy(str(TRAINED / name))
    slid = {"nobody": [], "agent": []}
    for cell in study.cells:
        if cell.name in ("sine with dwell under bias", "lane change under bias"):
            for seed in range(500, 504):
                scenario = cell.scenario(study.randomise, seed)
                for who, controller in (("nobody", "none"), ("agent", agent)):
                    log = rollout(scenario, "ukf", controller, seed)
                    slid[who].append(np.degrees(log.peak_sideslip))
    assert np.mean(slid["agent"]) < 0.6 * np.mean(slid["nobody"])
    assert max(slid["agent"]) < 30
