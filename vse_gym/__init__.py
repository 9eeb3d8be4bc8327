"""Vehicle state estimation, judged by the drive: a Gymnasium environment and an estimator-in-the-loop benchmark."""

from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from vse_gym.env import StabilityControlEnv, register_environments
from vse_gym.estimators.base import Estimator
from vse_gym.models import Nominal
from vse_gym.scenarios import Scenario, scenario
from vse_gym.simulation import Simulation, rollout
from vse_gym.types import BrakeDemand, Estimate, Reading

if TYPE_CHECKING:
    from vse_gym.evaluation import Study, evaluate

try:
    __version__ = version("vse-gym")
except PackageNotFoundError:  # a source tree that is not installed
    __version__ = "0.0.0"

__all__ = [
    "BrakeDemand",
    "Estimate",
    "Estimator",
    "Nominal",
    "Reading",
    "Scenario",
    "Simulation",
    "StabilityControlEnv",
    "Study",
    "evaluate",
    "rollout",
    "scenario",
]

register_environments()


def __getattr__(name: str) -> Any:
    if name in ("Study", "evaluate"):  # polars and joblib are imported by whoever evaluates
        from vse_gym import evaluation

        return getattr(evaluation, name)
    raise AttributeError(f"module 'vse_gym' has no attribute {name!r}")
