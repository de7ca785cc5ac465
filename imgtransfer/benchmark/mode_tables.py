"""The tables of a benchmark's further sections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tabulate import tabulate

from imgtransfer.benchmark.probes import ALL, UNMOVED
from imgtransfer.benchmark.tables import row_name
from imgtransfer.evaluation.table import HEADINGS, metric_cells


def mode_tables(results: Mapping[str, Any], data: str, style: str = "simple") -> Iterator[tuple[str, str]]:
    """Title and text of each table of one garment.

    Args:
        results: the content of results.json. data: the garment's name.
        style: of `tabulate`, see `imgtransfer.benchmark.tables.overall_table`.
    """
    modes: dict[str, list[dict[str, Any]]] = {
        section: [row for row in rows if row["data"] == data] for section, rows in results["modes"].items()
    }
    if rows := modes.get("robustness"):
        angle = results["config"]["robustness"]["angle"]
        yield (
            f"how far the garment moves when one joint turns by {angle:g} degrees (mm; in brackets where the body "
            "does not move)",
            _robustness(rows, style),
        )
    if rows := modes.get("data_sizes"):
        yield "RMSE (mm) by the number of training clips", _data_sizes(rows, style)
    for method, setting in dict.fromkeys(
        (row["method"], row["setting"]) for row in modes.get("variants", ())
    ):
        chosen = [row for row in modes["variants"] if (row["method"], row["setting"]) == (method, setting)]
        cells = [
            [str(row["value"]), row_name(method, variant, network=row["network"]), *metric_cells(values)]
            for row in chosen
            for variant, values in row["overall"].items()
        ]
        yield f"{method} by {setting}", _table(cells, (setting, "method", *HEADINGS), style, texts=2)
    if rows := modes.get("rollouts"):
        lengths = list(dict.fromkeys(length for row in rows for length in row["values"]))
        cells = [
            [row["method"], *(f"{row['values'][one]:.2f}" if one in row["values"] else "" for one in lengths)]
            for row in rows
        ]
        yield (
            "errors of roll-outs from true frames (mm) by their frames",
            _table(cells, ("method", *lengths), style),
        )


def _robustness(rows: Sequence[Mapping[str, Any]], style: str) -> str:
    joints = list(rows[0]["values"])

    def cell(values: Mapping[str, float | None]) -> str:
        unmoved = values[UNMOVED]
        return f"{values[ALL]:.2f}" + ("" if unmoved is None else f" ({unmoved:.2f})")

    cells = [[row["method"], *(cell(row["values"][joint]) for joint in joints)] for row in rows]
    return _table(cells, ("method", *(f"joint {joint}" for joint in joints)), style)


def _data_sizes(rows: Sequence[Mapping[str, Any]], style: str) -> str:
    counts = sorted({row["clips"] for row in rows})
    errors: dict[str, dict[int, float]] = {}
    for row in rows:
        for variant, values in row["overall"].items():
            name = row_name(row["method"], variant, network=row["network"])
            errors.setdefault(name, {})[row["clips"]] = values["rmse_mm"]
    cells = [
        [name, *(f"{by_count[count]:.2f}" if count in by_count else "" for count in counts)]
        for name, by_count in errors.items()
    ]
    return _table(cells, ("method", *map(str, counts)), style)


def _table(rows: Sequence[Sequence[str]], headings: Sequence[str], style: str, *, texts: int = 1) -> str:
    align = ["left"] * texts + ["right"] * (len(headings) - texts)
    return tabulate(rows, headers=list(headings), disable_numparse=True, colalign=align, tablefmt=style)
