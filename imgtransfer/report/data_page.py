"""The page of `imgtransfer inspect --html`: every clip in pictures, its strain and speed, and what looks wrong."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import cv2
import numpy as np

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import ClipRef
from imgtransfer.evaluation.inspection import Inspection, inspect_clip
from imgtransfer.report.html import page
from imgtransfer.report.pictures import CLOTH, SKIN, ShadedMesh, mesh_picture, picture_camera
from imgtransfer.report.svg import line_plot
from render import InputError
from render.files.atomic import written_whole
from render.pictures import contact_sheet

MANY = 60  # clips, from which on each gets fewer and smaller pictures
_PICTURES, _PICTURES_OF_MANY = (8, (230, 165)), (5, (150, 108))  # frames, (height, width) of each in pixels
_FLAGGED = 3  # frames with findings that are shown besides
_JPEG_QUALITY = 82
_HEADINGS = ("clip", "split", "frames", "fps", "garment", "strain 50 / 99 %", "m/s", "inside %", "to look at")


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
class ClipPart:
    """A clip's part of the page: its row of the table, its section (HTML), and what looks wrong (plain text)."""

    name: str
    row: tuple[str, ...]
    section: str
    findings: tuple[str, ...]
    unreadable: bool = False


def describe_clip(task: PageTask) -> ClipPart:
    """Measure and picture a clip; one that cannot be read is described by the reason."""
    split = task.clip.split or "-"
    try:
        clip = task.clip.load()
        measured = inspect_clip(clip)
    except InputError as error:
        row = (task.name, split, *["-"] * (len(_HEADINGS) - 3), "unreadable")
        return ClipPart(task.name, row, _section(task.name, [str(error)], ""), (str(error),), unreadable=True)
    count, size = _PICTURES_OF_MANY if task.many else _PICTURES
    findings = [finding.text for finding in measured.findings]
    flagged = list(dict.fromkeys(f.frame for f in measured.findings if f.frame is not None))[:_FLAGGED]
    content = _facts(clip) + _pictures(clip, count, flagged, size)
    if len(measured.strain):
        content += (
            f'<div class="plots">{_strain_plot(measured, flagged)}{_speed_plot(measured, flagged)}</div>'
        )
    section = _section(task.name, findings, content)
    return ClipPart(task.name, _row(clip, measured, split), section, tuple(findings))


def write_data_page(
    path: str | Path, title: str, facts: Mapping[str, str], parts: Sequence[ClipPart]
) -> Path:
    """Write the page.

    Args:
        path: the file.
        title: of the page. facts: lines under it, by what they say.
        parts: the clips, in order.

    Returns:
        The file.
    """
    lines = "".join(f"<p><b>{escape(key)}</b> {escape(value)}</p>" for key, value in facts.items())
    wrong = [part for part in parts if part.findings]
    items = "".join(
        f'<li><a href="#{_anchor(part.name)}">{escape(part.name)}</a>: {escape("; ".join(part.findings))}</li>'
        for part in wrong
    )
    found = (
        f"<h2>To look at: {len(wrong)} of {len(parts)} clips</h2><ul>{items}</ul>"
        if wrong
        else f"<h2>Nothing looks wrong in {len(parts)} clips</h2>"
    )
    body = [
        f"<h1>{escape(title)}</h1>",
        f"<section>{lines}</section>" if lines else "",
        f"<section>{found}</section>",
        f'<section><h2>Clips</h2><div class="scroll">{_table(parts)}</div></section>',
        *(part.section for part in parts),
    ]
    path = Path(path)
    with written_whole(path) as temporary:
        temporary.write_text(page(title, "\n".join(body)), encoding="utf-8")
    return path


def _facts(clip: Clip) -> str:
    facts = [f"{clip.n_frames} frames, {clip.n_frames / clip.fps:.1f} s"]
    facts += [f"{key} {value}" for key, value in clip.info.items() if key not in ("mtl", "materials")]
    return f"<p>{escape('; '.join(facts))}</p>"


def _pictures(clip: Clip, count: int, flagged: Sequence[int], size: tuple[int, int]) -> str:
    """Frames spread over the clip and those with findings, from the front, turned as the body turns."""
    spread = np.linspace(0, clip.n_frames - 1, count).round().astype(int)
    frames = sorted({*spread.tolist(), *flagged})
    roots = root_frames(clip, "heading")
    bodies = roots.to_canonical(clip.body_vertices)[frames]
    surfaces = [[ShadedMesh(body, clip.body_faces, SKIN)] for body in bodies]
    points = bodies.reshape(-1, 3)
    if clip.garment_vertices is not None:
        garments = roots.to_canonical(clip.garment_vertices)[frames]
        for shown, garment in zip(surfaces, garments, strict=True):
            shown.append(ShadedMesh(garment, clip.garment_faces, CLOTH))
        points = np.concatenate([points, garments.reshape(-1, 3)])
    camera = picture_camera(points, size=size)
    labels = [f"{frame} !" if frame in flagged else str(frame) for frame in frames]
    sheet = contact_sheet([[mesh_picture(shown, camera) for shown in surfaces]], column_labels=labels)
    data = cv2.imencode(".jpg", sheet[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    source = base64.b64encode(data.tobytes()).decode()
    alt = escape(f"{clip.name}, frames {', '.join(labels)}")
    return f'<img alt="{alt}" src="data:image/jpeg;base64,{source}">'


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


def _row(clip: Clip, measured: Inspection, split: str) -> tuple[str, ...]:
    strain = speed = inside = "-"
    if len(measured.strain):
        strain = f"{np.median(measured.strain[:, 0]):.1f} / {measured.strain[:, 1].max():.0f}"
        speed = f"{measured.speed[:, 0].max(initial=0.0):.1f}"
        inside = f"{measured.inside.max():.2f}"
    garment = f"{len(clip.template_vertices):,}"
    frames = str(clip.n_frames)
    found = str(len(measured.findings) or "")
    return clip.name, split, frames, f"{clip.fps:g}", garment, strain, speed, inside, found


def _table(parts: Sequence[ClipPart]) -> str:
    head = "".join(f"<th>{escape(heading)}</th>" for heading in _HEADINGS)
    rows = []
    for part in parts:
        name, *cells = part.row
        kind = ' class="wrong"' if part.findings else ""
        linked = f'<td><a href="#{_anchor(name)}">{escape(name)}</a></td>'
        rows.append(f"<tr{kind}>{linked}{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _section(name: str, findings: Sequence[str], content: str) -> str:
    listed = "".join(f"<li>{escape(text)}</li>" for text in findings)
    wrong = f'<ul class="wrong">{listed}</ul>' if listed else ""
    return f'<section id="{_anchor(name)}"><h2>{escape(name)}</h2>{wrong}{content}</section>'


def _anchor(name: str) -> str:
    return escape(name.replace("/", "__"), quote=True)
