"""Studies: many drives, one row per run."""

from vse_gym.evaluation.bench import Bench, contenders_of, evaluate
from vse_gym.evaluation.cells import Cell
from vse_gym.evaluation.contenders import POTENTIAL, Contender, contenders
from vse_gym.evaluation.files import ResultsError, read_runs, unfinished, write_runs
from vse_gym.evaluation.results import Finished, Results
from vse_gym.evaluation.runs import KEYS, TIMES, run_cell, table
from vse_gym.evaluation.study import STUDIES, Study, study_names
from vse_gym.randomise import Randomise

__all__ = [
    "KEYS",
    "POTENTIAL",
    "STUDIES",
    "TIMES",
    "Bench",
    "Cell",
    "Contender",
    "Finished",
    "Randomise",
    "Results",
    "ResultsError",
    "Study",
    "contenders",
    "contenders_of",
    "evaluate",
    "read_runs",
    "run_cell",
    "study_names",
    "table",
    "unfinished",
    "write_runs",
]
