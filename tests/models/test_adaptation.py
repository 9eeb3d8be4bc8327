"""Settings of what finds its noise on line: what cannot be is refused, by name."""

import pytest

from vse_gym.catalogue import ESTIMATORS


@pytest.mark.parametrize("name", ["ackf", "acpf"])
@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"forgetting": 1.0}, r"forgetting must lie in \(0, 1\), not 1.0"),  # its rate would be 0/0
        ({"floor": 5.0, "cap": 1.0}, "floor and cap must be positive, finite and in order, not 5.0 and 1.0"),
        ({"floor": 0.0}, "floor and cap"),
        ({"limit": 0.0}, "limit must be positive"),
        ({"head_start": -1.0}, "head_start not negative"),
    ],
)
def test_what_cannot_be_is_refused(name, settings, told):
    with pytest.raises(ValueError, match=told):
        ESTIMATORS[name](**settings)


def test_both_parents_settings_are_looked_at():
    with pytest.raises(ValueError, match="widening"):
        ESTIMATORS["acpf"](widening=3.0)
