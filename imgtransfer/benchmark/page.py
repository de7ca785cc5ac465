"""The benchmark's page, in one file: tables, pictures, and every method played side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from imgtransfer.benchmark.pictures import LIMIT_MM, ClipPictures, Strip
from imgtransfer.benchmark.tables import COST_HEADINGS, best_of, cost_cells, rows_of
from imgtransfer.evaluation.metrics import METRICS
from imgtransfer.evaluation.table import HEADINGS, metric_cells
from imgtransfer.report.html import write_page
from imgtransfer.report.page_pictures import PictureBudget, data_uri


def write_benchmark_page(
    path: Path, results: Mapping[str, Any], pictures: Mapping[str, Sequence[ClipPictures]]
) -> Path:
    """Write the page whole or not at all; pictures that would make it too large are left out, which it says.

    Args:
        path: the file.
        results: the content of results.json.
        pictures: of each garment's test clips.
    """
    garments = []
    embedded = _Embedded([clip for clips in pictures.values() for clip in clips])
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
        drawn = [(clip, embedded.sheets[clip], embedded.strips[clip]) for clip in pictures.get(name, ())]
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
        left_out=embedded.left_out(),
    )


class _Embedded:
    """What of the clips' pictures stands in the page: strips before sheets, which are files of their own as well.

    The first clips come before the last.

    Args:
        clips: of all garments.
    """

    def __init__(self, clips: Sequence[ClipPictures]) -> None:
        budget = PictureBudget()
        self.sheets: dict[ClipPictures, str | None] = {}
        self.strips: dict[ClipPictures, list[Strip]] = {}
        for clip in clips:
            fit = budget.take(*(strip.source for strip in clip.strips))
            self.strips[clip] = clip.strips if fit else []
        for clip in clips:
            source = None if clip.sheet is None else data_uri("webp", clip.sheet)
            self.sheets[clip] = source if source is not None and budget.take(source) else None

    def left_out(self) -> list[str]:
        """What does not, in words."""
        drawn = sum(clip.sheet is not None and source is None for clip, source in self.sheets.items())
        played = sum(bool(clip.strips) and not strips for clip, strips in self.strips.items())
        kinds = ((played, "the played frames"), (drawn, "the drawn frames"))
        return [f"{kind} of {count} of {len(self.sheets)} clips" for count, kind in kinds if count]


def _interval(row: Mapping[str, Any], metric: str) -> str:
    """The ends of a mean's interval, with the digits of the mean; "" where there is none."""
    if row["interval"] is None:
        return ""
    low, high = (
        metric_cells({name: ends[end] for name, ends in row["interval"].items()})[METRICS.index(metric)]
        for end in (0, 1)
    )
    return f"{low} to {high}"
