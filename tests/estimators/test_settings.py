"""Settings that cannot be are refused by name, with what was expected, by whoever is given them."""

import math
from dataclasses import fields, is_dataclass, replace

import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import Gate
from vse_gym.estimators.pretreatment import Pretreated
from vse_gym.models import DoubleTrackTuning, LinearBicycleTuning, RollTrackTuning, SingleTrackTuning
from vse_gym.models.adaptation import Adaptation
from vse_gym.models.tuning import Settings

NO_SHARE = r"resample_below must lie in \[0, 1\], not"


@pytest.mark.parametrize(
    ("kind", "settings", "told"),
    [
        ("pf", {"size": 100.5}, "size must be a whole number, at least 1, not 100.5"),
        ("pf", {"size": 1}, "size must be at least 2, not 1"),
        ("pf", {"resample_below": 5}, f"{NO_SHARE} 5"),
        ("mapf", {"resample_below": -1.0}, f"{NO_SHARE} -1.0"),
        ("mapf", {"order": 2.5}, "order must be a whole number"),
        ("mapf_physics", {"window": "long"}, "window must be a whole number, at least 1, not 'long'"),
        ("acpf", {"resample_below": math.nan}, "resample_below must be a number, not nan"),
        ("upf", {"resample_below": 1.5}, f"{NO_SHARE} 1.5"),
        ("upf", {"spread": 0.0}, "spread must be positive and finite, not 0.0"),
        ("upf", {"widening": 2.5}, r"widening must lie in \[1, 2\], not 2.5"),
        ("enkf", {"size": 3}, "size must be at least 4, not 3"),
        ("enkf", {"inflation": 0.9}, r"inflation must lie in \[1, 2\], not 0.9"),
        ("ukf", {"alpha": 0.0}, "alpha must be positive and finite, not 0.0"),
        ("sr_ukf", {"alpha": -1.0}, "alpha must be positive"),
        ("ukf_friction", {"alpha": math.inf}, "alpha must be positive and finite, not inf"),
        ("mhe", {"horizon": 2.5}, "horizon must be a whole number, at least 1, not 2.5"),
        ("mhe", {"iterations": 0}, "iterations must be a whole number, at least 1, not 0"),
        ("fusion", {"gain": math.nan}, "gain must be a number, not nan"),
        ("switching", {"median": 3.0}, "median must be a whole number"),
        ("kinematic", {"leak": -1.0}, "leak must not be negative, not -1.0"),
        ("zero", {"margin": None}, "margin must be a number, not None"),
        (SingleTrackTuning, {"vy_noise": -0.1}, "vy_noise must not be negative, not -0.1"),
        (LinearBicycleTuning, {"ay_error": math.nan}, "ay_error must be a number, not nan"),
        (DoubleTrackTuning, {"vx_noise": "0.1"}, "vx_noise must be a number, not '0.1'"),
        (RollTrackTuning, {"roll_noise": -1.0}, "roll_noise must not be negative, not -1.0"),
        (Adaptation, {"window": 30.5}, "window must be a whole number, at least 1, not 30.5"),
        (Gate, {"patience": math.nan}, "patience must be a number, not nan"),
    ],
)
def test_a_number_that_cannot_be_is_refused(kind, settings, told):
    with pytest.raises(ValueError, match=told):
        (ESTIMATORS[kind] if isinstance(kind, str) else kind)(**settings)


@pytest.mark.parametrize(
    ("kind", "settings", "told"),
    [
        (Pretreated, {"inner": "ekf"}, "inner must be of kind Estimator, not 'ekf'"),
        ("iae_ekf", {"adaptation": 3}, "adaptation must be of kind Adaptation, not 3"),
        ("ekf", {"gate": 0.999}, "gate must be of kind Gate, not 0.999"),
        ("ekf", {"model": "single_track"}, "model must be of kind ModelTuning, not 'single_track'"),
        ("kf", {"model": SingleTrackTuning()}, r"model must be of kind LinearBicycleTuning, not SingleTrackTuning\("),
        ("truth", {"inner": "ekf"}, "inner must be of kind Estimator or NoneType, not 'ekf'"),
        ("mhe", {"loss": 1.0}, "loss must be of kind str, not 1.0"),
    ],
)
def test_a_part_of_another_kind_is_refused(kind, settings, told):
    with pytest.raises(TypeError, match=told):
        (ESTIMATORS[kind] if isinstance(kind, str) else kind)(**settings)


def parts(thing):
    """A tuning and those that it holds."""
    return [thing, *(p for f in fields(thing) if is_dataclass(v := getattr(thing, f.name)) for p in parts(v))]


@pytest.mark.parametrize("name", ESTIMATORS)
def test_no_estimator_takes_what_is_no_number_of_its_kind(name):
    for part in parts(ESTIMATORS.make(name)):
        assert isinstance(part, Settings), f"{type(part).__name__} looks at none of its settings: derive from Settings"
        for field in fields(part):
            wrong = {int: [2.5, 0, -1, math.nan], float: [math.nan, None]}.get(field.type, [])
            wrong += [-1e-9] if "tune" in field.metadata else []
            for value in wrong:
                with pytest.raises(ValueError, match=rf"\b{field.name}\b.* must "):
                    replace(part, **{field.name: value})
