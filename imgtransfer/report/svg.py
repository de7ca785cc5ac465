"""Small line plots as SVG text: sharp at any size and a few kilobytes each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

_WIDTH, _HEIGHT = 560, 210
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 30, 34
# Of the page, so that they suit light and dark; what stands behind the comma where the plot is alone.
_COLOURS = (
    "var(--plot-1, #2a68ad)",
    "var(--plot-2, #b04c12)",
    "var(--plot-3, #676c74)",
    "var(--plot-4, #217148)",
)
_INK, _SOFT, _GRID, _MARK = (
    "var(--ink, #1c2733)",
    "var(--soft, #55626f)",
    "var(--line, #e1e5ea)",
    "var(--wrong, #b3261e)",
)
_POINTS = 280  # of a line at most


def line_plot(
    lines: Mapping[str, tuple[Sequence[float] | np.ndarray, Sequence[float] | np.ndarray]],
    *,
    title: str,
    x_label: str,
    marks: Sequence[float] = (),
) -> str:
    """Lines over a common axis that starts at 0.

    Args:
        lines: by name, x and y of the same length; of long ones the greatest y of each part is drawn.
        title: with the unit of y. x_label: with the unit of x.
        marks: x at which a thin vertical line is drawn.

    Returns:
        An <svg> element.
    """
    drawn = {name: _thinned(np.asarray(x, float), np.asarray(y, float)) for name, (x, y) in lines.items()}
    right = max((x.max() for x, _ in drawn.values() if len(x)), default=0.0) or 1.0
    top = _ceiling(max((y.max() for _, y in drawn.values() if len(y)), default=0.0))

    def place(x: float, y: float) -> tuple[float, float]:
        across = _LEFT + x / right * (_WIDTH - _LEFT - _RIGHT)
        return across, _HEIGHT - _BOTTOM - y / top * (_HEIGHT - _TOP - _BOTTOM)

    parts = [f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{escape(title)}" class="plot">']
    parts.append(_text(_LEFT, 16, title, "start", bold=True))
    for tick in np.linspace(0, top, 5):
        x, y = place(0, tick)
        parts.append(f'<path d="M{x:.1f} {y:.1f}H{_WIDTH - _RIGHT}" stroke="{_GRID}"/>')
        parts.append(_text(x - 6, y + 4, f"{tick:.3g}", "end"))
    for tick in np.arange(0, right * 1.0001, _ceiling(right / 8)):
        x, y = place(tick, 0)
        parts.append(_text(x, y + 16, f"{tick:.3g}", "middle"))
    parts.append(_text(_WIDTH - _RIGHT, _HEIGHT - 4, x_label, "end"))
    for mark in marks:
        x, y = place(mark, 0)
        parts.append(f'<path d="M{x:.1f} {y:.1f}V{_TOP}" stroke="{_MARK}" stroke-dasharray="3 3"/>')
    at = float(_WIDTH - _RIGHT)
    for (name, (xs, ys)), colour in reversed(list(zip(drawn.items(), _COLOURS, strict=False))):
        points = " ".join("{:.1f},{:.1f}".format(*place(x, y)) for x, y in zip(xs, ys, strict=True))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        parts.append(_text(at, 16, name, "end", colour=colour))
        at -= 7.0 * len(name) + 16
    return "".join(parts) + "</svg>"


def _thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if len(x) <= _POINTS:
        return x, y
    bounds = np.linspace(0, len(x), _POINTS + 1).astype(int)[:-1]
    return x[bounds], np.maximum.reduceat(y, bounds)


def _ceiling(value: float) -> float:
    """A round number that is not less."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next((step * power for step in (1, 2, 4, 6, 8) if step * power >= value), 10 * power))


def _text(x: float, y: float, text: str, anchor: str, *, bold: bool = False, colour: str = _SOFT) -> str:
    weight = ' font-weight="600"' if bold else ""
    colour = _INK if bold else colour
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}"{weight}>{escape(text)}</text>'
    )
