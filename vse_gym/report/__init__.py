"""Tables and figures from the table of runs, and from nothing else."""

from vse_gym.report.ranks import Ranks, ranks, significance
from vse_gym.report.statistics import Cube, Interval, cube, precision
from vse_gym.report.tables import LEGEND, by_cell, cells_of, reasons, summary
from vse_gym.report.text import in_blocks, markdown, on_screen
from vse_gym.report.writing import write, write_tables

__all__ = [
    "LEGEND",
    "Cube",
    "Interval",
    "Ranks",
    "by_cell",
    "cells_of",
    "cube",
    "in_blocks",
    "markdown",
    "on_screen",
    "precision",
    "ranks",
    "reasons",
    "significance",
    "summary",
    "write",
    "write_tables",
]
