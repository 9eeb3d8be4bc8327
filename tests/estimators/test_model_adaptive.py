"""Model-adaptive particle filters on the car: heavy tails, what the transition sees, settings."""

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.inference.model_adaptive import doubt, propagate, weigh
from vse_gym.inference.wavelet import DONOHO, listen, noise_level
from vse_gym.replay import shadow
from vse_gym.scenarios import scenario
from vse_gym.sensors import LOUD, Sensors, stream
from vse_gym.simulation import rollout
from vse_gym.types import Reading

NAMES = ["mapf", "mapf_physics"]
every_one = pytest.mark.parametrize("name", NAMES)


@pytest.fixture(scope="module")
def lane_change():
    """A brisk one, below the limit, under heavy tails."""
    setting = scenario("sine_with_dwell", sensors="cauchy_gaussian", amplitude=np.radians(60), duration=4.0)
    log = rollout(setting, "truth", "none", seed=1)
    assert not log.ended
    return setting, log


def rmse(setting, log, estimator):
    """Of sideslip, [deg]."""
    trace = shadow(log, estimator, setting.nominal, 1)
    assert not trace.ended
    return np.degrees(np.sqrt(np.mean((np.arctan2(trace.estimate[:, 1], trace.estimate[:, 0]) - log.sideslip) ** 2)))


@every_one
def test_heavy_tails_do_it_less_harm_than_its_gaussian_twin(name, lane_change):
    heavy, gaussian = (rmse(*lane_change, ESTIMATORS.make(name, alpha=alpha)) for alpha in (1.5, 2.0))
    assert heavy < gaussian


def test_with_the_car_in_the_transition_it_is_nearer(lane_change):
    published, physics = (rmse(*lane_change, ESTIMATORS.make(name)) for name in NAMES)
    assert physics < 0.5 * published
    assert published < 1.0


@every_one
def test_it_learns_while_it_drives_and_hears_the_noise(name, lane_change):
    setting, log = lane_change
    estimator, rng = ESTIMATORS.make(name), np.random.default_rng(0)
    state = estimator.init(setting.nominal, rng)
    before, level = state.swarm.learnt.coefficients, noise_level(state.fixed.sheet, estimator.window)
    for row in zip(log.time.tolist(), log.inputs, log.readings, strict=True):
        state = estimator.update(state, Reading(*row), rng)
        level = listen(level, row[2], estimator.smoothing, DONOHO)
    assert np.abs(state.swarm.learnt.coefficients - before).max() > 0.05
    np.testing.assert_array_equal(state.swarm.noise.variances, level.variances)


@every_one
def test_a_noise_ten_times_as_loud_as_the_data_sheet_says_is_noticed(name):
    quiet = LOUD._replace(acceleration=0.03, yaw_rate=LOUD.yaw_rate / 10)
    setting = scenario("sine_steer", sensors=Sensors(LOUD), duration=5.0)
    told = setting.nominal.__class__(setting.nominal.vehicle, quiet, setting.nominal.speed)
    log = rollout(setting, "truth", "none", seed=2)
    estimator, rng = ESTIMATORS.make(name), stream(0, "estimator")
    state = estimator.init(told, rng)
    for row in zip(log.time.tolist(), log.inputs, log.readings, strict=True):
        state = estimator.update(state, Reading(*row), rng)
    ratio = np.sqrt(state.swarm.noise.variances[:3] / state.fixed.sheet[:3])
    np.testing.assert_allclose(ratio, 10.0, rtol=0.3)  # smoothed, a sigma still scatters by a tenth


def test_a_particle_moves_by_its_own_past():
    series = np.arange(12.0).reshape(2, 2, 3)
    states, after = propagate(
        series[0], series, np.full((2, 3), 100.0), np.array([[2.0, -1.0], [0.5, 0.0]]), np.zeros(2), stream(0, "x")
    )
    np.testing.assert_allclose(after[0], [2 * series[0, 0] - series[1, 0], 0.5 * series[0, 1]])
    np.testing.assert_array_equal(after[1], series[0])
    np.testing.assert_allclose(states, 100 + after[0])


def test_weights_are_products_and_a_lonely_particle_still_doubts():
    weights, squares = weigh(np.array([0.5, 0.5, 0.0]), np.log([1.0, 3.0, 1e300]))
    np.testing.assert_allclose(weights, [0.25, 0.75, 0.0])
    assert squares == pytest.approx(0.625)
    cov = doubt(np.zeros((2, 3)), np.zeros(2), np.array([1.0, 0.0, 0.0]), 1.0, np.array([0.1, 0.2]))
    np.testing.assert_allclose(cov, np.diag([0.01, 0.04]))


@every_one
def test_the_printed_forms_are_offered_and_go_through(name, lane_change):
    printed = ESTIMATORS.make(name, gain="printed", constant="printed", start="hold")
    assert rmse(*lane_change, printed) < 3.0


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"gain": "lms"}, "gain must be one of least_squares, printed"),
        ({"start": "zero"}, "start must be one of"),
        ({"constant": "mine"}, "constant must be one of donoho, printed"),
        ({"size": 1}, "size must be at least 2"),
        ({"window": 4}, "size must be at least 2 and window twice the order, not 500 and 4"),
        ({"coefficient": 0.0}, r"coefficient must lie in \(0, 1\]"),
        ({"alpha": 0.5}, "alpha"),
        ({"noise_gain": -1.0}, "must not be negative"),
        ({"heavy": ("az",)}, "heavy names no such channel"),
    ],
)
def test_a_setting_that_cannot_be_is_refused(settings, told):
    with pytest.raises(ValueError, match=told):
        ESTIMATORS.make("mapf", **settings)
