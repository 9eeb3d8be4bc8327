"""Estimators that find the friction of the road: where it can be felt they do, and where it cannot they say so."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import Gate
from vse_gym.inference.model import advance, attend, observe
from vse_gym.models import Nominal, SingleTrackTuning
from vse_gym.scenarios import scenario
from vse_gym.sensors import FITTED, LOUD
from vse_gym.simulation import rollout
from vse_gym.types import U_STEER, Y_YAW_RATE, Reading
from vse_gym.vehicles import load

FINDERS = ["imm", "ukf_friction"]
finders = pytest.mark.parametrize("name", FINDERS)
TRUST = SingleTrackTuning(vx_noise=0.3, vy_noise=0.1, yaw_noise=0.1, ax_error=0.3, ay_error=0.5)


@pytest.fixture(scope="module")
def nominal():
    return Nominal(load("qin2014_understeer"), LOUD, speed=20.0)


def own_drive(nominal, friction, steer, seconds, seed=0):
    """Readings of the single track itself on a road of that friction, with its own noise."""
    model = TRUST.build(nominal)._replace(friction=friction)
    rng, root = np.random.default_rng(seed), np.linalg.cholesky(model.process_cov)
    x, memory, readings = model.prior_mean, model.memory, []
    for k in range(round(seconds / nominal.dt)):
        u = np.zeros(9)
        u[U_STEER] = steer(k * nominal.dt)
        x = advance(model, x[:, None].copy(), u)[:, 0] + root @ rng.standard_normal(3)
        clean = observe(model, x[:, None].copy(), u)[:, 0]
        clean[FITTED:] = np.nan
        variances, memory = attend(model, memory, u, clean)
        readings.append(Reading(k * nominal.dt, u, rng.normal(clean, np.sqrt(variances))))
    return readings


def said(estimator, nominal, readings):
    """Estimates after each reading."""
    rng, out = np.random.default_rng(0), []
    state = estimator.init(nominal, rng)
    for reading in readings:
        state = estimator.update(state, reading, rng)
        out.append(estimator.estimate(state))
    return out


def straight_on(t):
    return 0.0


def weaving(t):
    return 0.15 * math.sin(4 * t)


@pytest.mark.parametrize("friction", [0.25, 0.5, 0.8])
def test_at_the_limit_the_unscented_filter_converges_to_the_friction_of_the_road(nominal, friction):
    estimator = ESTIMATORS.make("ukf_friction", model=TRUST)
    for seed in range(3):
        estimates = said(estimator, nominal, own_drive(nominal, friction, weaving, 4.0, seed))[200:]
        error = np.array([e.friction for e in estimates]) - friction
        std = np.array([e.friction_std for e in estimates])
        # Four seconds hold few independent errors: half as much again as the filter says is granted.
        assert np.sqrt(np.mean(error**2)) < 1.5 * np.sqrt(np.mean(std**2)) < 0.15


@pytest.mark.parametrize(("friction", "mode"), [(0.3, 1), (0.9, 0)])
def test_the_multiple_model_filter_is_sure_of_the_road_that_it_is_on(nominal, friction, mode):
    estimator = ESTIMATORS.make("imm", model=TRUST)
    rng = np.random.default_rng(0)
    state, sure = estimator.init(nominal, rng), []
    for reading in own_drive(nominal, friction, weaving, 4.0):
        state = estimator.update(state, reading, rng)
        sure.append(state.probabilities[mode])
    assert np.mean(np.array(sure[100:]) > 0.9) > 0.8  # the rest is where the steering passes through zero


def test_on_the_straight_the_unscented_filter_stays_at_what_it_was_told(nominal):
    for told in (0.9, 0.5):
        on = replace(nominal, friction=told)
        for seed in range(3):
            readings = own_drive(on, 0.9, straight_on, 20.0, seed)
            found = said(ESTIMATORS.make("ukf_friction", model=TRUST), on, readings)
            apart = np.array([e.friction for e in found]) - told
            std = np.array([e.friction_std for e in found])
            assert np.abs(apart).max() < std.max() and std.max() < 0.35


def test_on_the_straight_the_multiple_model_filter_returns_to_its_shares(nominal):
    found = said(ESTIMATORS.make("imm", model=TRUST), nominal, own_drive(nominal, 0.9, straight_on, 10.0))
    estimator = ESTIMATORS.make("imm")
    expected = np.dot(estimator.shares, estimator.frictions)
    assert np.abs(np.array([e.friction for e in found]) - expected).max() < 0.1


@pytest.mark.parametrize("friction", [0.45, 0.6, 0.75])
def test_on_a_road_between_its_modes_the_multiple_model_filter_does_not_claim_to_know(nominal, friction):
    # It can only say which mode is nearer. One that is sure of a mode knows the friction no better than the gap
    # between modes: evenly spread within it, 0.6/sqrt(12) = 0.17.
    found = said(ESTIMATORS.make("imm", model=TRUST), nominal, own_drive(nominal, friction, weaving, 4.0))[100:]
    error, std = np.array([e.friction for e in found]) - friction, np.array([e.friction_std for e in found])
    assert np.mean(np.abs(error) < 1.96 * std) > 0.9
    assert std.min() >= 0.6 / math.sqrt(12) and std.max() < 0.36


def test_a_mode_alone_is_known():
    estimator = ESTIMATORS.make("imm", frictions=(0.7,), shares=(1.0,))
    on = Nominal(load("qin2014_understeer"), LOUD, speed=20.0)
    last = said(estimator, on, own_drive(on, 0.7, weaving, 0.1))[-1]
    assert (last.friction, last.friction_std) == (pytest.approx(0.7), pytest.approx(0.0, abs=1e-6))


def test_with_a_friction_that_is_known_the_fourth_state_changes_nothing(nominal):
    # Three states' points lie sqrt(3) deviations out; with kappa = -1 so do four states', and the weights of the two
    # points that have become the centre make up for the centre's.
    readings = own_drive(nominal, 0.9, weaving, 3.0)
    known = {"noise": 0.0, "prior": 0.0, "kappa": -1.0, "gate": Gate()}
    ours = said(ESTIMATORS.make("ukf_friction", model=TRUST, **known), nominal, readings)
    theirs = said(ESTIMATORS.make("ukf", model=TRUST), nominal, readings)
    for mine, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(mine[:5], other[:5], rtol=1e-8, atol=1e-8)  # rounding, over three hundred steps
        np.testing.assert_allclose(mine.cov, other.cov, rtol=1e-7, atol=1e-10)
        assert mine.friction == pytest.approx(0.9, abs=1e-9) and mine.friction_std < 1e-9


def test_a_gyro_that_goes_wild_for_a_moment_is_not_taken_for_a_slippery_road(nominal):
    clean = own_drive(nominal, 0.9, weaving, 3.0)
    wild = own_drive(nominal, 0.9, weaving, 3.0)
    for reading in wild[200:203]:
        reading.y[Y_YAW_RATE] += 2.0
    moved = {}
    for gate in (Gate(0.999), Gate()):
        estimator = ESTIMATORS.make("ukf_friction", gate=gate)
        pair = [np.array([(e.vy, e.friction) for e in said(estimator, nominal, heard)]) for heard in (clean, wild)]
        moved[gate] = np.abs(pair[0] - pair[1]).max(axis=0)
    assert np.all(moved[Gate(0.999)] < 0.2 * moved[Gate()])


@pytest.fixture(scope="module")
def jump():
    """The car itself in a held turn; 1.8 s on, the road turns slippery. Of truth, so that all hear the same."""
    settings = {"speed": 80 / 3.6, "amplitude": math.radians(60), "friction": 0.9, "friction_after": 0.35, "jump": 1.8}
    setting = scenario("held_steer", "qin2014_understeer", "gaussian", **settings)
    log = rollout(setting, "truth", "esc", seed=1)
    heard = zip(log.time.tolist(), log.inputs, log.readings, strict=True)
    return setting.nominal, log, [Reading(*r) for r in heard]


@finders
def test_it_finds_a_friction_that_jumps_within_half_a_second(name, jump):
    nominal, log, readings = jump
    found = np.array([e.friction for e in said(ESTIMATORS.make(name), nominal, readings)])
    slippery = np.flatnonzero(log.friction < 0.5)[0]
    assert found[slippery - 10] > 0.7
    assert found[slippery + 50] < 0.5


@finders
def test_after_the_jump_its_sideslip_is_better_than_the_extended_filters(name, jump):
    nominal, log, readings = jump
    after = np.flatnonzero(log.friction < 0.5)
    error = {}
    for who in (name, "ekf"):
        sideslip = np.array([e.sideslip for e in said(ESTIMATORS.make(who), nominal, readings)])
        error[who] = np.sqrt(np.mean((sideslip - log.sideslip)[after] ** 2))
    assert error[name] < 0.7 * error["ekf"]


@finders
def test_no_number_that_cannot_be_is_taken(name):
    wrong = {
        "imm": [
            {"frictions": (0.9, 0.0)},
            {"frictions": ()},
            {"shares": (0.5, 0.6)},
            {"shares": (1.0,)},
            {"shares": (1.0, 0.0)},
            {"switching": -1.0},
            {"rule": "cubature"},
        ],
        "ukf_friction": [{"noise": -0.1}, {"prior": math.nan}, {"decay": 0.0}],
    }
    for settings in wrong[name]:
        with pytest.raises(ValueError, match=next(iter(settings))):
            ESTIMATORS.make(name, **settings)


def test_modes_follow_the_shares_in_the_long_run():
    estimator = ESTIMATORS.make("imm", switching=0.7)
    transition = estimator.transition(0.01)
    np.testing.assert_allclose(transition.sum(axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(np.array(estimator.shares) @ transition, estimator.shares, rtol=1e-14)
    # Ten steps of 10 ms are one of 100 ms.
    np.testing.assert_allclose(np.linalg.matrix_power(transition, 10), estimator.transition(0.1), rtol=1e-12)


def test_drives_with_the_unscented_rule_too(jump):
    nominal, _, readings = jump
    pair = [said(ESTIMATORS.make("imm", rule=rule), nominal, readings) for rule in ("extended", "unscented")]
    # Two ways to push a Gaussian through the same models: apart by what the tyres' curve makes of its width.
    apart = [a.vy - b.vy for a, b in zip(*pair, strict=True)]
    assert np.abs(apart).max() > 0 and np.sqrt(np.mean(np.square(apart))) < 0.2
