"""Who is judged, under which name, and what tells two of them apart."""

import copy
import importlib
import math
import subprocess
import sys
from dataclasses import dataclass, field, replace
from types import ModuleType

import numpy as np
import pytest

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.anchors import Truth, ZeroSideslip
from vse_gym.estimators.base import Estimator
from vse_gym.estimators.gaussian import ExtendedKalmanFilter
from vse_gym.estimators.kinematic import KinematicObserver
from vse_gym.evaluation.contenders import PARTS, contenders, fingerprint
from vse_gym.evaluation.tunings import Tuning, changed, settings_of
from vse_gym.types import Estimate


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


BASE = "from vse_gym.estimators.anchors import ZeroSideslip\nclass Base(ZeroSideslip):\n    gain = {}\n"
HELPER = "GAIN = {}\n"
MINE = "import helper\nfrom base import Base\nclass Mine(Base):\n    hold = {}\n"


def test_code_from_outside_counts_with_its_bases_and_helpers(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    prints = []
    for numbers in ((1, 1, 1), (2, 1, 1), (1, 2, 1), (1, 1, 2), (1, 1, 1)):
        for name, text, number in zip(("base", "helper", "outside"), (BASE, HELPER, MINE), numbers, strict=True):
            (tmp_path / f"{name}.py").write_text(text.format(number))
            monkeypatch.delitem(sys.modules, name, raising=False)
        mine = importlib.import_module("outside").Mine
        prints.append((fingerprint(mine()), fingerprint(Truth(("vx",), inner=mine()))))
    assert len(set(prints)) == 4 and prints[0] == prints[-1]


def test_a_module_that_names_a_file_which_is_none_does_no_harm(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "alone.py").write_text(BASE.format(1))
    phantom = ModuleType("phantom")
    phantom.__file__ = "phantom.py"  # as torch has it
    monkeypatch.setitem(sys.modules, "phantom", phantom)
    assert fingerprint(importlib.import_module("alone").Base())


def test_what_was_typed_at_a_prompt_is_never_taken_for_the_same_again():
    command = (
        "from vse_gym.estimators.anchors import ZeroSideslip\n"
        "from vse_gym.evaluation.contenders import fingerprint\n"
        "class Mine(ZeroSideslip): pass\n"
        "assert fingerprint(Mine()) == fingerprint(Mine())\n"
        "print(fingerprint(Mine()))"
    )
    first, second = (
        subprocess.run([sys.executable, "-"], input=command, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    )
    assert len(first.strip()) == 12 and first != second


def test_a_row_bears_the_digest_that_was_taken_at_the_start():
    assert contenders(["ekf"])[0].columns["tuning_digest"] == fingerprint(ExtendedKalmanFilter())


def test_attribution_makes_the_other_fields_true():
    rows = {c.name: c for c in contenders(["truth", "ekf"], attribution=True)}
    assert list(rows) == ["truth", "ekf", "ekf: velocity", "ekf: yaw", "ekf: acceleration"]
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
    own = contenders([Plain()], {f"{Plain.__module__}:Plain": (Plain(margin=1.0), "Plain-tuned (abc)")})
    assert (own[0].estimator, own[0].tuning) == (Plain(margin=1.0), "Plain-tuned (abc)")


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


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_fingerprint_belongs_to_the_class_and_to_every_setting(name):
    estimator = ESTIMATORS.make(name)
    seen = {fingerprint(estimator)}
    assert seen == {fingerprint(copy.deepcopy(estimator))}
    assert all(len(d) == 12 and int(d, 16) >= 0 for d in seen)
    for setting, value in settings_of(estimator).items():
        if isinstance(value, float):
            beside = math.nextafter(value, 2.0 if setting in ("inflation", "widening") else 0.9)  # which are at least 1
            seen.add(fingerprint(changed(estimator, {setting: beside})))
    assert len(seen) == 1 + sum(isinstance(v, float) for v in settings_of(estimator).values())
    assert not any(fingerprint(ESTIMATORS.make(other)) in seen for other in ESTIMATORS if other != name)


def test_equal_settings_have_one_fingerprint_and_a_label_shows_its_beginning():
    assert (
        fingerprint(KinematicObserver(leak=2))
        == fingerprint(KinematicObserver(leak=2.0))
        == fingerprint(KinematicObserver())
    )
    tuning = Tuning("kinematic", {"leak": 1.0})
    assert tuning.label == f"kinematic-tuned ({fingerprint(KinematicObserver(leak=1.0))[:6]})"


@dataclass(frozen=True)
class Holds(Estimator):
    """Holds a thing that is neither number nor word."""

    thing: object = field(default_factory=lambda: np.zeros(2000))

    def init(self, nominal, rng):
        return None

    def update(self, state, reading, rng):
        return None

    def estimate(self, state):
        return Estimate(0.0)


def test_a_fingerprint_sees_into_arrays_that_a_screen_would_cut_short():
    middle = np.zeros(2000)
    middle[1000] = 1.0
    assert fingerprint(Holds()) == fingerprint(Holds()) != fingerprint(replace(Holds(), thing=middle))


def test_who_cannot_be_pickled_is_known_by_what_it_prints_without_its_address():
    assert fingerprint(Holds(lambda: None)) == fingerprint(Holds(lambda: None)) != fingerprint(Holds())


class Unpickled(Estimator):
    """No dataclass, and holds what cannot be pickled."""

    init = update = estimate = None

    def __init__(self, gain):
        self.gain, self.of = gain, lambda x: x


def test_settings_beside_what_cannot_be_pickled_count():
    assert fingerprint(Unpickled(1.0)) == fingerprint(Unpickled(1.0)) != fingerprint(Unpickled(2.0))


def test_another_function_is_another_setting():
    assert fingerprint(Holds(lambda: 1)) != fingerprint(Holds(lambda: 2))
