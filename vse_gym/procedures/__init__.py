"""Whole procedures: many drives that are judged together.

`vse-gym run` with the same seed and a row's amplitude or speed shows that drive alone.
"""

from vse_gym.procedures.search import Attempt, EntrySpeed, SeedSearch, entry_speed
from vse_gym.procedures.series import Fmvss126, SeriesRun, fmvss126, measure_steer_at_0_3g, series_amplitudes

__all__ = [
    "Attempt",
    "EntrySpeed",
    "Fmvss126",
    "SeedSearch",
    "SeriesRun",
    "entry_speed",
    "fmvss126",
    "measure_steer_at_0_3g",
    "series_amplitudes",
]
