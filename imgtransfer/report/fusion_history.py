"""What a fusion reports, for eyes: a table of the residuals, and a picture of how they fell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan, sqrt
from typing import Any

import numpy as np
from tabulate import tabulate

from fusion import FusionConfig
from fusion.stages import edge_weights, normal_weights
from imgtransfer.report.pictures import curve_picture
from render import contact_sheet

History = Mapping[str, Mapping[str, Sequence[float]]]  # stage -> term -> one value an iteration

_FAULTS = 5  # that are printed
STAGES = {"edge": "edge lengths", "normal": "normals"}
# Name in the table, its unit, and how the report's number becomes it.
TERMS = {
    "edge_length_m2": ("edge length off the template's, rms", "mm", lambda value: 1000 * sqrt(value)),
    "displacement_m2": ("distance from the stage's start, rms", "mm", lambda value: 1000 * sqrt(value)),
    "normal_rendering": ("rendered normal off the map's, mean", "", float),
    "normal_consistency": ("1 - cos between neighbours' normals, mean", "", float),
    "collision_m": ("depth in the obstacle, mean over vertices", "mm", lambda value: 1000 * value),
}


def fusion_table(report: Mapping[str, Any]) -> str:
    """The report as a few lines: every term's residual at start and end, what is odd about the maps, inside, time."""
    rows = []
    for stage, ends in report["terms"].items():
        for term, start in ends["start"].items():
            name, unit, shown = TERMS[term]
            rows.append([STAGES[stage], name, shown(start), shown(ends["end"][term]), unit])
    lines = (
        [tabulate(rows, headers=["stage", "residual", "start", "end", ""], floatfmt=".3g")] if rows else []
    )
    lines.append(f"unseen   {report['unseen_percent']:.2f} % of the vertices are in no view")
    lines += map_lines(report)
    if "penetration_percent" in report:
        inside = report["penetration_percent"]
        lines.append(
            f"inside   {inside['before_clearance']:.3f} % of the vertices, {inside['after']:.3f} % after the clean-up"
        )
    crossing = f"{report['self_crossing_percent']:.3f} % of the edges pass through the garment itself"
    if "crossing_percent" in report:
        body = report["crossing_percent"]
        crossing = (
            f"{body['before_clearance']:.3f} % of the edges with the body, {body['after']:.3f} % after the "
        )
        crossing += f"clean-up; {report['self_crossing_percent']:.3f} % with the garment itself"
    lines.append(f"crossing {crossing}")
    if "acceleration_m_s2" in report:
        motion = report["acceleration_m_s2"]
        lines.append(
            f"motion   {motion['before_smoothing']:.3g} m/s² mean acceleration, {motion['after']:.3g} m/s² smoothed"
        )
    stages = ", ".join(f"{name} {seconds:.2f}" for name, seconds in report["stage_seconds"].items())
    lines.append(f"seconds  {report['seconds']:.2f} for {report['frames']} frames: {stages}")
    return "\n".join(lines)


def map_lines(report: Mapping[str, Any]) -> list[str]:
    """What the fusion found wrong with the position maps, a line each; none where all of them hold together."""
    lines = []
    if report.get("left_out_percent"):
        percent = f"{report['left_out_percent']:.2g}"
        lines.append(f"left out {percent} % of the pixels of the position maps do not fit their neighbours")
    faults = report.get("faults", [])
    lines += [f"fault    {fault['text']}" for fault in faults[:_FAULTS]]
    if len(faults) > _FAULTS:
        lines.append(f"         and {len(faults) - _FAULTS} more, see the report")
    return lines


def history_picture(history: History, config: FusionConfig) -> np.ndarray:
    """A curve a term and the total over the iterations, a panel a stage: what each adds to what is minimised.

    Args:
        history: `report["history"]` of a fusion: terms unweighted, in metres, and the weighted total.
        config: with the weights that it had.

    Returns:
        (H, W, 3) uint8.
    """
    weights = {"edge": edge_weights(config), "normal": normal_weights(config)}
    panels = []
    for stage, terms in history.items():
        curves = {}
        for term in sorted(terms, key=["total", *TERMS].index):
            added = weights[stage].get(term, 1.0) * np.asarray(terms[term])
            name = term.removesuffix("_m").removesuffix("_m2").replace("_", " ")
            curves[name] = (range(len(added)), [float(value) or nan for value in added])  # no 0 on the axis
        title = f"stage: {STAGES[stage]}"
        panels.append(curve_picture(curves, title=title, x_label="iteration", y_label="weighted residual"))
    return contact_sheet([panels])
