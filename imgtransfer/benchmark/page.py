"""The benchmark's page, in one file: tables, pictures, and every method played side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from imgtransfer.benchmark.pictures import LIMIT_MM, ClipPictures
from imgtransfer.benchmark.tables import COST_HEADINGS, best_of, cost_cells, rows_of
from imgtransfer.evaluation.metrics import METRICS
from imgtransfer.evaluation.table import HEADINGS, metric_cells
from imgtransfer.report.html import Picture, write_page


def write_benchmark_page(
    path: Path, results: Mapping[str, Any], pictures: Mapping[str, Sequence[ClipPictures]]
) -> Path:
    """Write the page whole or not at all.

    Args:
        path: the file.
        results: the content of results.json.
        pictures: of each garment's test clips.
    """
    garments = []
    for name, facts in results["data"].items():
        best = best_of(results, name)
        rows = [
            (
                row["row"],
                [
                    (text, value == best[metric], _interval(row, metric))
                    for metric, text, value in zip(
                        METRICS,
                        metric_cells(row["overall"]),
                        (row["overall"][key] for key in METRICS),
                        strict=True,
                    )
                ],
                cost_cells(row),
            )
            for row in rows_of(results, name)
        ]
        drawn = [
            (one, None if one.sheet is None else Picture(one.sheet, one.name))
            for one in pictures.get(name, ())
        ]
        garments.append({"name": name, "facts": facts, "rows": rows, "pictures": drawn})
    return write_page(
        path,
        "benchmark.html",
        title="Benchmark",
        garments=garments,
        headings=("method", *HEADINGS, *COST_HEADINGS),
        machine=", ".join(f"{key} {value}" for key, value in results["machine"].items()),
        seed=results["config"]["seed"],
        limit=f"{LIMIT_MM:g}",
    )


def _interval(row: Mapping[str, Any], metric: str) -> str:
    """The ends of a mean's interval, with the digits of the mean; "" where there is none."""
    if row["interval"] is None:
        return ""
    low, high = (
        metric_cells({name: ends[end] for name, ends in row["interval"].items()})[METRICS.index(metric)]
        for end in (0, 1)
    )
    return f"{low} to {high}"
