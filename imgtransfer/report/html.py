"""One self-contained HTML page: a table of metrics and sections of pictures, nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import jinja2
import numpy as np

from imgtransfer.evaluation.metrics import METRICS
from imgtransfer.evaluation.table import HEADINGS, metric_cells
from imgtransfer.report.page_pictures import fitting_uris
from render.files.atomic import written_whole
from render.pictures import to_uint8


@dataclass(frozen=True, eq=False)
class Picture:
    """An image (H, W, 3) as `render.write_png` takes it, and the text below it, plain."""

    image: np.ndarray
    caption: str = ""


@dataclass(frozen=True, eq=False)
class Section:
    """A titled part of the page: paragraphs (separated by an empty line), then pictures."""

    title: str
    text: str = ""
    images: Sequence[Picture] = ()

    @property
    def paragraphs(self) -> list[str]:
        """Those of `text`, without empty ones."""
        return [part.strip() for part in self.text.split("\n\n") if part.strip()]


def write_report(
    out_dir: str | Path, title: str, metrics: Mapping[str, Mapping[str, float]], sections: Sequence[Section]
) -> Path:
    """Write `report.html` into `out_dir`.

    Args:
        out_dir: made where it is missing.
        title: of the page.
        metrics: by method, what `evaluate_clip` returns; a table where there is any, the best of each column
            marked (all metrics are better when small).
        sections: the rest of the page, in order. Texts are plain, not HTML. Pictures that are too many bytes
            for a page lose some sharpness; where that is not enough, all are made smaller, and the page says so.

    Returns:
        The file.
    """
    best = {name: min(values[name] for values in metrics.values()) for name in METRICS} if metrics else {}
    rows = [
        (
            method,
            list(zip(metric_cells(values), [values[name] == best[name] for name in METRICS], strict=True)),
        )
        for method, values in metrics.items()
    ]
    images = [to_uint8(picture.image) for section in sections for picture in section.images]
    sources, factor = fitting_uris(images, ("png", "webp"))
    left = iter(sources)
    content = {
        "headings": ("method", *HEADINGS),
        "rows": rows,
        "sections": [(one, [(picture.caption, next(left)) for picture in one.images]) for one in sections],
        "percent": round(100 * factor),
    }
    return write_page(Path(out_dir) / "report.html", "report.html", title=title, **content)


def write_page(path: Path, template: str, **content: object) -> Path:
    """Write a page whole or not at all.

    Args:
        path: the file.
        template: a file of `templates/`.
        content: what the template names; texts are plain, and escaped.

    Returns:
        The file.
    """
    with written_whole(path) as temporary:
        temporary.write_text(_templates().get_template(template).render(content), encoding="utf-8")
    return path


@cache
def _templates() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader(__package__),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
