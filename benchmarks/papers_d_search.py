"""Tunings of the switching estimator's experiment: estimators of two schemes are searched in three ways, all alike."""

import math
from dataclasses import replace
from typing import Any

from papers_d_drives import Drive, lane_changes, short_lane_changes
from papers_search import Loss, tune_for, tuning_file

from vse_gym.catalogue import ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.evaluation.tunings import Tuning

FAR, NEAR = "", "near"  # from the limit of grip, on whose lane changes the search was made
TRAINING: dict[str, Drive] = {FAR: lane_changes, NEAR: short_lane_changes}
EVERYBODY = ("kf", "ekf", "kinematic", "switching", "fusion")
# What is infinite when an estimator of two schemes is its dynamic one alone, whose settings are in these fields
KNOBS = {"switching": "threshold", "fusion": "gain"}
DYNAMIC = ("model", "stiffness", "adaptation")
STARTS = ("from_dynamic", "from_kf")


def variant(family: str, stage: str = "") -> str:
    """Of a tuning's file."""
    return "_".join(filter(None, (family, stage)))


def alone(name: str, estimator: Any) -> Any:
    """The dynamic scheme of one that has two."""
    return replace(estimator, **{KNOBS[name]: math.inf})


def search_on(name: str, family: str, loss: Loss, budget: int) -> None:
    """Two more searches in all settings, each from a good start on, than which it can end no worse.

    The common search begins as shipped, and may miss what an estimator's parts can do. Of these one begins with what a
    search of the dynamic scheme alone finds, one with the model's settings of the Kalman filter on the same bicycle.
    """
    shipped, drive = ESTIMATORS.make(name), TRAINING[family]
    first = variant(family, "dynamic")
    tune_for("D", name, drive, loss, budget, first, begin=alone(name, shipped), within=DYNAMIC)
    own = replace(load(name, family, "dynamic").make(), **{KNOBS[name]: getattr(shipped, KNOBS[name])})
    kf: Any = load("kf", family).make()
    for start, begin in zip(STARTS, (own, replace(shipped, model=kf.model)), strict=True):
        tune_for("D", name, drive, loss, budget, variant(family, start), begin=begin)


def load(name: str, family: str, stage: str = "") -> Tuning:
    """What a search found."""
    return Tuning.load(tuning_file("D", name, variant(family, stage)))


def searches(name: str, family: str) -> list[Tuning]:
    """All of an estimator of two schemes."""
    return [load(name, family, start) for start in ("", *STARTS)]


def best_of(tunings: list[Tuning]) -> Tuning:
    """That with the least loss on the seeds of its search, which no table uses."""
    return min(tunings, key=lambda tuning: float(tuning.origin["tuned"]))


def contenders(family: str) -> dict[str, Estimator]:
    """Everybody tuned; of two schemes, each as the better of its two searches left it."""
    found = {name: load(name, family) for name in EVERYBODY}
    found |= {name: best_of(searches(name, family)) for name in KNOBS}
    return {name: found[name].make() for name in ("switching", "fusion", "kf", "ekf", "kinematic")}
