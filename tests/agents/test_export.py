"""The exported net answers as the one that was trained."""

import numpy as np
import pytest
from export import arrays_of, toml, write_agent
from typer.testing import CliRunner

from vse_gym.controllers.network import answer, network
from vse_gym.policy import TrainedPolicy

ALGORITHMS = ["ppo", "sac", "td3", "recurrent_ppo"]


def loud(model, seed=0):
    """With weights so large that the answers reach their ends."""
    rng = np.random.default_rng(seed)
    for parameter in model.policy.parameters():
        parameter.data += 0.5 * parameter.data.new_tensor(rng.normal(size=tuple(parameter.shape)))
    return model


@pytest.mark.parametrize("action", ["brakes", "yaw_moment"])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_exported_net_answers_as_the_trained_one(algorithm, action, untrained):
    model = loud(untrained(algorithm, action))
    arrays, told = arrays_of(algorithm, model)
    net = network(arrays, 11, told["sizes"], told["memory"], told["activation"], told["squash"])
    rng, state, hidden, spread = np.random.default_rng(1), None, np.zeros(2 * told["memory"]), []
    for _ in range(200):
        seen = rng.uniform(-5, 5, 11).astype(np.float32)
        wanted, state = model.predict(seen, state, np.zeros(1, dtype=bool), deterministic=True)
        out, hidden = answer(net, seen, hidden)
        np.testing.assert_allclose(out, wanted, rtol=0, atol=1e-6)
        spread.append(out)
    assert np.ptp(spread) > 0.5


def test_a_zip_is_loaded_only_by_who_trusts_it(untrained, tmp_path):
    from export import app

    path = tmp_path / "model.zip"
    untrained("sac", "yaw_moment").save(path)
    words = [str(path), "--algorithm", "sac", "--action", "yaw_moment", "--out", str(tmp_path / "agent")]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2 and "--trust" in refused.output
    assert not (tmp_path / "agent").exists()
    done = CliRunner().invoke(app, [*words, "--trust"])
    assert done.exit_code == 0, done.output
    assert TrainedPolicy(str(tmp_path / "agent")).card.squash == "tanh"


def test_a_net_of_other_parts_is_refused(untrained):
    from torch import nn

    model = untrained("ppo")
    model.policy.mlp_extractor.policy_net[1] = nn.GELU()
    with pytest.raises(ValueError, match="tanh or relu alone"):
        arrays_of("ppo", model)


def test_a_card_says_what_was_written(untrained, tmp_path):
    trained = {"command": 'a "quoted" one', "seed": 3, "range": [0.2, 1.0], "versions": {"torch": "2"}, "none": None}
    view = {"observation": "estimate", "action": "brakes", "controller": "lqr"}
    write_agent(tmp_path / "agent", "ppo", untrained("ppo"), view, trained, {"mean": 1.5})
    card = TrainedPolicy(str(tmp_path / "agent")).card
    assert card.trained == {key: value for key, value in trained.items() if value is not None}
    assert card.evaluation == {"mean": 1.5} and card.controller == "lqr"


def test_tables_within_tables_are_written_as_such():
    import tomllib

    table = {"a": 1, "b": {"c": [1, 2], "d": {"e": "f"}}, "g": {"h": {"i": True}}}
    assert tomllib.loads(toml(table)) == table
