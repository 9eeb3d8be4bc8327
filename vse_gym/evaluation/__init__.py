"""Studies: many drives, one row per run."""

from vse_gym.evaluation.cells import Cell, Randomise
from vse_gym.evaluation.contenders import POTENTIAL, judged
from vse_gym.evaluation.runs import evaluate, run_cell, run_study, table
from vse_gym.evaluation.study import STUDIES, Study, study_names

__all__ = [
    "POTENTIAL",
    "STUDIES",
    "Cell",
    "Randomise",
    "Study",
    "evaluate",
    "judged",
    "run_cell",
    "run_study",
    "study_names",
    "table",
]
