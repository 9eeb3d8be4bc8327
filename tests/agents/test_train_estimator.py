"""The program that trains learned estimators: its likelihood, its checkpoints, its drives, and what it writes."""

import math
import sys
import tomllib
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.learned import CorrectedKalmanFilter, RecurrentEstimator
from vse_gym.estimators.learned_features import MOTION, OUTPUTS, hear_drive
from vse_gym.estimators.learned_weights import save_weights
from vse_gym.evaluation import Study
from vse_gym.evaluation.study import study_names
from vse_gym.vehicles import load

torch = pytest.importorskip("torch", reason="torch comes with the extra [rl]")
sys.path.insert(0, str(Path(__file__).parents[2] / "agents"))
drives = import_module("estimator_drives")
records = import_module("estimator_records")
scores = import_module("estimator_scores")
training = import_module("estimator_training")
program = import_module("train_estimator")

torch.set_num_threads(1)  # as in training; on a busy machine more are slower by far

SIDES = training.Parity(np.array([1.0, -1.0]), np.array([1.0, -1.0, 1.0, 1.0]))
TINY = training.Training(epochs=3, hidden=8, batch=8, window=10, rate=0.02)


def recordings(count, seed=0):
    """Two lags of two inputs, of which the second changes its sign in a mirror; with noise of 0.1 and 0.3."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(count):
        x = rng.normal(size=(int(rng.integers(15, 31)), 2)).astype(np.float32)
        y = np.zeros_like(x)
        for t in range(1, len(x)):
            y[t] = 0.6 * y[t - 1] + 0.5 * x[t]
        noise = rng.normal(size=y.shape) * [0.1, 0.3]
        found.append(training.Recording(x, (y + noise).astype(np.float32)))
    return found


# -- likelihood -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beta", [0.0, 0.5])
def test_the_likelihood_is_best_at_the_mean_and_the_variance_of_the_data(beta):
    data = torch.from_numpy(np.random.default_rng(0).normal([1.0, -2.0], [0.2, 3.0], (1000, 2)))
    guess = torch.zeros(4, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.Adam([guess])
    for rate in 500 * [0.05] + 200 * [0.005] + 200 * [0.0005]:
        optimiser.param_groups[0]["lr"] = rate
        optimiser.zero_grad()
        training.likelihood(guess.expand(len(data), 4), data, beta).mean().backward()
        optimiser.step()
    mean, std = guess.detach().numpy()[:2], np.exp(guess.detach().numpy()[2:])
    np.testing.assert_allclose(mean, data.mean(0), atol=1e-3)  # about the last steps' length
    np.testing.assert_allclose(std, data.std(0, correction=0), rtol=1e-3)


def test_the_likelihood_is_that_of_a_normal_law():
    said, target = torch.tensor([[0.5, math.log(2.0)]]), torch.tensor([[3.0]])
    law = torch.distributions.Normal(0.5, 2.0)
    assert training.likelihood(said, target).item() == pytest.approx(-law.log_prob(target).item(), rel=1e-6)


# -- training ---------------------------------------------------------------------------------------------------------


def test_a_net_learns_two_lags_and_how_noisy_they_are(tmp_path):
    data, held = recordings(64), recordings(32, seed=1)
    settings = replace(TINY, epochs=25)
    net, history, _ = training.train(data, held, SIDES, settings, tmp_path / "c")
    best = np.log([0.1, 0.3]).mean() + 0.5 * math.log(2 * math.pi * math.e)  # the entropy of the noise
    assert best < history[-1][1] < best + 0.2 < history[0][1]
    said = np.concatenate(training.outputs_of(net, held, SIDES))
    errors = said[:, :2] - np.concatenate([r.targets for r in held])
    spread = errors.std(axis=0)
    assert np.all(spread < [0.25, 0.45])  # of signals with a standard deviation of 0.63
    band = np.mean(np.abs(errors) < 1.96 * np.exp(said[:, 2:]), axis=0)
    assert np.all(np.abs(band - 0.95) < 0.04)


def test_an_interrupted_training_ends_where_an_unbroken_one_does(tmp_path):
    data, held = recordings(24), recordings(8, seed=1)
    whole, history, chosen = training.train(data, held, SIDES, TINY, tmp_path / "whole")

    def interrupt(epoch, loss, held_back, net):
        raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            training.train(data, held, SIDES, TINY, tmp_path / "broken", interrupt)
    resumed, again, best = training.train(data, held, SIDES, TINY, tmp_path / "broken")
    assert (again, best) == (history, chosen)
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name


def test_a_checkpoint_of_other_settings_is_refused(tmp_path):
    data = recordings(8)
    training.train(data, data, SIDES, replace(TINY, epochs=1), tmp_path / "c")
    with pytest.raises(ValueError, match="training with other settings"):
        training.train(data, data, SIDES, replace(TINY, epochs=2), tmp_path / "c")


def test_windows_cut_the_errors_way_back_and_nothing_else():
    torch.manual_seed(0)
    net, sides = training.new_net(2, 8, 4), training._tensors(SIDES)
    x = torch.randn(3, 40, 2)
    with torch.no_grad():
        net["output"].weight.mul_(10)
        whole, _ = training.say(net, x, None, sides)
        first, hidden = training.say(net, x[:, :15], None, sides)
        second, _ = training.say(net, x[:, 15:], hidden, sides)
        mirrored, _ = training.say(net, x * sides.inputs, None, sides)
    torch.testing.assert_close(torch.cat([first, second], dim=1), whole, rtol=0, atol=1e-6)
    torch.testing.assert_close(mirrored, whole * sides.outputs, rtol=0, atol=1e-6)


def test_a_short_drive_says_the_same_beside_a_long_one():
    torch.manual_seed(0)
    net, some = training.new_net(2, 8, 4), recordings(5)
    together = training.outputs_of(net, some, SIDES)
    for recording, said in zip(some, together, strict=True):
        np.testing.assert_allclose(said, training.outputs_of(net, [recording], SIDES)[0], atol=1e-6)


def test_an_epoch_hears_every_drive_once_and_each_epoch_in_another_order():
    some = recordings(21)
    orders = [[id(r) for b in training.batches(some, 4, 0, epoch) for r in b] for epoch in (0, 1)]
    assert orders[0] != orders[1]
    assert sorted(orders[0]) == sorted(orders[1]) == sorted(map(id, some))


@pytest.mark.parametrize("kind", [RecurrentEstimator, CorrectedKalmanFilter])
def test_a_trained_net_says_the_same_without_torch(kind, nominal, readings, tmp_path):
    torch.manual_seed(0)
    sides = program.parity(kind)
    net = training.new_net(len(kind.features), 16, len(OUTPUTS))
    with torch.no_grad():
        net["output"].weight.mul_(5)  # so that there is something to compare
    path = tmp_path / "net.npz"
    save_weights(path, kind.name, training.exported(net), kind.features, OUTPUTS)
    front, values = kind.front(nominal)
    x, motion, units = hear_drive(
        front, values, np.array([r.inputs for r in readings]), np.array([r.y for r in readings])
    )
    m = len(MOTION)
    with torch.no_grad():
        tensors = training.Parity(*map(torch.from_numpy, sides))
        said = training.say(net.double(), torch.from_numpy(x)[None], None, tensors)[0][0].numpy()
    estimator, rng = kind(str(path)), np.random.default_rng(0)
    state = estimator.init(nominal, rng)
    for k, reading in enumerate(readings):
        state = estimator.update(state, reading, rng)
        told = estimator.estimate(state)
        np.testing.assert_allclose(told[:5], motion[k] + units[k] * said[k, :m], rtol=0, atol=1e-6)
        deviations = units[k, :3] * np.exp(said[k, m : m + 3])
        np.testing.assert_allclose(np.sqrt(told.cov.diagonal()), deviations, rtol=1e-6)


# -- drives -----------------------------------------------------------------------------------------------------------


def test_no_drive_is_one_of_the_headlines():
    study = Study.load("headline-v1")
    assert not {cell.vehicle for cell in study.cells} & set(drives.cars())
    assert len(drives.cars()) >= 5
    held_out = [load(cell.vehicle) for cell in study.cells]
    seeds = [Study.load(name).first_seed + Study.load(name).seeds for name in study_names()]
    for number in range(30):
        task = drives.drawn(number)
        assert max(seeds) <= drives.FIRST <= task.seed < 1_000_000  # where those begin that replace a seed
        told = task.scenario.nominal.vehicle
        assert all(told != car for car in held_out)
        assert told != task.scenario.vehicle


def test_a_number_is_one_drive():
    assert drives.drawn(7) == drives.drawn(7)
    assert drives.drawn(7).scenario != drives.drawn(8).scenario
    with pytest.raises(ValueError, match="numbered from 0 to 899999, not -1"):
        drives.drawn(-1)


def test_drives_are_driven_once_and_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(records, "CHUNK", 2)
    found = records.drives(0, 2, tmp_path)
    monkeypatch.setattr(records, "driven", lambda _: pytest.fail("driven again"))
    again = records.drives(0, 2, tmp_path)
    assert [d.number for d in found] == [d.number for d in again] == [0, 1]
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one.readings, other.readings)
        assert np.abs(np.arctan2(one.truth[:, 1], one.truth[:, 0])).max() < drives.LOST


# -- scores -----------------------------------------------------------------------------------------------------------


def test_scores_of_half_the_amplitude_say_so():
    t = np.linspace(0, 2 * np.pi, 400)
    angle = np.radians(10) * np.sin(t)
    truth = np.stack([20 * np.cos(angle), 20 * np.sin(angle), 0.1 * np.sin(t)], axis=1)
    half = np.stack([20 * np.cos(angle / 2), 20 * np.sin(angle / 2), 0.1 * np.sin(t) + 0.02], axis=1)
    found = scores.score([truth], [half], [np.full(truth.shape, 0.02)])
    assert found.peak_ratio == pytest.approx(0.5, rel=1e-6)
    assert found.sideslip_rmse_deg == pytest.approx(5 / math.sqrt(2), rel=2e-3)  # over a whole period, ends twice
    assert found.large_rmse_deg == found.sideslip_rmse_deg
    assert found.yaw_rate_rmse_degps == pytest.approx(math.degrees(0.02))
    assert found.vy_coverage_percent < 10
    assert math.isnan(scores.score([truth], [half]).coverage_percent)


# -- the whole program ------------------------------------------------------------------------------------------------


def test_the_program_writes_weights_that_an_estimator_reads(tmp_path, monkeypatch):
    monkeypatch.setattr(records, "CHUNK", 2)
    monkeypatch.setattr(program, "CHUNK", 2)
    monkeypatch.setattr(sys, "argv", ["agents/train_estimator.py", "gru"])
    program.main("gru", 0, 4, 2, 2, 8, tmp_path / "out", tmp_path / "drives", 1)
    sheet = tomllib.loads((tmp_path / "out" / "gru.toml").read_text())
    estimator = ESTIMATORS.make("gru", weights=str(tmp_path / "out" / "gru.npz"))
    assert estimator.digest == sheet["digest"]
    assert sheet["training"]["drives"] == 4 and sheet["validation"]["drives"] == 2
    assert len(sheet["training"]["losses"]) == 2 and sheet["training"]["best_epoch"] in (1, 2)
    assert sheet["architecture"]["features"] == list(RecurrentEstimator.features)
    assert {"sideslip_rmse_deg", "peak_ratio"} <= sheet["validation_of_ekf"].keys() | {"peak_ratio"}
    with pytest.raises(program.typer.BadParameter, match="no learned estimator named 'ukf'; known: gru, kalman_gru"):
        program.main("ukf")
