"""The benchmark's results as text: for eyes, for Markdown, for LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tabulate import tabulate

from imgtransfer.evaluation.metrics import METRICS
from imgtransfer.evaluation.table import HEADINGS, metric_cells

COST_HEADINGS = ("parameters", "training (s)", "ms a frame")
FUSED = "fused"


def row_name(label: str, variant: str, *, network: bool) -> str:
    """What a table calls a variant of a method: the fusion is a part of `image_transfer`, and an addition to others."""
    if network:
        return label if variant == FUSED else f"{label}, position maps alone"
    return f"{label} + fusion" if variant == FUSED else label


def rows_of(results: Mapping[str, Any], data: str) -> Iterator[dict[str, Any]]:
    """The rows of one garment's tables, of the "results" in results.json."""
    return (row for row in results["results"] if row["data"] == data)


def overall_table(results: Mapping[str, Any], data: str, style: str = "simple") -> str:
    """Every method on one garment: the metrics' means with their 95 % intervals, and what it costs.

    Args:
        results: the content of results.json. data: the garment's name.
        style: of `tabulate`: simple, github, latex_booktabs.
    """
    rows = []
    for row in rows_of(results, data):
        cells = metric_cells(row["overall"])
        low, high = (
            metric_cells({name: ends[end] for name, ends in row["interval"].items()})
            if row["interval"]
            else []
            for end in (0, 1)
        )
        if low:
            cells = [f"{cell} [{a}, {b}]" for cell, a, b in zip(cells, low, high, strict=True)]
        rows.append([row["row"], *cells, *cost_cells(row)])
    return _table(rows, "method", (*HEADINGS, *COST_HEADINGS), style)


def clips_table(results: Mapping[str, Any], data: str, style: str = "simple") -> str:
    """Every method on every clip of one garment."""
    rows = [
        [clip, row["row"], *metric_cells(values)]
        for row in rows_of(results, data)
        for clip, values in row["clips"].items()
    ]
    rows.sort(key=lambda cells: cells[0])
    return _table(rows, "clip", ("method", *HEADINGS), style)


def best_of(results: Mapping[str, Any], data: str) -> dict[str, float]:
    """The least value of each metric over the methods; all are better when small."""
    rows = list(rows_of(results, data))
    return {name: min(row["overall"][name] for row in rows) for name in METRICS} if rows else {}


def cost_cells(row: Mapping[str, Any]) -> list[str]:
    """A row's parameters, seconds of training and milliseconds by stage, as text; "" where they are not known."""
    stages = ", ".join(f"{stage} {value:.1f}" for stage, value in row["ms"].items())
    count, seconds = row["parameters"], row["fit_seconds"]
    return ["" if count is None else f"{count:,}", "" if seconds is None else f"{seconds:.0f}", stages]


def _table(rows: Sequence[Sequence[str]], first: str, headings: Sequence[str], style: str) -> str:
    texts = 2 if headings[0] == "method" else 1
    align = ["left"] * texts + ["right"] * (1 + len(headings) - texts)
    return tabulate(rows, headers=[first, *headings], disable_numparse=True, colalign=align, tablefmt=style)
