"""Pictures of a test clip: the truth and every method in the same frames, with their errors as colours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.pipeline.predictions import predicted_vertices
from imgtransfer.report.page_pictures import data_uri
from imgtransfer.report.pictures import CLOTH, SKIN, ShadedMesh, mesh_pictures, picture_camera, with_scale
from render import contact_sheet
from render.pictures import heat_colours

LIMIT_MM = 50.0  # what the brightest colour stands for, in every picture, so that they can be compared
_DRAWN, _PLAYED = (300, 220), (180, 136)  # (height, width) in pixels
_QUALITY = 70  # of what is played: a frame is then 2 kB, at which errors are still seen
TRUTH = "truth"


@dataclass(frozen=True)
class Candidate:
    """What predicted a clip, and where.

    Args:
        row: its name in tables. file: with its vertices.
    """

    row: str
    file: Path


@dataclass(frozen=True)
class Strip:
    """Frames of one method beside each other in one image, for the page to play.

    Args:
        row: what the method is called. source: a URI with the image.
    """

    row: str
    source: str


@dataclass(frozen=True, eq=False)
class ClipPictures:
    """What is drawn of a clip.

    Args:
        name: the clip's.
        sheet: (H, W, 3) uint8, a row a method and a column a frame; None where no frame is shown.
        strips: of the truth and every method; none where no frame is played.
        numbers: of the frames in a strip. size: (height, width) of each, pixels.
    """

    name: str
    sheet: np.ndarray | None
    strips: list[Strip]
    numbers: list[int]
    size: tuple[int, int] = _PLAYED


def clip_pictures(clip: Clip, candidates: Sequence[Candidate], *, shown: int, played: int) -> ClipPictures:
    """Draw a clip as every method has it.

    Args:
        clip: with the true garment.
        candidates: the methods.
        shown, played: how many frames, evenly spread, for the sheet and for the page.

    Raises:
        InputError: a prediction that cannot be read.
    """
    frames = root_frames(clip, "root")
    assert clip.garment is not None
    body, truth = (frames.to_canonical(points) for points in (clip.body.vertices, clip.garment.vertices))
    camera, small = (picture_camera(truth, size=size) for size in (_DRAWN, _PLAYED))
    chosen, numbers = _spread(clip.n_frames, shown), _spread(clip.n_frames, played)

    def scenes(
        points: np.ndarray, times: list[int], colours: np.ndarray | None
    ) -> Iterator[list[ShadedMesh]]:
        for t in times:
            garment = ShadedMesh(points[t], clip.template.faces, CLOTH if colours is None else colours[t])
            yield [ShadedMesh(body[t], clip.body.faces, SKIN), garment]

    def row(points: np.ndarray, colours: np.ndarray | None = None) -> tuple[list[np.ndarray], str]:
        """What the sheet shows of a garment, and its strip."""
        large = mesh_pictures(scenes(points, chosen, colours), camera)
        return large, _strip(mesh_pictures(scenes(points, numbers, colours), small))

    images, strip = row(truth)
    rows, strips = [images], [Strip(TRUTH, strip)]
    for candidate in candidates:
        points = frames.to_canonical(predicted_vertices(candidate.file))
        distance = 1e3 * np.linalg.norm(points - truth, axis=-1)
        images, strip = row(points, heat_colours(distance / LIMIT_MM) / 255)
        rows.append([with_scale(image, limit_mm=LIMIT_MM) for image in images])
        strips.append(Strip(candidate.row, strip))
    sheet = None
    if chosen:
        sheet = contact_sheet(
            rows,
            row_labels=[TRUTH, *(candidate.row for candidate in candidates)],
            column_labels=[f"frame {t}" for t in chosen],
            title=clip.name,
        )
    return ClipPictures(clip.name, sheet, strips if numbers else [], numbers)


def _spread(frames: int, count: int) -> list[int]:
    return [int(t) for t in np.unique(np.linspace(0, frames - 1, count).round())]


def _strip(images: Sequence[np.ndarray]) -> str:
    """Images beside each other as a URI; "" for none."""
    return "" if not images else data_uri("webp", np.concatenate(list(images), axis=1), _QUALITY)
