"""Made-up tables of runs with a known law."""

import numpy as np
import polars as pl
import pytest

REST = {"study": "made up", "version": 1, "controller": "esc", "benign": False, "loop_ended": "", "loop_passed": True}
ZERO = ("peak_sideslip_deg", "brake_energy_kJ", "speed_lost_mps", "intervention_s", "heading_absdiff_deg")


def _table(regret, names=None, **columns):
    """A table of runs from regrets (E, S, C)."""
    estimators, seeds, cells = np.indices(regret.shape)
    names = np.array(names or [f"e{k}" for k in range(len(regret))])
    frame = {"estimator": names[estimators.ravel()], "seed": seeds.ravel(), "regret": regret.ravel().astype(float)}
    frame["cell"] = [f"c{k}" for k in cells.ravel()]
    rest = REST | {f"loop_{name}": 0.0 for name in ZERO} | columns
    return pl.DataFrame(frame).with_columns(**{k: v if isinstance(v, pl.Expr) else pl.lit(v) for k, v in rest.items()})


@pytest.fixture
def table():
    return _table
