"""For rules that stand around another one: what they leave to it."""

from vse_gym.compiled import compiled
from vse_gym.inference.gaussian.recursion import correct, covariance, foresee, keep, predict


@compiled
def to_edit(told, own, memory):
    """What ``believe`` of the rule inside gave, to be edited: variances (m,), and the memory with its part renewed.

    The rule outside asks it itself: numba takes a function that asked for rules within rules for a recursion.
    """
    after = memory.copy()
    for i in range(own.size):
        after[i] = own[i]
    return told.copy(), after


def _keep(outer, cov):
    return keep(outer.rule, cov)


def _covariance(outer, kept):
    return covariance(outer.rule, kept)


def _predict(outer, model, mean, kept, u):
    return predict(outer.rule, model, mean, kept, u)


def _foresee(outer, model, mean, kept, u):
    return foresee(outer.rule, model, mean, kept, u)


def _correct(outer, model, mean, kept, u, y, variances):
    return correct(outer.rule, model, mean, kept, u, y, variances)


def leave_to_inner(kind: type) -> None:
    """Let a rule with a field ``rule`` carry, predict, foresee and correct as that one does."""
    keep.register(kind)(_keep)
    covariance.register(kind)(_covariance)
    predict.register(kind)(_predict)
    foresee.register(kind)(_foresee)
    correct.register(kind)(_correct)
