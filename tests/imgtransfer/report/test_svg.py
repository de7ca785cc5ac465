"""Line plots as SVG: where points lie, which lines are thinned, and text that is no markup."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from imgtransfer.report.svg import line_plot


def plot(lines, **options):
    return line_plot(lines, title="height, m", x_label="s", **options)


def polylines(svg):
    """(N, 2) of every line, first to last; and the colours."""
    tree = ElementTree.fromstring(svg)
    found = tree.findall(".//polyline")[::-1]
    points = [
        np.array([pair.split(",") for pair in line.get("points").split()], float).reshape(-1, 2)
        for line in found
    ]
    return points, [line.get("stroke") for line in found]


def texts(svg):
    return [element.text for element in ElementTree.fromstring(svg).iter("text")]


def test_points_lie_where_the_axes_say():
    svg = plot({"a": ([0, 1, 4], [0, 4, 2])})
    (points,), _ = polylines(svg)
    # The picture is 560 x 210; the axes go from (52, 176) to (548, 30), and end at x = 4 and y = 4.
    np.testing.assert_allclose(points, [[52, 176], [52 + 496 / 4, 30], [548, 103]], atol=0.051)
    assert [text for text in texts(svg) if re.fullmatch(r"\d", text)][:5] == ["0", "1", "2", "3", "4"]


@pytest.mark.parametrize(("highest", "top"), [
    (0.9, 1), (1.0, 1), (1.01, 2), (2.5, 4), (5, 6), (7, 8), (8.5, 10), (0.0003, 0.0004), (130, 200), (1e6, 1e6),
])  # fmt: skip
def test_the_axis_ends_at_the_next_round_number(highest, top):
    (points,), _ = polylines(plot({"a": ([0, 1], [0, highest])}))
    assert points[1, 1] == pytest.approx(176 - 146 * highest / top, abs=0.051)


def test_all_lines_share_the_axes_and_have_their_own_colours():
    lines = {"low": ([0, 1], [1, 1]), "high": ([0, 2], [4, 4]), "zero": ([0, 2], [0, 0])}
    points, colours = polylines(plot(lines))
    assert [line[0, 1] for line in points] == [176 - 146 / 4, 30, 176]
    assert [line[-1, 0] for line in points] == [300, 548, 548]
    assert len(set(colours)) == 3


@pytest.mark.parametrize("count", [280, 281, 5000])
def test_long_lines_are_thinned_to_their_peaks(count):
    y = np.zeros(count)
    peaks = [0, count // 3, count - 1]
    y[peaks] = [1.0, 4.0, 2.0]
    (points,), _ = polylines(plot({"a": (np.arange(count), y)}))
    assert len(points) == min(count, 280)
    assert (np.diff(points[:, 0]) >= 0).all()
    heights = (176 - points[:, 1]) / 146 * 4
    assert sorted(heights[heights > 0.01].round(2).tolist()) == [1, 2, 4]


def test_marks_are_vertical_lines():
    svg = plot({"a": ([0, 10], [1, 1])}, marks=[2.5, 10])
    marks = [
        path.get("d") for path in ElementTree.fromstring(svg).iter("path") if path.get("stroke-dasharray")
    ]
    assert marks == [f"M{52 + 496 / 4:.1f} 176.0V30", "M548.0 176.0V30"]


def test_names_and_titles_are_text():
    svg = line_plot({"a<b> & c": ([0, 1], [0, 1])}, title='"x" < y', x_label="</svg>")
    words = texts(svg)  # parses, so nothing was taken for markup
    assert {"a<b> & c", '"x" < y', "</svg>"} <= set(words)
    assert ElementTree.fromstring(svg).get("aria-label") == '"x" < y'


@pytest.mark.parametrize("lines", [
    {}, {"a": ([], [])}, {"a": ([0], [0])}, {"a": ([0, 0], [0, 3])}, {"a": ([3], [2]), "b": ([], [])},
])  # fmt: skip
def test_little_or_nothing_to_draw_still_is_a_plot(lines):
    points, _ = polylines(plot(lines))
    assert [len(line) for line in points] == [len(x) for x, _ in lines.values()]
    assert all(np.isfinite(line).all() for line in points)
