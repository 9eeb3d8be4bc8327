"""What a model must offer to be estimated: a belief's shape, and the functions that each model type registers.

A model is a NamedTuple of its parameters with at least the fields

    prior_mean (n,), prior_cov (n, n)   belief one step before the first reading
    process_cov (n, n)                  covariance of the noise that one step adds to the state
    variances (m,)                      of the channels' noise, for gates and for what adapts it; NaN: not used
    memory (k,)                         initial value of what the model remembers beside the state

States travel as columns, (n, N): one column for a mean, 2n + 1 for sigma points, hundreds for particles.
"""

from vse_gym.compiled import generic


@generic
def advance(model, states, u):
    """The states one step on under the held inputs u, without noise: (n, N) to (n, N)."""


@generic
def observe(model, states, u):
    """What the sensors would read without noise: (n, N) to (m, N)."""


@generic
def heed(model, u, y):
    """The held inputs (k,) as the model is to take them, given what was read at the end of their time."""


@generic
def recall(model, memory, u):
    """The held inputs, as :func:`heed` gives them, with what ``advance`` and ``observe`` need of the memory."""


@recall.register(object)
def _nothing_recalled(model, memory, u):
    return u


@generic
def remember(model, memory, state, u):
    """The memory one step on, of a model in which something lags behind the state: (n,), as it has been corrected."""


@remember.register(object)
def _nothing_remembered(model, memory, state, u):
    return memory


@generic
def attend(model, memory, u, y):
    """Which channels to believe, and how far: noise variances (m,), NaN where a channel is not to be used, and the
    memory one step on. A channel whose reading is NaN must come back as NaN.
    """


@generic
def report(model, state, u):
    """What everybody wants to know of a state (n,): array of vx, vy, yaw rate, ax, ay in SI units, (5,)."""
