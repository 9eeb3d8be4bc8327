"""The compiled recurrent net beside torch's, and in the mirror."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vse_gym.inference.recurrent import RecurrentNet, affine, gated_step, mirrored_step


def random_net(seed, inputs=5, size=7, outputs=4):
    rng = np.random.default_rng(seed)
    shapes = (inputs, 3 * size), (size, 3 * size), (3 * size,), (3 * size,), (size, outputs), (outputs,)
    return RecurrentNet(*(rng.normal(size=shape) for shape in shapes))


def test_the_net_is_the_one_of_torch():
    torch = pytest.importorskip("torch", reason="torch comes with the extra [rl]")
    net = random_net(0, inputs=6, size=16, outputs=3)
    cell = torch.nn.GRU(6, 16, batch_first=True).double()
    tensors = [torch.from_numpy(a) for a in net]
    with torch.no_grad():
        for theirs, ours in zip(cell.parameters(), tensors, strict=False):  # in torch's order: two weights, two biases
            theirs.copy_(ours.t())
        x = np.random.default_rng(1).normal(size=(3, 40, 6))
        inner, last = cell(torch.from_numpy(x))
        wanted = (inner @ tensors[4] + tensors[5]).numpy()
    hidden = np.zeros((3, 16))
    for t in range(40):
        hidden = gated_step(net, hidden, np.ascontiguousarray(x[:, t]))
        # the same formulas in double precision: 1e-15 a step, which a net of this size does not enlarge
        np.testing.assert_allclose(affine(hidden, net.output_weights, net.output_bias), wanted[:, t], atol=1e-10)
    np.testing.assert_allclose(hidden, last[0].numpy(), atol=1e-10)


def test_a_unit_whose_update_gate_is_shut_keeps_its_state():
    net = random_net(0)
    bias = net.input_bias.copy()
    bias[7:14] = 1e3
    hidden = np.random.default_rng(1).uniform(-1, 1, (2, 7))
    after = gated_step(net._replace(input_bias=bias), hidden, np.ones((2, 5)))
    np.testing.assert_allclose(after, hidden, rtol=1e-14)


@given(st.integers(0, 100))
def test_hidden_states_stay_within_one(seed):
    net, rng = random_net(seed), np.random.default_rng(seed)
    hidden = np.zeros((2, 7))
    for _ in range(20):
        hidden = gated_step(net, hidden, rng.normal(scale=10, size=(2, 5)))
        assert np.all(np.abs(hidden) <= 1)


@given(st.integers(0, 100))
def test_any_weights_treat_left_and_right_alike(seed):
    net, rng = random_net(seed), np.random.default_rng(seed)
    odd_inputs, odd_outputs = rng.choice([-1.0, 1.0], 5), rng.choice([-1.0, 1.0], 4)
    one = other = np.zeros((2, 7))
    for _ in range(10):
        x = rng.normal(size=5)
        one, said = mirrored_step(net, one, x, odd_inputs, odd_outputs)
        other, mirrored = mirrored_step(net, other, odd_inputs * x, odd_inputs, odd_outputs)
        np.testing.assert_allclose(mirrored, odd_outputs * said, rtol=1e-13, atol=1e-13)


def test_with_nothing_odd_about_it_the_net_is_itself():
    net, x = random_net(3), np.random.default_rng(0).normal(size=5)
    hidden, said = mirrored_step(net, np.zeros((2, 7)), x, np.ones(5), np.ones(4))
    alone = gated_step(net, np.zeros((1, 7)), x[None])
    np.testing.assert_allclose(hidden, np.vstack((alone, alone)), rtol=1e-14)
    np.testing.assert_allclose(said, (alone @ net.output_weights + net.output_bias)[0], rtol=1e-12)
