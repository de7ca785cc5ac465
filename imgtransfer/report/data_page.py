"""The page of `imgtransfer inspect --html`: every clip in pictures, its strain and speed, and what looks wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import ClipRef
from imgtransfer.evaluation.inspection import Inspection, inspect_clip
from imgtransfer.report.html import write_page
from imgtransfer.report.page_pictures import PictureBudget, data_uri
from imgtransfer.report.pictures import CLOTH, SKIN, ShadedMesh, mesh_picture, picture_camera
from imgtransfer.report.svg import line_plot
from render import InputError
from render.pictures import contact_sheet

MANY = 60  # clips, from which on each gets fewer and smaller pictures
_PICTURES, _PICTURES_OF_MANY = (8, (230, 165)), (5, (150, 108))  # frames, (height, width) of each in pixels
_FLAGGED = 3  # frames with findings that are shown besides
_HEADINGS = (
    "clip",
    "split",
    "frames",
    "fps",
    "garment",
    "strain 50 / 99 %",
    "m/s",
    "inside %",
    "crossing body %",
    "itself %",
    "to look at",
)


@dataclass(frozen=True)
class PageTask:
    """One clip of the page; `many` says that the page has many."""

    clip: ClipRef
    many: bool = False

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.clip.name


@dataclass(frozen=True)
class ClipPicture:
    """Frames of a clip beside each other: a URI that holds the image, and what it says to who cannot see it."""

    source: str
    alt: str


@dataclass(frozen=True)
class ClipPart:
    """A clip's part of the page. Texts are plain, not HTML.

    Args:
        name: the clip's name.
        cells: of its row in the table, after the name.
        findings: what looks wrong.
        facts: one paragraph about the clip.
        picture: some of its frames.
        plots: <svg> elements.
        unreadable: whether it could not be read; then `findings` is the reason, and the rest is empty.
    """

    name: str
    cells: tuple[str, ...]
    findings: tuple[str, ...]
    facts: str = ""
    picture: ClipPicture | None = None
    plots: tuple[str, ...] = ()
    unreadable: bool = False

    @property
    def anchor(self) -> str:
        """The section's id, which the table links to."""
        return self.name.replace("/", "__")


def describe_clip(task: PageTask) -> ClipPart:
    """Measure and picture a clip; one that cannot be read is described by the reason."""
    split = task.clip.split or "-"
    try:
        clip = task.clip.load()
        measured = inspect_clip(clip)
    except InputError as error:
        cells = (split, *["-"] * (len(_HEADINGS) - 3), "unreadable")
        return ClipPart(task.name, cells, (str(error),), unreadable=True)
    count, size = _PICTURES_OF_MANY if task.many else _PICTURES
    findings = tuple(finding.text for finding in measured.findings)
    flagged = list(dict.fromkeys(f.frame for f in measured.findings if f.frame is not None))[:_FLAGGED]
    plots = (_strain_plot(measured, flagged), _speed_plot(measured, flagged)) if len(measured.strain) else ()
    picture = _picture(clip, count, flagged, size)
    return ClipPart(task.name, _cells(clip, measured, split), findings, _facts(clip), picture, plots)


def write_data_page(
    path: str | Path, title: str, facts: Mapping[str, str], parts: Sequence[ClipPart]
) -> Path:
    """Write the page; where it would become too large, clips without findings lose their pictures first.

    Args:
        path: the file.
        title: of the page. facts: lines under it, by what they say.
        parts: the clips, in order.

    Returns:
        The file.
    """
    flagged = [part for part in parts if part.findings]
    pictured = _pictured([*flagged, *(part for part in parts if not part.findings)])
    return write_page(
        Path(path),
        "data_page.html",
        title=title,
        facts=facts,
        clips=parts,
        flagged=flagged,
        headings=_HEADINGS,
        pictured=pictured,
        without=sum(part.picture is not None for part in parts) - len(pictured),
    )


def _pictured(parts: Sequence[ClipPart]) -> set[str]:
    """Names of the clips whose pictures fit the page, the first ones first."""
    budget = PictureBudget()
    return {part.name for part in parts if part.picture is not None and budget.take(part.picture.source)}


def _facts(clip: Clip) -> str:
    facts = [f"{clip.n_frames} frames, {clip.n_frames / clip.fps:.1f} s"]
    facts += [f"{key} {value}" for key, value in clip.info.items() if key not in ("mtl", "materials")]
    return "; ".join(facts)


def _picture(clip: Clip, count: int, flagged: Sequence[int], size: tuple[int, int]) -> ClipPicture:
    """Frames spread over the clip and those with findings, from the front, turned as the body turns."""
    spread = np.linspace(0, clip.n_frames - 1, count).round().astype(int)
    frames = sorted({*spread.tolist(), *flagged})
    roots = root_frames(clip, "heading")
    bodies = roots.to_canonical(clip.body.vertices)[frames]
    surfaces = [[ShadedMesh(body, clip.body.faces, SKIN)] for body in bodies]
    points = bodies.reshape(-1, 3)
    if clip.garment is not None:
        garments = roots.to_canonical(clip.garment.vertices)[frames]
        for shown, garment in zip(surfaces, garments, strict=True):
            shown.append(ShadedMesh(garment, clip.template.faces, CLOTH))
        points = np.concatenate([points, garments.reshape(-1, 3)])
    camera = picture_camera(points, size=size)
    labels = [f"{frame} !" if frame in flagged else str(frame) for frame in frames]
    sheet = contact_sheet([[mesh_picture(shown, camera) for shown in surfaces]], column_labels=labels)
    source = data_uri("jpeg", sheet)
    return ClipPicture(source, f"{clip.name}, frames {', '.join(labels)}")


def _strain_plot(measured: Inspection, flagged: Sequence[int]) -> str:
    time = np.arange(measured.frames) / measured.fps
    lines = {"median": (time, measured.strain[:, 0]), "99th percentile": (time, measured.strain[:, 1])}
    return line_plot(lines, title="edge strain, %", x_label="s", marks=time[list(flagged)].tolist())


def _speed_plot(measured: Inspection, flagged: Sequence[int]) -> str:
    time = np.arange(measured.frames) / measured.fps
    lines = {
        "garment": (time[1:], measured.speed[:, 0]),
        "body": (time[1:], measured.speed[:, 1]),
    }
    return line_plot(lines, title="fastest vertex, m/s", x_label="s", marks=time[list(flagged)].tolist())


def _cells(clip: Clip, measured: Inspection, split: str) -> tuple[str, ...]:
    strain = speed = inside = crossing = self_crossing = "-"
    if len(measured.strain):
        strain = f"{np.median(measured.strain[:, 0]):.1f} / {measured.strain[:, 1].max():.0f}"
        speed = f"{measured.speed[:, 0].max(initial=0.0):.1f}"
        inside = f"{measured.inside.max():.2f}"
        crossing, self_crossing = (
            f"{values.max():.2f}" for values in (measured.crossing, measured.self_crossing)
        )
    garment = f"{len(clip.template.vertices):,}"
    frames = str(clip.n_frames)
    findings = str(len(measured.findings) or "")
    return split, frames, f"{clip.fps:g}", garment, strain, speed, inside, crossing, self_crossing, findings
