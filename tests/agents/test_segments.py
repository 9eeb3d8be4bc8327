"""A run that is interrupted ends where an unbroken one does, to the bit."""

import numpy as np
import pytest
import torch
from environments import Task
from segments import BUFFER, CHECKPOINT, Run

from .conftest import Brief, tiny

TASK = Brief(
    env=("vse_gym/HeldSteer-v0", "vse_gym/SineWithDwell-v0"),
    vehicle=("qin2014", "ford_escort"),
    controller="esc",
    estimator=("truth", "ekf"),
)
STEPS = 400


def run(algorithm, seed=0):
    torch.set_num_threads(1)
    return Run(algorithm, TASK, tiny(algorithm), seed=seed, steps=STEPS, drives=4)


def facts(run):
    """All that has been learned, and what a segment begins with."""
    model = run.model
    found = {f"policy.{k}": v.numpy().copy() for k, v in model.policy.state_dict().items()}
    for name, part in model.get_parameters().items():
        if "optimizer" in name:
            for number, moments in part["state"].items():
                found |= {f"{name}.{number}.{k}": v.numpy().copy() for k, v in moments.items()}
    if getattr(model, "replay_buffer", None) is not None:
        found |= {name: getattr(model.replay_buffer, name).copy() for name in BUFFER}
        found["pos"] = np.array(model.replay_buffer.pos)
    if hasattr(model, "log_ent_coef"):
        found["log_ent_coef"] = model.log_ent_coef.detach().numpy().copy()
    found |= {f"best.{k}": v.numpy() for k, v in run.best.items()}
    return found | {"curve": np.array(run.curve), "steps": np.array(model.num_timesteps)}


def interrupted(run, after, folder):
    """Go on, and be stopped somewhere within the segment that holds step ``after``."""

    def stop(steps):
        if steps >= after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run.go_on(stop, folder)


@pytest.mark.parametrize("algorithm", ["ppo", "recurrent_ppo", "sac", "td3"])
def test_an_interrupted_run_ends_where_an_unbroken_one_does(algorithm, tmp_path):
    unbroken = run(algorithm)
    unbroken.go_on()
    wanted = facts(unbroken)
    first = run(algorithm)
    interrupted(first, 0.5 * unbroken.model.num_timesteps, tmp_path)
    assert 0 < first.segment < first.segments
    second = run(algorithm)
    second.load(tmp_path / CHECKPOINT)
    second.go_on(folder=tmp_path)
    got = facts(second)
    assert got.keys() == wanted.keys()
    for name, value in wanted.items():
        np.testing.assert_array_equal(got[name], value, err_msg=name)


def test_returns_of_several_steps_do_not_run_on_into_the_next_segment_s_drives():
    one = run("sac")
    one._begin()
    one.model.learn(one.segment_steps, reset_num_timesteps=False)
    buffer, last = one.model.replay_buffer, one.model.replay_buffer.pos - 1
    assert not buffer.dones[last].all()  # drives that are not over
    one.segment += 1
    one._begin()
    assert np.array_equal(buffer.timeouts[last], 1 - buffer.dones[last])
    buffer.rewards[last + 1 :] = 1e6  # of other drives
    buffer.pos += 5
    samples = buffer._get_samples(np.full(20, last))
    assert np.abs(samples.rewards.numpy()).max() < 10
    np.testing.assert_allclose(samples.discounts.numpy(), buffer.gamma)


def test_something_was_learned_and_another_seed_learns_something_else():
    first, other = run("ppo"), run("ppo", seed=1)
    before = facts(first)["policy.action_net.weight"]
    for one in (first, other):
        one.go_on()
    after, elsewhere = (facts(one)["policy.action_net.weight"] for one in (first, other))
    assert not np.array_equal(before, after)
    assert not np.array_equal(after, elsewhere)


def test_a_rate_falls_to_zero_over_the_segments():
    one, rates = run("ppo"), []
    while one.segment < one.segments:
        one._begin()
        rates.append(one.model.lr_schedule(1.0))
        one.segment += 1
    np.testing.assert_allclose(rates, [1e-3, 2e-3 / 3, 1e-3 / 3])


def test_nothing_is_run_when_a_checkpoint_is_read(tmp_path):
    class Bomb:
        def __reduce__(self):
            return exec, ("raise SystemExit('it ran')",)

    torch.save({"segment": Bomb()}, tmp_path / CHECKPOINT)
    with pytest.raises(Exception, match=r"(?i)weights.only"):
        run("ppo").load(tmp_path / CHECKPOINT)


def test_training_shares_no_car_and_no_sensors_with_the_held_out_drives_and_no_car_with_the_headline():
    from environments import held_out

    from vse_gym.evaluation.study import Study

    task = Task()
    headline = {cell.vehicle for cell in Study.load("headline-v1").cells}
    for own in (task, Task(vehicle=("vw_vanagon",), sensors=("dropout", "gaussian"))):
        other = held_out(own)
        assert other.vehicle and other.sensors
        assert not set(own.vehicle) & set(other.vehicle)
        assert not set(own.sensors) & set(other.sensors)
        assert not headline & (set(task.vehicle) | set(other.vehicle))
    with pytest.raises(ValueError, match="judged with vw_vanagon"):
        held_out(Task(vehicle=("vw_vanagon", "tian2018_electric")))


def test_kinds_that_no_row_would_drive_are_refused():
    with pytest.raises(ValueError, match="6 pairs of a manoeuvre and a car do not fit into 4 rows"):
        Run("ppo", Brief(env=TASK.env), tiny("ppo"), seed=0, steps=STEPS, drives=4)
