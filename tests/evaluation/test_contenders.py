"""Who is judged, under which name, and what tells two of them apart."""

import importlib
import sys
from dataclasses import dataclass, replace

import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.anchors import Truth, ZeroSideslip
from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.evaluation.contenders import PARTS, contenders, fingerprint


class Plain(ZeroSideslip):
    pass


def test_a_fingerprint_changes_with_every_setting_and_with_nothing_else():
    plain = ExtendedKalmanFilter()
    assert fingerprint(plain) == fingerprint(ExtendedKalmanFilter())
    deep = replace(plain, model=replace(plain.model, vy_noise=plain.model.vy_noise * (1 + 1e-15)))
    assert fingerprint(deep) != fingerprint(plain)


def test_every_estimator_has_a_fingerprint_of_its_own():
    prints = {name: fingerprint(ESTIMATORS[name]()) for name in ESTIMATORS}
    assert len(set(prints.values())) == len(prints)


def test_a_class_from_outside_is_known_by_its_source_too(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    text = "from vse_gym.estimators.anchors import ZeroSideslip\nclass Mine(ZeroSideslip):\n    {}\n"
    prints = []
    for body in ("pass", "brake_hold = 0.2"):
        (tmp_path / "outside.py").write_text(text.format(body))
        monkeypatch.delitem(sys.modules, "outside", raising=False)
        mine = importlib.import_module("outside").Mine
        prints += [fingerprint(mine()), fingerprint(Truth(("vx",), inner=mine()))]
    assert len(set(prints)) == 4


def test_an_instance_of_an_ordinary_class_has_no_address_in_its_fingerprint():
    class Odd(ZeroSideslip):
        def __init__(self, value):
            self.__dict__["thing"] = value

    Odd.__dataclass_fields__ = property()  # is_dataclass looks here
    assert fingerprint(Odd(object())) == fingerprint(Odd(object()))


def test_attribution_makes_the_other_fields_true():
    rows = {c.name: c for c in contenders(["truth", "ekf"], attribution=True)}
    assert list(rows) == ["truth", "ekf", "ekf: velocity", "ekf: yaw"]
    for part, true in PARTS.items():
        row = rows[f"ekf: {part}"]
        assert (row.parent, row.part) == ("ekf", part)
        assert row.estimator == Truth(true, inner=ExtendedKalmanFilter())
    known = {*PARTS["velocity"], *PARTS["yaw"]}
    assert known == {"vx", "vy", "yaw_rate", "ax", "ay"}  # what the one part estimates the other has true


def test_a_tuning_takes_the_place_of_a_default_and_is_named():
    tuned = replace(ExtendedKalmanFilter(), model=replace(ExtendedKalmanFilter().model, vy_noise=2.0))
    rows = contenders(["ekf", "ukf"], {"ekf": (tuned, "ekf-tuned (abc)")})
    assert [(c.estimator == tuned, c.tuning) for c in rows] == [(True, "ekf-tuned (abc)"), (False, "default")]


def test_two_of_one_name_are_refused():
    with pytest.raises(ValueError, match="mapping"):
        contenders([ZeroSideslip(), ZeroSideslip()])
    with pytest.raises(ValueError, match="two estimators"):
        contenders({"ekf": "ekf", "ekf: yaw": "ukf"}, attribution=True)


def test_the_name_of_the_uncontrolled_car_is_taken():
    with pytest.raises(ValueError, match="without stability control"):
        contenders({"none": "ekf"})


def test_a_fingerprint_tells_classes_apart():
    @dataclass(frozen=True)
    class Same(ZeroSideslip):
        pass

    assert len({fingerprint(Same()), fingerprint(Plain()), fingerprint(ZeroSideslip())}) == 3
