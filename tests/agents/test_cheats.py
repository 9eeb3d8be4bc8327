"""The reward is not to be had cheaply: who stops, spins, does nothing or will not brake loses to esc."""

from functools import cache

import numpy as np
import pytest

from vse_gym.env import StabilityControlEnv


def brakes(*shares):
    def act(info):
        return np.array(shares, dtype=np.float32)

    return act


def turns_on(info):
    """Brakes the side to which the car turns already."""
    left = info["truth"]["yaw_rate"] >= 0
    return np.array([left, not left, left, not left], dtype=np.float32)


CHEATS = {
    "does nothing": brakes(0, 0, 0, 0),
    "brakes to a standstill": brakes(1, 1, 1, 1),
    "drags its brakes": brakes(0.5, 0.5, 0.5, 0.5),
    "brakes one side": brakes(1, 0, 1, 0),
    "brakes behind": brakes(0, 0, 1, 1),
    "will not brake": brakes(-1, -1, -1, -1),
    "spins": turns_on,
}
# Drives in which esc has work to do, on dry road and ice, with a driver who brakes and with one who does not
DRIVES = [
    ("sine_with_dwell", 0.25),
    ("sine_with_dwell", 0.5),
    ("sine_with_dwell", 0.9),
    ("double_lane_change", 0.25),
    ("double_lane_change", 0.5),
    ("held_steer", 0.25),
    ("brake_in_turn", 0.9),
    ("friction_jump", 0.5),
    ("split_friction_braking", 0.5),
    ("split_friction_braking", 0.9),
]


def drive(manoeuvre, friction, controller, act):
    env = StabilityControlEnv(manoeuvre, "truth", controller=controller, friction=friction)
    _, info = env.reset(seed=0)
    total, over = 0.0, False
    while not over:
        _, reward, terminated, truncated, info = env.step(act(info))
        total, over = total + reward, terminated or truncated
    return total, info


@cache
def of_esc(manoeuvre, friction):
    return drive(manoeuvre, friction, "esc", CHEATS["does nothing"])[0]


@pytest.mark.parametrize(("manoeuvre", "friction"), DRIVES)
@pytest.mark.parametrize("cheat", CHEATS)
def test_a_cheat_loses_to_esc(cheat, manoeuvre, friction):
    assert drive(manoeuvre, friction, "none", CHEATS[cheat])[0] < of_esc(manoeuvre, friction)


def test_the_cheats_do_what_they_say():
    _, stopped = drive("sine_with_dwell", 0.9, "none", CHEATS["brakes to a standstill"])
    assert stopped["truth"]["vx"] < 1.0
    _, spun = drive("sine_with_dwell", 0.5, "none", CHEATS["spins"])
    assert spun["ended"] == "spin"
    _, rolled = drive("split_friction_braking", 0.5, "none", CHEATS["will not brake"])
    _, braked = drive("split_friction_braking", 0.5, "none", CHEATS["does nothing"])
    assert rolled["truth"]["vx"] > braked["truth"]["vx"] + 5
