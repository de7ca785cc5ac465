"""Ablations as tables: means over the seeds and their spread."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import mean, stdev
from typing import Any

from tabulate import tabulate

from imgtransfer.benchmark.tables import FUSED
from imgtransfer.deformers.registry import NETWORK

METRICS = {
    "rmse_mm": "RMSE (mm)",
    "hausdorff_mm": "Hausdorff (mm)",
    "sted": "STED",
    "crossing_percent": "crossing body (%)",
}
_DIGITS = {"rmse_mm": 2, "hausdorff_mm": 1, "sted": 4, "crossing_percent": 3}


def markdown(results: Mapping[str, Any]) -> str:
    """Every table of a results.json, each below what it was made with."""
    parts = []
    for name, table in results["tables"].items():
        config, data = table["config"], table["data"]
        steps = config["method"]["training"]["steps"]
        parts += [
            f"## {name}{': ' + config['title'] if config['title'] else ''}",
            "",
            f"{len(data['train'])} clips to train on, {len(data['test'])} to measure ({data['source']}); "
            f"{steps} steps; seeds {', '.join(map(str, config['seeds']))}; data {data['fingerprint'][:12]}",
            "",
            ablation_table(table, "github"),
            "",
        ]
    return "\n".join(parts)


def ablation_table(table: Mapping[str, Any], style: str = "simple") -> str:
    """One table: rows by label, mean ± standard deviation over the seeds.

    The networks' vertices are those after the fusion; methods on vertices have a row before and one after it.

    Args:
        table: one of "tables" in results.json. style: of `tabulate`.
    """
    rows = []
    others = {
        row["label"]
        for row in table["config"]["rows"]
        if (row["method"] or {}).get("name", NETWORK) != NETWORK
    }
    for label, by_seed in table["rows"].items():
        variants = ("position_only", FUSED) if label in others else (FUSED,)
        for variant in variants:
            runs = [run for run in by_seed.values() if variant in run["overall"]]
            if not runs:
                continue
            shown = f"{label} + fusion" if label in others and variant == FUSED else label
            cells = [_spread([run["overall"][variant][key] for run in runs], _DIGITS[key]) for key in METRICS]
            seconds = [run["fit_seconds"] for run in runs if run["fit_seconds"] is not None]
            rows.append([shown, *cells, f"{mean(seconds):.0f}" if seconds else "", str(len(runs))])
    headings = ["row", *METRICS.values(), "training (s)", "runs"]
    align = ["left", *["right"] * (len(headings) - 1)]
    return tabulate(rows, headers=headings, disable_numparse=True, colalign=align, tablefmt=style)


def _spread(values: list[float], digits: int) -> str:
    """ "1.23 ± 0.04"; of a single value no spread is known."""
    text = f"{mean(values):.{digits}f}"
    return text if len(values) < 2 else f"{text} ± {stdev(values):.{digits}f}"
