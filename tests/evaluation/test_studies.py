"""The studies that ship belong together: what one says of another is so."""

import tomllib

import pytest

from vse_gym.catalogue import CONTROLLERS, MANOEUVRES
from vse_gym.evaluation import STUDIES
from vse_gym.sensors import SUITES
from vse_gym.vehicles import names


def study(name):
    return tomllib.loads((STUDIES / f"{name}.toml").read_text(encoding="utf-8"))


def test_attribution_drives_the_headline_s_cells_but_for_its_negative_control():
    headline, attribution = study("headline-v1"), study("attribution-v1")
    assert attribution["cell"] == [cell for cell in headline["cell"] if cell["name"] != "negative control"]
    assert len(attribution["cell"]) == len(headline["cell"]) - 1 == 9
    for key in ("randomise", "seeds"):
        assert attribution[key] == headline[key]


def test_smoke_drives_three_of_the_headline_s_cells():
    smoke, headline = study("smoke-v1"), study("headline-v1")
    assert len(smoke["cell"]) == 3
    assert all(cell in headline["cell"] for cell in smoke["cell"])


@pytest.mark.parametrize(
    ("key", "every"),
    [
        ("manoeuvre", set(MANOEUVRES)),
        ("vehicle", set(names())),
        ("controller", set(CONTROLLERS) - {"none"}),
        ("sensors", set(SUITES) - {"clean"}),
    ],
)
def test_full_has_every_kind_of(key, every):
    assert {cell[key].partition("+")[0] for cell in study("full-v2")["cell"]} == every
