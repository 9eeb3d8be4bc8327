"""Numbers and tables as text: on a screen, in Markdown, in a web page."""

from collections.abc import Container
from html import escape
from typing import NamedTuple

from rich.table import Table


class Sheet(NamedTuple):
    """A table as text."""

    heads: list[str]
    rows: list[list[str]]


def number(value: float | None, spec: str) -> str:
    """A dash where there is none."""
    return "-" if value is None or value != value else format(value, spec)


def span(low: float | None, high: float | None, spec: str) -> str:
    """An interval; a dash where there is none."""
    return "-" if low is None or low != low else f"{number(low, spec)} to {number(high, spec)}"


def figure_with(value: float | None, low: float | None, high: float | None, spec: str) -> str:
    """A figure with its interval, where it has one."""
    known = low is not None and low == low
    return number(value, spec) + (f" ({span(low, high, spec)})" if known else "")


def on_screen(
    heads: list[str], rows: list[list[str]], title: str, whole: int = 1, words: Container[int] = (0,)
) -> Table:
    """A table for rich; the first ``whole`` columns are never wrapped, those of ``words`` begin at the left."""
    out = Table(title=title, title_justify="left", pad_edge=False)
    for k, head in enumerate(heads):
        out.add_column(head, justify="left" if k in words else "right", no_wrap=k < whole)
    for row in rows:
        out.add_row(*row)
    return out


def in_blocks(heads: list[str], rows: list[list[str]], columns: int = 5) -> list[Sheet]:
    """A table too wide for a screen as several, each with the first column and so many others."""
    starts = range(1, len(heads), columns)
    return [
        Sheet([heads[0], *heads[k : k + columns]], [[row[0], *row[k : k + columns]] for row in rows]) for k in starts
    ]


def markdown(heads: list[str], rows: list[list[str]], words: Container[int] = (0,)) -> str:
    """The same as Markdown."""
    lines = [heads, ["---" if k in words else "---:" for k in range(len(heads))], *rows]
    return "\n".join("| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in lines) + "\n"


def html(heads: list[str], rows: list[list[str]]) -> str:
    """The same for a web page."""
    top = "".join(f"<th>{escape(head)}</th>" for head in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"
