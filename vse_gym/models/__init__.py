"""What an estimator is told, and the models of the car that it may believe in."""

from vse_gym.models.nominal import DataSheet, Nominal
from vse_gym.models.single_track import SingleTrack, SingleTrackTuning

__all__ = ["DataSheet", "Nominal", "SingleTrack", "SingleTrackTuning"]
