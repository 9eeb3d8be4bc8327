"""What a report says, in order: each table with the sentences that it needs."""

from typing import NamedTuple

import polars as pl

from vse_gym.report import details
from vse_gym.report.statistics import complete_seeds, whole
from vse_gym.report.tables import BASELINE, by_cell, cells_of
from vse_gym.report.text import Sheet

RANKING = (
    "Regret is what it costs to drive by the estimate and not by true states, 0 to 14; each cell counts alike. "
    "{counted} "
    "Intervals draw these seeds anew, the same for all estimators and cells (bootstrap, BCa, widened for few seeds); "
    "'other cells too' draws the cells anew as well: would it hold on other drives of this kind? They were chosen, not "
    "drawn at random, and fewer than four say nothing of others. With fewer than six seeds a mean's interval is "
    "Student's, and other figures have none. "
    "Estimators of one letter are tied: none is worse than the group's best by more than chance, at 5 % for all pairs "
    "together (sign flips of paired differences; fewer than six seeds tell nobody apart). So one whose regret scatters "
    "may be tied where a steadier one with less is not, and two of different letters need not differ: their ranks, "
    "intervals that hold for all at once, overlap then. "
    "A drive that ends badly counts 14; where that happens in about 1 % of runs, intervals and ties are too sure, for "
    "no method sees a tail that was not drawn, and the true mean may lie above its interval. "
    "Interquartile mean: of the middle half of all runs. "
    f"Better than {BASELINE}: share of runs with less regret at the same cell and seed, ties half. "
    "Where all seeds have the same share, its interval is that of so many wins in so many seeds (Clopper, Pearson). "
    "An interval without width means that no seed differed, not that none could. "
    "`none` is the car without stability control: the potential, not an estimator, never ranked."
)
DIFFERENCES = (
    "Mean over cells, paired by seed, with 95 % intervals. Drives that ended early count as far as they went; "
    "regret alone counts them as the worst."
)
CONSISTENCY = (
    "In shadow: every estimator hears the drive that the controller makes with true states. NEES and NIS are over "
    "their degrees of freedom, so 1 is right, more is too sure of itself."
)
GAIN = (
    "'More' is a mean paired difference to the same drive without stability control, with its interval; benign drives "
    "are not in it. Drives that ended early count as far as they went."
)
BENIGN = "Drives that need no help. The truth's row is what the controller does of its own accord."
FOUND = (
    "Beside the motion, in shadow; means over drives. A stiffness is compared with the true axle's force over its slip "
    "angle, where that is at least 0.3 deg. The data sheet is what anybody believes who finds nothing: its mass, its "
    "tyres, a friction of 0.9 and no roll."
)
ATTRIBUTION = "Mean regret if the controller sees only a part of the estimate, and of the rest the true states."


class Section(NamedTuple):
    """A table with its title and what has to be known."""

    title: str
    text: str
    sheet: Sheet


def sections(runs: pl.DataFrame, summarised: pl.DataFrame) -> list[Section]:
    """All that the table of runs has something to say about."""
    found = (
        ("Who lets the controller do its work", RANKING.format(counted=_counted(runs)), cells_of(summarised)),
        ("Regret by cell", "Mean over seeds.", by_cell(runs)),
        ("Drives that ended early", "Each counts 14.", details.ended_early(runs)),
        ("Attribution", ATTRIBUTION, details.attribution(runs)),
        ("Differences to the drive with true states", DIFFERENCES, details.differences(runs)),
        ("Gain and price of control", GAIN, details.gain_and_price(runs)),
        ("Gain by cell", "Drives that ended badly, mean peak sideslip.", details.gain_by_cell(runs)),
        ("Price by cell", "Mean brake energy, mean speed lost.", details.price_by_cell(runs)),
        ("False interventions", BENIGN, details.false_interventions(runs)),
        ("Errors and consistency", CONSISTENCY, details.consistency(summarised)),
        ("What else they find", FOUND, details.found(runs)),
        ("Tunings", "The file of settings that each estimator was given.", details.tunings(runs)),
    )
    return [Section(title, text, sheet) for title, text, sheet in found if sheet is not None]


def _counted(runs: pl.DataFrame) -> str:
    """Which seeds the figures are of."""
    runs = whole(runs)
    there, counted = runs["seed"].n_unique(), len(complete_seeds(runs))
    if not counted:
        return "No seed was driven in every cell: means are of what there is, and there are no intervals."
    if counted == 1:
        return "One seed gives no intervals."
    return f"Counted are the {counted} seeds that every cell has" + (f", of {there} begun." if there > counted else ".")
