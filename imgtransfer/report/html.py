"""One self-contained HTML page: a table of metrics and sections of pictures, nothing from elsewhere."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import cv2
import numpy as np

from imgtransfer.evaluation.metrics import METRICS
from imgtransfer.evaluation.table import HEADINGS, metric_cells
from render.files.atomic import written_whole
from render.pictures import to_uint8

_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1c2733; background: #f6f7f9; margin: 0; }
main { max-width: 1180px; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
h1 { font-size: 1.9rem; margin: 0 0 1.5rem; }
h2 { font-size: 1.25rem; margin: 0 0 .5rem; }
section { background: #fff; border: 1px solid #e1e5ea; border-radius: 10px; padding: 1.25rem 1.5rem;
  margin: 0 0 1.25rem; }
p { margin: 0 0 .9rem; max-width: 75ch; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .4rem .9rem; border-bottom: 1px solid #e1e5ea; text-align: right; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
td.best { font-weight: 700; color: #0b6b3a; }
.scroll { overflow-x: auto; }
.pictures { display: flex; flex-wrap: wrap; gap: 1rem; align-items: flex-start; }
figure { margin: 0; max-width: 100%; }
img { max-width: 100%; height: auto; display: block; border-radius: 6px; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 380px), 1fr)); gap: 1rem;
  margin-top: .8rem; }
.plot { width: 100%; height: auto; font: 11px system-ui, sans-serif; }
ul { margin: 0 0 .9rem; padding-left: 1.2rem; }
ul.wrong, tr.wrong td:last-child { color: #b3261e; }
figcaption { font-size: .85rem; color: #5a6876; margin-top: .3rem; }
"""


@dataclass(frozen=True, eq=False)
class Picture:
    """An image as `render.write_png` takes it, and the text under it."""

    image: np.ndarray
    caption: str = ""


@dataclass(frozen=True, eq=False)
class Section:
    """A titled part of the page: paragraphs (separated by an empty line), then pictures."""

    title: str
    text: str = ""
    images: Sequence[Picture] = ()


def write_report(
    out_dir: str | Path, title: str, metrics: Mapping[str, Mapping[str, float]], sections: Sequence[Section]
) -> Path:
    """Write `report.html` into `out_dir`.

    Args:
        out_dir: made where it is missing.
        title: of the page.
        metrics: by method, what `evaluate_clip` returns; a table where there is any, the best of each column
            marked (all metrics are better when small).
        sections: the rest of the page, in order. Texts are plain, not HTML.

    Returns:
        The file.
    """
    parts = [f"<h1>{escape(title)}</h1>"]
    if metrics:
        parts.append(f'<section><h2>Metrics</h2><div class="scroll">{_table(metrics)}</div></section>')
    parts += [_section(section) for section in sections]
    path = Path(out_dir) / "report.html"
    with written_whole(path) as temporary:
        temporary.write_text(page(title, "\n".join(parts)), encoding="utf-8")
    return path


def page(title: str, body: str) -> str:
    """The page around its content; `title` is plain text, `body` HTML."""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{_STYLE}</style></head>\n<body><main>\n{body}\n</main></body></html>\n"
    )


def _table(metrics: Mapping[str, Mapping[str, float]]) -> str:
    best = {name: min(values[name] for values in metrics.values()) for name in METRICS}
    head = "".join(f"<th>{escape(heading)}</th>" for heading in ("method", *HEADINGS))
    rows = []
    for method, values in metrics.items():
        cells = "".join(
            f'<td class="best">{text}</td>' if values[name] == best[name] else f"<td>{text}</td>"
            for name, text in zip(METRICS, metric_cells(values), strict=True)
        )
        rows.append(f"<tr><td>{escape(method)}</td>{cells}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _section(section: Section) -> str:
    text = "".join(f"<p>{escape(part.strip())}</p>" for part in section.text.split("\n\n") if part.strip())
    figures = "".join(
        f'<figure><img alt="{escape(picture.caption)}" src="{_data_uri(picture.image)}">'
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
        for picture in section.images
    )
    pictures = f'<div class="pictures">{figures}</div>' if figures else ""
    return f"<section><h2>{escape(section.title)}</h2>{text}{pictures}</section>"


def _data_uri(image: np.ndarray) -> str:
    png = cv2.imencode(".png", np.ascontiguousarray(to_uint8(image)[..., ::-1]))[1]
    return "data:image/png;base64," + base64.b64encode(png.tobytes()).decode()
