"""Names are found, explained when they are unknown, and reserved."""

from importlib.metadata import EntryPoint

import pytest

import vse_gym.registry
from vse_gym import catalogue
from vse_gym.controllers.base import Controller
from vse_gym.estimators.base import Estimator
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.registry import Registry, UnknownNameError

KINDS = {"estimator": Estimator, "controller": Controller, "manoeuvre": Manoeuvre}
REGISTRIES = [thing for thing in vars(catalogue).values() if isinstance(thing, Registry)]
NAMED = [pytest.param(registry, name, id=f"{registry.kind} {name}") for registry in REGISTRIES for name in registry]


@pytest.fixture
def shapes():
    return Registry("geometry.shapes", {"fraction": "fractions:Fraction", "broken": "no_such_module:Shape"})


@pytest.fixture
def publish(monkeypatch):
    """Publish a class under a name, as another package's entry point does."""
    published = []

    def add(group, name, value):
        published.append(EntryPoint(name, value, group))

    def entry_points(group):
        return [point for point in published if point.group == group]

    monkeypatch.setattr(vse_gym.registry, "entry_points", entry_points)
    return add


@pytest.mark.parametrize(("registry", "name"), NAMED)
def test_every_name_of_the_catalogue_makes_one_of_its_kind(registry, name):
    assert isinstance(registry.make(name), KINDS[registry.kind])


@pytest.mark.parametrize("registry", REGISTRIES, ids=lambda registry: registry.kind)
def test_an_unknown_name_is_told_which_names_there_are(registry):
    with pytest.raises(UnknownNameError) as caught:
        registry.make("no such name")
    assert str(caught.value) == f"no {registry.kind} named 'no such name'; known: {', '.join(registry)}"
    assert isinstance(caught.value, KeyError)  # so that Mapping.get and `in` work


def test_a_registry_is_a_mapping_that_imports_on_demand(shapes):
    assert list(shapes) == ["fraction", "broken"]
    assert len(shapes) == 2
    assert shapes["fraction"].__name__ == "Fraction"
    assert "circle" not in shapes
    assert shapes.get("circle") is None
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        shapes["broken"]


def test_a_name_is_known_even_if_its_class_cannot_be_imported(shapes):
    assert "broken" in shapes


def test_another_package_adds_a_name_by_an_entry_point(shapes, publish):
    publish("geometry.shapes", "decimal", "decimal:Decimal")
    publish("something.else", "counter", "collections:Counter")
    assert list(shapes) == ["fraction", "broken", "decimal"]
    assert shapes.make("decimal").__class__.__name__ == "Decimal"


def test_another_package_may_not_reuse_a_name(shapes, publish):
    publish("geometry.shapes", "fraction", "decimal:Decimal")
    with pytest.raises(ValueError, match=r"geometry\.shapes: a plugin reuses the name \['fraction'\]"):
        shapes.make("fraction")


def test_make_takes_a_name_and_settings(shapes):
    assert shapes.make("fraction", numerator=1, denominator=2) == 0.5


def test_make_refuses_a_setting_that_the_class_does_not_have(shapes):
    with pytest.raises(TypeError, match="colour"):
        shapes.make("fraction", colour="red")


def test_make_hands_an_instance_back(shapes):
    thing = object()
    assert shapes.make(thing) is thing


def test_make_refuses_settings_for_an_instance(shapes):
    with pytest.raises(TypeError, match=r"settings \['size'\] go into object\(\.\.\.\) itself"):
        shapes.make(object(), size=1)


def test_make_refuses_a_class(shapes):
    with pytest.raises(TypeError, match=r"float is a class: give an instance, float\(\.\.\.\), or a name"):
        shapes.make(float)
