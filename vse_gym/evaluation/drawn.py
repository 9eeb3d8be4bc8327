"""A cell at a seed, and the drive with true states that all others of that seed are compared with."""

from typing import NamedTuple

from vse_gym.evaluation.cells import Cell
from vse_gym.evaluation.study import Study
from vse_gym.scenarios import Scenario
from vse_gym.simulation import rollout
from vse_gym.types import Log

MOST_REPLACED = 20  # a cell whose truth drive ends badly this often in a row is no cell
APART = 1_000_000  # from a seed to the one that takes its place


class Drawn(NamedTuple):
    """What is driven."""

    cell: Cell
    scenario: Scenario
    seed: int  # of draw and noise: the one asked for, or what took its place
    replaced: int  # how many seeds were given up for it
    truth: Log


def draw(study: Study, cell: Cell, seed: int) -> Drawn:
    """A cell at a seed; one whose truth drive ends badly is replaced, and that is counted.

    Raises:
        ValueError: If the truth drive ends badly at every seed.
    """
    for replaced in range(MOST_REPLACED):
        used = seed + APART * replaced
        scenario = cell.scenario(study.randomise, used)
        truth = rollout(scenario, "truth", cell.controller, used)
        if not truth.ended:
            return Drawn(cell, scenario, used, replaced, truth)
    why = f"with true states {cell.controller} ends badly ({truth.ended}) at every seed"
    raise ValueError(f"cell {cell.name!r}: {why}")
