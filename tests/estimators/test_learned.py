"""Learned estimators: what they hear, what files they refuse, and that what is shipped is what its sheet says."""

import io
import pickle
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.estimators.learned import CorrectedKalmanFilter, RecurrentEstimator
from vse_gym.estimators.learned_features import LIMIT, MOTION, OUTPUTS, hear_drive, take_in
from vse_gym.estimators.learned_weights import FOLDER, load_weights, save_weights, shipped_weights
from vse_gym.evaluation.contenders import fingerprint
from vse_gym.inference.recurrent import RecurrentNet
from vse_gym.physics import parameters as p
from vse_gym.probing import mirror
from vse_gym.registry import UnknownNameError
from vse_gym.scenarios import scenario
from vse_gym.simulation import rollout

KINDS = [RecurrentEstimator, CorrectedKalmanFilter]


def net_of(kind, size=6, scale=0.3):
    rng, inputs, out = np.random.default_rng(0), len(kind.features), len(OUTPUTS)
    shapes = (inputs, 3 * size), (size, 3 * size), (3 * size,), (3 * size,), (size, out), (out,)
    return RecurrentNet(*(rng.normal(scale=scale, size=shape) for shape in shapes))


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "own.npz"
    save_weights(path, "gru", net_of(RecurrentEstimator), RecurrentEstimator.features, OUTPUTS)
    return path


# -- what is heard ----------------------------------------------------------------------------------------------------


def hear(kind, nominal, readings):
    front, values = kind.front(nominal)
    return hear_drive(front, values, np.array([r.inputs for r in readings]), np.array([r.y for r in readings]))


@pytest.mark.parametrize("kind", KINDS)
def test_features_and_the_plain_motion_are_mirrored_as_declared(kind, nominal, readings):
    x, motion, units = hear(kind, nominal, readings)
    assert x.shape[1] == len(kind.features)
    mirrored, reverse, same = hear(kind, nominal, [mirror(r) for r in readings])
    sides = np.array(list(kind.features.values()))
    # the filter's sums in another order, enlarged by its difference quotients
    np.testing.assert_allclose(mirrored, sides * x, atol=1e-7)
    np.testing.assert_allclose(reverse, np.array(list(MOTION.values())) * motion, atol=1e-7)
    np.testing.assert_allclose(same, units, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_features_stay_within_their_limit_whatever_is_read(kind, nominal, readings):
    rng = np.random.default_rng(0)
    wild = []
    for reading in readings[:200]:
        y = np.where(rng.random(10) < 0.3, np.nan, reading.y * rng.choice([-100.0, 0.0, 1.0, 100.0], 10))
        wild.append(reading._replace(inputs=reading.inputs * rng.choice([-10.0, 0.0, 10.0], 9), y=y))
    x, motion, _ = hear(kind, nominal, wild)
    assert np.all(np.abs(x) <= LIMIT)
    assert np.isfinite(motion).all()


def test_in_gentle_cornering_both_axles_tell_the_true_sideslip():
    setting = scenario("held_steer", sensors="clean", speed=20.0, amplitude=0.3, duration=4.0)
    log = rollout(setting, "truth", "none", seed=0)
    front, values = RecurrentEstimator.front(setting.nominal)
    x, _, _ = hear_drive(front, values, log.inputs, log.readings)
    names, late = list(RecurrentEstimator.features), slice(300, None)
    assert np.abs(log.sideslip[late]).min() > np.radians(0.2)
    for axle in ("sideslip_front", "sideslip_rear"):
        found = 0.1 * x[late, names.index(axle)]
        # linear tyres, which at 2 m/s2 are some percent too stiff
        np.testing.assert_allclose(found, log.sideslip[late], atol=np.radians(0.1))


def test_the_filter_within_is_the_packages_own(nominal, readings):
    kind = CorrectedKalmanFilter
    _, motion, _ = hear(kind, nominal, readings)
    ekf, rng = ExtendedKalmanFilter(), np.random.default_rng(0)
    state = ekf.init(nominal, rng)
    for row, reading in zip(motion, readings, strict=True):
        state = ekf.update(state, reading, rng)
        np.testing.assert_allclose(row[:3], state.mean, atol=1e-12)  # put together again from what the net is told


def test_a_filter_that_is_lost_is_followed_no_farther_than_the_net_is_told_of(nominal, readings):
    lost = [r._replace(y=np.where(np.arange(10) == 2, 4.0, r.y)) for r in readings]  # a gyro that is stuck at 230 deg/s
    x, motion, _ = hear(CorrectedKalmanFilter, nominal, lost)
    told = 0.1 * x[:, list(CorrectedKalmanFilter.features).index("filter_sideslip")]
    np.testing.assert_allclose(motion[:, 1], told * np.maximum(motion[:, 0], 2.0), rtol=1e-12)
    assert np.abs(told).max() == pytest.approx(0.1 * LIMIT)


def test_one_update_hears_as_training_does(nominal, readings):
    front, values = RecurrentEstimator.front(nominal)
    x, motion, _ = hear(RecurrentEstimator, nominal, readings[:20])
    for k, reading in enumerate(readings[:20]):
        values, features, base = take_in(front, values, reading.inputs, reading.y)
        np.testing.assert_array_equal(features, x[k])
        np.testing.assert_array_equal(base, motion[k])


# -- files ------------------------------------------------------------------------------------------------------------


def rewritten(path, **changes):
    with np.load(path) as old:
        arrays = {name: old[name] for name in old.files} | changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def one_array():
    stream = io.BytesIO()
    np.save(stream, np.zeros(3))
    return stream.getvalue()


SPOILT = {
    "corrupt": (lambda f: f.write_bytes(f.read_bytes()[:500]), "not a sound .npz file"),
    "empty": (lambda f: f.write_bytes(b""), "not a sound .npz file"),
    "a letter": (lambda f: f.write_text("Dear Sir"), "not a sound .npz file"),
    "a pickle": (lambda f: f.write_bytes(pickle.dumps({"net": 1})), "not a sound .npz file"),
    "pickled arrays": (lambda f: rewritten(f, output_bias=np.array([{}])), "not a sound .npz file"),
    "one array": (lambda f: f.write_bytes(one_array()), "not a sound .npz file"),
    "foreign": (lambda f: np.savez(f, w=np.zeros(3)), "it lacks estimator, features, hidden_bias"),
    "a part missing": (lambda f: rewritten(f, hidden_weights=None), "it lacks hidden_weights"),
    "another's": (lambda f: rewritten(f, estimator=np.array("kalman_gru")), "weights of 'kalman_gru', expected those"),
    "of another version": (lambda f: rewritten(f, features=np.array(["ax"])), "trained with other features than"),
    "other outputs": (lambda f: rewritten(f, outputs=np.array(["vx"])), "trained with other outputs than"),
    "words": (lambda f: rewritten(f, output_bias=np.array(["a"] * 10)), "output_bias must be floating point numbers"),
    "misshapen": (
        lambda f: rewritten(f, output_bias=np.zeros(9)),
        r"output_bias has the shape \(9,\), expected \(10,\)",
    ),
    "too flat": (lambda f: rewritten(f, hidden_bias=np.zeros(())), "has the shape"),
    "not finite": (lambda f: rewritten(f, input_bias=np.full(18, np.nan)), "input_bias holds numbers that are not"),
}


@pytest.mark.parametrize("how", SPOILT)
def test_a_file_that_cannot_be_is_refused_by_name(how, file):
    spoil, told = SPOILT[how]
    spoil(file)
    with pytest.raises(ValueError, match=told) as caught:
        RecurrentEstimator(str(file))
    assert str(file) in str(caught.value)


def test_weights_that_are_not_there_are_refused_with_those_that_are():
    with pytest.raises(UnknownNameError, match=r"no weights named 'mine'; shipped: gru, kalman_gru, or the path"):
        RecurrentEstimator("mine")


def test_a_file_of_ones_own_is_used_and_told_apart_from_another(file, nominal, readings, tmp_path):
    own, rng = ESTIMATORS.make("gru", weights=str(file)), np.random.default_rng(0)
    state = own.update(own.init(nominal, rng), readings[0], rng)
    assert np.isfinite(own.estimate(state)[:5]).all()
    before = fingerprint(own)
    save_weights(file, "gru", net_of(RecurrentEstimator, scale=0.1), RecurrentEstimator.features, OUTPUTS)
    assert fingerprint(ESTIMATORS.make("gru", weights=str(file))) != before


def test_weights_come_back_as_they_were_written(file):
    net = load_weights(str(file), "gru", RecurrentEstimator.features, OUTPUTS).net
    for name, ours, theirs in zip(net._fields, net_of(RecurrentEstimator), net, strict=True):
        np.testing.assert_array_equal(theirs, ours.astype(np.float32), err_msg=name)


def test_another_interval_than_that_of_training_is_refused(nominal, file):
    with pytest.raises(ValueError, match=r"trained on readings every 0.01 s, not every 0.02 s"):
        RecurrentEstimator(str(file)).init(replace(nominal, dt=0.02), np.random.default_rng(0))


# -- what is shipped --------------------------------------------------------------------------------------------------


def test_a_sheet_lies_beside_each_of_the_shipped_weights_and_fits_them():
    assert shipped_weights() == ["gru", "kalman_gru"]
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 2e6
    for name in shipped_weights():
        sheet = tomllib.loads((FOLDER / f"{name}.toml").read_text())
        assert sheet["digest"] == ESTIMATORS.make(name).digest
        assert sheet["estimator"] == name
        assert sheet["command"].startswith(f"python agents/train_estimator.py {name} --seed ")
        assert sheet["validation"]["sideslip_rmse_deg"] < sheet["validation_of_ekf"]["sideslip_rmse_deg"]


@pytest.mark.parametrize("name", ["gru", "kalman_gru"])
def test_a_slide_that_surprises_the_filter_does_not_surprise_the_net(name):
    # Told a friction of 0.9 on a road of 0.35, with a car that no net was trained on: the filter sees half of the slide
    setting = scenario("held_steer", "bmw_320i", speed=22.0, amplitude=1.0, friction=0.9, friction_after=0.35)
    log = rollout(setting, name, "none", seed=0)
    ekf = rollout(setting, "ekf", "none", seed=0)
    moving = log.truth[:, p.VX] > 3
    ours, theirs = (
        np.sqrt(np.mean((np.arctan2(g.estimate[:, 1], g.estimate[:, 0]) - g.sideslip)[moving] ** 2)) for g in (log, ekf)
    )
    assert ours < theirs
