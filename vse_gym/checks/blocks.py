"""What estimators, controllers and manoeuvres promise alike."""

import copy
import pickle
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from vse_gym.models import Nominal
from vse_gym.probing import Block, Owner, contents, differences, global_generators, mirror, require, who


def check_edits_nothing(owner: Owner, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """Every earlier state, the readings, the estimates and ``nominal`` stay as they were."""
    block, rng, kept = Block(owner, nominal, heard), np.random.default_rng(0), []
    before = contents(nominal, "nominal") | contents(block.items, "heard")
    state = block.init(rng)
    for k, item in enumerate(block.items):
        kept.append((k, state, contents(state, "state")))
        state, _ = block.step(state, item, rng)
    edited = differences(before, contents(nominal, "nominal") | contents(block.items, "heard"))
    require(not edited, f"{who(owner)} edited what it was given ({edited}): work on a copy.")
    for k, old, facts in kept:
        edited = differences(facts, contents(old, "state"))
        advice = "hand back a new state, with copies of the arrays that change"
        require(not edited, f"{who(owner)} edited an old state, the one before reading {k} ({edited}): {advice}.")


def check_keeps_itself(owner: Owner, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """The instance is the same after use as before, and two drives at once do not disturb each other."""
    block, before = Block(owner, nominal, heard), contents(owner, "self")
    alone = block.drive()
    edited = differences(before, contents(owner, "self"))
    advice = "an instance is a frozen set of tunings; what changes over time travels in the state"
    require(not edited, f"{who(owner)} changed itself in use ({edited}): {advice}.")
    generators, together = [np.random.default_rng(0), np.random.default_rng(1)], []
    states = [block.init(rng) for rng in generators]
    for item, other in zip(block.items, map(mirror, block.items), strict=True):
        states[0], output = block.step(states[0], item, generators[0])
        states[1], _ = block.step(states[1], other, generators[1])
        together.append(output)
    differ = differences(contents(alone, "output"), contents(together, "output"))
    require(not differ, f"{who(owner)} mixes two drives that go on at once ({differ}): {advice}.")


def check_repeats_itself(owner: Owner, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """The same drive and the same seed of ``rng`` give the same bits; global generators are left alone."""
    block = Block(owner, nominal, heard)
    before = global_generators()
    differ = differences(contents(block.drive(), "output"), contents(block.drive(), "output"))
    advice = "draw random numbers from rng alone"
    require(not differ, f"{who(owner)} gave two results for one drive and one seed ({differ}): {advice}.")
    differ = differences(before, global_generators())
    require(not differ, f"{who(owner)} drew from a global generator, or seeded it: {advice}.")


def check_can_be_saved(owner: Owner, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """A state that went through ``pickle`` or ``copy.deepcopy`` goes on bit by bit like the original."""
    block, rng = Block(owner, nominal, heard), np.random.default_rng(0)
    state, half = block.init(rng), len(block.items) // 2
    for item in block.items[:half]:
        state, _ = block.step(state, item, rng)
    for way in (copy.deepcopy, lambda thing: pickle.loads(pickle.dumps(thing))):
        try:
            again = way(state)
        except Exception as error:
            raise AssertionError(
                f"{who(owner)}: its state cannot be copied ({error}): keep plain data in it"
            ) from error
        futures = [block.go_on(s, block.items[half:], copy.deepcopy(rng)) for s in (state, again)]
        differ = differences(*(contents(outputs, "output") for outputs in futures))
        advice = "all that the next step needs must be in the state"
        require(not differ, f"{who(owner)} goes on differently from a copy of its state ({differ}): {advice}.")


def check_is_symmetric(owner: Owner, nominal: Nominal, *heard: Sequence[Any]) -> None:
    """A mirrored drive has the mirrored result. Who draws random numbers is exempt: the draws are not mirrored.

    To 1e-6: the same sums in another order differ by 1e-16, enlarged to 1e-10 by difference quotients and a little
    more by a car near its limit.
    """
    block, rng = Block(owner, nominal, heard), np.random.default_rng(0)
    fresh = contents(rng)
    outputs = block.drive(rng=rng)
    if contents(rng) != fresh:
        return
    advice = "look for a wrong sign, or for a left wheel where the right one is meant"
    for k, (output, other) in enumerate(zip(outputs, block.drive([mirror(i) for i in block.items]), strict=True)):
        for name, wanted, got in zip(output._fields, mirror(output), other, strict=True):
            same = np.allclose(got, wanted, rtol=1e-6, atol=1e-6, equal_nan=True)
            require(
                same, f"{who(owner)}, reading {k}: {name} of the mirrored drive is {got}, expected {wanted}: {advice}."
            )


COMMON_CHECKS: tuple[Callable[..., None], ...] = (
    check_edits_nothing,
    check_keeps_itself,
    check_repeats_itself,
    check_can_be_saved,
)
