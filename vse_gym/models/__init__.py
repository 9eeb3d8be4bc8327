"""What an estimator is told, and the models of the car that it may believe in."""

from vse_gym.models.bicycle import LinearBicycle, LinearBicycleTuning
from vse_gym.models.double_track import DoubleTrack, DoubleTrackTuning
from vse_gym.models.nominal import DataSheet, Nominal
from vse_gym.models.roll import RollTrack, RollTrackTuning
from vse_gym.models.single_track import SingleTrack, SingleTrackTuning
from vse_gym.models.tuning import ModelTuning

__all__ = [
    "DataSheet",
    "DoubleTrack",
    "DoubleTrackTuning",
    "LinearBicycle",
    "LinearBicycleTuning",
    "ModelTuning",
    "Nominal",
    "RollTrack",
    "RollTrackTuning",
    "SingleTrack",
    "SingleTrackTuning",
]
