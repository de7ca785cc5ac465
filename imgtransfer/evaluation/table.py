"""Metrics as text: a table for eyes, JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping

from tabulate import tabulate

from imgtransfer.evaluation.config import EvaluateConfig
from imgtransfer.evaluation.metrics import METRICS

HEADINGS = (
    "RMSE (mm)",
    "RMS (mm)",
    "Hausdorff (mm)",
    "STED",
    "STED spatial",
    "STED temporal",
    "inside body (%)",
    "crossing body (%)",
    "crossing itself (%)",
)
_FORMATS = (".2f", ".2f", ".2f", ".4f", ".4f", ".4f", ".3f", ".3f", ".3f")


def metrics_table(rows: Mapping[str, Mapping[str, float]], *, first: str = "clip") -> str:
    """A plain table with one row a name.

    Args:
        rows: by name, a mapping with the keys of `METRICS`.
        first: heading of the column of names.

    Returns:
        The heading, a rule and a line a row; the columns after the first are those of `METRICS`.
    """
    body = [[name, *metric_cells(values)] for name, values in rows.items()]
    return tabulate(
        body, headers=[first, *HEADINGS], disable_numparse=True, colalign=("left", *["right"] * len(HEADINGS))
    )


def metric_cells(values: Mapping[str, float]) -> list[str]:
    """The metrics in the order of `METRICS`, as text with sensible digits."""
    return [format(values[name], style) for name, style in zip(METRICS, _FORMATS, strict=True)]


def metrics_json(
    clips: Mapping[str, Mapping[str, float]], overall: Mapping[str, float], config: EvaluateConfig
) -> str:
    """The JSON text {"clips": {name: {...}}, "overall": {...}, "config": {...}}."""
    return json.dumps({"clips": clips, "overall": overall, "config": config.model_dump()}, indent=2)
