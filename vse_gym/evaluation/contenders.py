"""Who is judged: estimators by the names of their rows."""

from collections.abc import Mapping, Sequence

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator

POTENTIAL = "none"  # the row of the car without stability control: what there is to gain; never ranked

Judged = Sequence[str | Estimator] | Mapping[str, str | Estimator]


def judged(estimators: Judged) -> dict[str, Estimator]:
    """Estimators by the name of their row: a name of the catalogue, or of the class of an instance.

    Raises:
        UnknownNameError: If a name is not known.
        ValueError: If two rows would have the same name, or one that of the car without control.
    """
    if isinstance(estimators, Mapping):
        rows = {name: ESTIMATORS.make(e) for name, e in estimators.items()}
    else:
        rows = {}
        for e in estimators:
            name = e if isinstance(e, str) else type(e).__name__
            if name in rows:
                raise ValueError(f"two estimators named {name!r}: hand in a mapping from names to estimators")
            rows[name] = ESTIMATORS.make(e)
    if POTENTIAL in rows:
        raise ValueError(f"{POTENTIAL!r} is the row of the car without stability control: name the estimator otherwise")
    return rows
