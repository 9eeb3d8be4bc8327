"""Tunings files: what is written is what is read, and what cannot be is refused with a sentence."""

import math
from operator import attrgetter

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.gaussian import ExtendedKalmanFilter, Gate, ToldExtendedKalmanFilter
from vse_gym.estimators.kinematic import KinematicObserver
from vse_gym.evaluation.contenders import fingerprint
from vse_gym.evaluation.tunings import Tuning, changed, load_folder, ranges
from vse_gym.models import DoubleTrackTuning, SingleTrackTuning
from vse_gym.models.tuning import tunable

numbers = st.floats(min_value=0.0)  # NaN and negative ones are refused, everything else must come back
TUNED = st.fixed_dictionaries(dict.fromkeys(ranges(ExtendedKalmanFilter()), numbers))
words = st.text(st.characters(codec="utf-8"))
reuses_the_folder = settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])


@reuses_the_folder
@given(TUNED, st.floats(0, 1, exclude_min=True), st.booleans())
def test_a_written_tuning_reads_back_to_an_equal_estimator(tmp_path, values, passing, knows):
    more = {"gate.passing": passing, "model.brake_moment": knows}
    estimator = changed(ExtendedKalmanFilter(), values | more)
    Tuning.of("ekf", estimator, {}).save(tmp_path / "ekf.toml")
    read = Tuning.load(tmp_path / "ekf.toml")
    assert read.make() == estimator
    assert read.digest == fingerprint(estimator)
    assert math.copysign(1, read.make().model.vx_noise) == math.copysign(1, estimator.model.vx_noise)  # zeros too


@reuses_the_folder
@given(words, st.integers(), numbers, st.booleans())
def test_the_origin_comes_back_whatever_it_says(tmp_path, word, whole, number, truth):
    origin = {"word": word, "nested": {"whole": whole, "deeper": {"number": number, "truth": truth}}}
    Tuning("kinematic", {}, origin).save(tmp_path / "kinematic.toml")
    assert Tuning.load(tmp_path / "kinematic.toml").origin == origin


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_of_the_catalogue_can_be_written_down_and_made_again(name, tmp_path):
    estimator = ESTIMATORS.make(name)
    Tuning.of(name, estimator, {}).save(tmp_path / "a.toml")
    assert Tuning.load(tmp_path / "a.toml").make() == estimator


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_range_holds_the_default_of_the_estimator_that_has_it(name):
    estimator = ESTIMATORS.make(name)
    for setting, (low, high) in ranges(estimator).items():
        assert 0 <= low <= attrgetter(setting)(estimator) <= high < math.inf, setting
        assert low < high


@pytest.mark.parametrize("default", [0.05, 4.0])
def test_a_default_outside_its_range_is_refused_where_it_is_written(default):
    with pytest.raises(ValueError, match="hold the default"):
        tunable(default, 0.1, 3.0)


def test_what_is_searched_is_found_in_nested_settings_and_nothing_else_is():
    found = ranges(ExtendedKalmanFilter())
    assert found["model.ay_error"] == (0.3, 8.0)
    assert not {"model.brake_moment", "gate.passing", "model.vx_prior"} & found.keys()
    assert "alpha" in ranges(ESTIMATORS.make("pf_cauchy_gaussian"))
    assert "alpha" not in ranges(ESTIMATORS.make("pf"))  # which does not read it
    assert "size" not in ranges(ESTIMATORS.make("pf"))  # cost is not tuned


BAD_FILES = {
    "unknown estimator": ("estimator = 'eckf'\n[settings]", KeyError, "no estimator named 'eckf'; known: truth"),
    "unknown setting": ("estimator = 'ekf'\n[settings]\nsize = 3", TypeError, "no setting 'size'; it has model, gate"),
    "unknown nested": (
        "estimator = 'ekf'\n[settings.model]\nvxnoise = 1.0",
        TypeError,
        "no setting 'vxnoise'; it",
    ),
    "table for a number": ("estimator = 'kinematic'\n[settings.leak]\nslow = 1.0", TypeError, "'slow'; it has none"),
    "number for a table": ("estimator = 'ekf'\n[settings]\nmodel = 1.0", TypeError, "'model' must be of the kind"),
    "word for a number": ("estimator = 'kinematic'\n[settings]\nleak = '2'", TypeError, "'leak' must be of the kind"),
    "fraction for a whole": (
        "estimator = 'pf'\n[settings]\nsize = 2.5",
        TypeError,
        "'size' must be of the kind",
    ),
    "truth for a number": ("estimator = 'kinematic'\n[settings]\nleak = true", TypeError, "'leak' must be of the kind"),
    "impossible": ("estimator = 'pf'\n[settings]\nsize = 1", ValueError, "size must be at least 2"),
    "no settings": ("estimator = 'ekf'", ValueError, r"\[settings\] and \[origin\]; this one has estimator"),
    "empty": ("", ValueError, "this one has nothing"),
    "more": ("estimator = 'ekf'\ncolour = 1\n[settings]", ValueError, "colour"),
    "no TOML": ("estimator: ekf", ValueError, "line 1"),
}


@pytest.mark.parametrize(("text", "kind", "sentence"), BAD_FILES.values(), ids=BAD_FILES)
def test_a_file_that_cannot_be_is_refused_with_a_sentence_that_names_it(tmp_path, text, kind, sentence):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(kind, match=sentence) as refused:
        Tuning.load(path)
    assert str(path) in str(refused.value)


def test_what_a_file_cannot_hold_is_not_written_as_something_else():
    other = ExtendedKalmanFilter(model=DoubleTrackTuning())
    with pytest.raises(ValueError, match="is not 'ekf' with numbers and words changed"):
        Tuning.of("ekf", other, {})
    with pytest.raises(ValueError, match="is not 'ekf'"):
        Tuning.of("ekf", ToldExtendedKalmanFilter(), {})


def test_a_file_that_names_few_settings_leaves_the_others_as_they_are(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("estimator = 'ekf'\n[settings.model]\nay_error = 2\n[settings.gate]\npassing = 0.99")
    assert Tuning.load(path).make() == ExtendedKalmanFilter(SingleTrackTuning(ay_error=2.0), gate=Gate(0.99))


def test_a_filter_of_one_s_own_is_named_by_its_module_and_class(tmp_path):
    name = "vse_gym.estimators.kinematic:KinematicObserver"
    Tuning(name, {"leak": 1.5}).save(tmp_path / "mine.toml")
    assert Tuning.load(tmp_path / "mine.toml").make() == KinematicObserver(leak=1.5)
    for wrong in ("no_such_module:X", "vse_gym.estimators.kinematic:X"):
        with pytest.raises(ValueError, match=f"estimator '{wrong}' cannot be had"):
            Tuning(wrong, {})


def test_a_folder_gives_each_estimator_its_tuning(tmp_path):
    for name, values in (("ekf", {"model.ay_error": 2.0}), ("kinematic", {"leak": 1.0})):
        Tuning(name, values).save(tmp_path / "deep" / f"{name}.toml")
    found = load_folder(tmp_path / "deep")
    assert {name: t.make() for name, t in found.items()} == {
        "ekf": ExtendedKalmanFilter(SingleTrackTuning(ay_error=2.0)),
        "kinematic": KinematicObserver(leak=1.0),
    }
    assert load_folder(tmp_path / "deep" / "ekf.toml").keys() == {"ekf"}
    assert {path.suffix for path in (tmp_path / "deep").iterdir()} == {".toml"}  # no half-written file stays


def test_a_folder_without_tunings_or_with_two_of_one_estimator_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no tunings file"):
        load_folder(tmp_path)
    for file in ("a.toml", "b.toml"):
        Tuning("ekf", {}).save(tmp_path / file)
    with pytest.raises(ValueError, match="two tunings files of 'ekf'"):
        load_folder(tmp_path)
    with pytest.raises(FileNotFoundError, match="there is no tunings file or folder "):
        load_folder(tmp_path / "nowhere.toml")


SHIPPED = load_folder("published")


@pytest.mark.parametrize("name", SHIPPED)
def test_tunings_that_ship_were_all_found_by_the_same_command(name):
    origin = SHIPPED[name].origin
    assert origin["command"] == f"vse-gym tune {name} --budget 60 --study training-v2 --seeds 4 --seed 0"
    alike = ("budget", "cells", "optuna", "sampler_seed", "study", "study_version")
    first = next(iter(SHIPPED.values())).origin
    assert [origin[key] for key in alike] == [first[key] for key in alike]
    assert not origin["interrupted"]
    assert origin["validation"]["difference"]["mean"] <= 0
