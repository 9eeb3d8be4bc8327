"""Tables and figures from the table of runs, and from nothing else."""

from vse_gym.report.tables import LEGEND, by_cell, cells_of, markdown, on_screen, reasons, summary, write, write_tables

__all__ = ["LEGEND", "by_cell", "cells_of", "markdown", "on_screen", "reasons", "summary", "write", "write_tables"]
