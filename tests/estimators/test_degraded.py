"""An estimator made worse on purpose is that estimator, but for what the tunings say."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.degraded import Degraded
from vse_gym.estimators.kinematic import KinematicObserver
from vse_gym.testing import ESTIMATOR_CHECKS
from vse_gym.types import Estimate

STEPS = 200


def said_by(estimator, nominal, readings, friction=None):
    """Estimates after each of the first readings of a drive, and the last state."""
    rng = np.random.default_rng(0)
    state, out = estimator.init(nominal, rng), []
    for reading in readings[:STEPS]:
        if friction is not None:
            state = estimator.tell_friction(state, friction)
        state = estimator.update(state, reading, rng)
        out.append(estimator.estimate(state))
    return out, state


def assert_same(ours, theirs):
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(np.array(a[:5]), np.array(b[:5]))
        np.testing.assert_array_equal(a.cov, b.cov)


@pytest.mark.parametrize("check", ESTIMATOR_CHECKS, ids=lambda check: check.__name__)
def test_keeps_every_promise_of_an_estimator(check, nominal, readings):
    # without a bias, which no mirrored drive mirrors
    check(Degraded(KinematicObserver(), gain=0.5, delay=0.1), nominal, readings)


@pytest.mark.parametrize("name", ["ekf", "pf"])
def test_as_it_comes_it_is_the_inner_estimator(name, nominal, readings):
    inner = ESTIMATORS.make(name)
    alone, last = said_by(inner, nominal, readings)
    wrapped, state = said_by(Degraded(inner), nominal, readings)
    assert_same(wrapped, alone)
    np.testing.assert_equal(Degraded(inner).innovation(state), inner.innovation(last))
    np.testing.assert_equal(Degraded(inner).effective_size(state), inner.effective_size(last))


def test_gain_and_bias_are_on_lateral_speed_alone(nominal, readings):
    alone, _ = said_by(ESTIMATORS.make("ekf"), nominal, readings)
    wrapped, _ = said_by(Degraded(ESTIMATORS.make("ekf"), gain=0.5, bias=0.25), nominal, readings)
    assert max(abs(e.vy) for e in alone) > 0.1  # else the drive shows nothing
    assert_same(wrapped, [e._replace(vy=0.5 * e.vy + 0.25) for e in alone])


@pytest.mark.parametrize("steps", [1, 10])
def test_it_is_late_by_whole_steps(steps, nominal, readings):
    inner = ESTIMATORS.make("ekf")
    alone, _ = said_by(inner, nominal, readings)
    late, _ = said_by(Degraded(inner, delay=steps * nominal.dt), nominal, readings)
    before: Estimate = inner.estimate(inner.init(nominal, np.random.default_rng(0)))
    assert_same(late, [before] * steps + alone[:-steps])


def test_an_inner_estimator_that_is_told_the_friction_is_told_it_here_too(nominal, readings):
    inner = ESTIMATORS.make("ekf_told")
    assert Degraded(inner).told_friction and not Degraded(ESTIMATORS.make("ekf")).told_friction
    assert_same(
        said_by(Degraded(inner), nominal, readings, 0.3)[0],
        said_by(inner, nominal, readings, 0.3)[0],
    )


@pytest.mark.parametrize("delay", [-0.01, np.nan])
def test_a_delay_that_cannot_be_is_refused(delay):
    with pytest.raises(ValueError, match="delay"):
        Degraded(KinematicObserver(), delay=delay)
