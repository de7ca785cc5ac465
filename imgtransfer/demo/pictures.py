"""The pictures of the demo's report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from imgtransfer.demo.case import PRETRAINED, Case
from imgtransfer.report.html import Picture
from imgtransfer.report.logs import read_curves
from imgtransfer.report.pictures import (
    SKIN,
    ShadedMesh,
    curve_picture,
    error_picture,
    mesh_picture,
    picture_camera,
)
from render import Mesh, TemplateImager, contact_sheet
from render.pictures import difference_picture

LIMIT_MM = 60.0  # the brightest error colour, one scale for all methods
COLUMNS = 4  # frames shown of a clip


def overview(cases: Sequence[Case]) -> Picture:
    """The frame farthest from the template, from inputs to result, in the canonical frame.

    Beside each other: template, posed body, its maps, the predicted maps, the fused garment.
    """
    case, frame = max(((case, *_farthest(case)) for case in cases), key=lambda candidate: candidate[2])[:2]
    clip, deformation = case.truth, case.maps[PRETRAINED]
    prediction = deformation.prediction
    imager = prediction.imager
    body = prediction.frames.to_canonical(clip.body.vertices)[frame]
    garment = prediction.frames.to_canonical(deformation.fused)[frame]
    body_imager = TemplateImager.build(Mesh(clip.body.rest, clip.body.faces), cameras=imager.cameras)
    posed = torch.from_numpy(body)
    upper = body[body[:, 1] > garment[:, 1].min() - 0.05]
    camera = picture_camera(np.concatenate([upper, garment]), size=(300, 300))
    rest = [
        ShadedMesh(clip.body.rest, clip.body.faces, SKIN),
        ShadedMesh(clip.template.vertices, clip.template.faces),
    ]
    pictures = {
        "template": mesh_picture(rest, camera),
        "posed body": mesh_picture([ShadedMesh(body, clip.body.faces, SKIN)], camera),
    }
    for name, maps, mask in (
        ("its positions", body_imager.position_maps(posed, prediction.box), body_imager.mask),
        ("its normals", body_imager.normal_maps(posed), body_imager.mask),
        ("predicted positions", prediction.positions[frame], imager.mask),
        ("predicted normals", prediction.normals[frame], imager.mask),
    ):
        pictures[name] = _on_white(maps[0].numpy(), mask[0].numpy(), 300)
    fused = [ShadedMesh(body, clip.body.faces, SKIN), ShadedMesh(garment, clip.template.faces)]
    pictures["fused garment"] = mesh_picture(fused, camera)
    sheet = contact_sheet([list(pictures.values())], column_labels=list(pictures), gap=10)
    return Picture(sheet, f"{clip.name}, frame {frame}, front view, pretrained model")


def _farthest(case: Case) -> tuple[int, float]:
    """The frame in which the garment is farthest from the template on average, and that distance in metres."""
    canonical = case.maps[PRETRAINED].prediction.frames.to_canonical(case.truth_vertices)
    distance = np.linalg.norm(canonical - case.truth.template.vertices, axis=-1).mean(axis=1)
    return int(distance.argmax()), float(distance.max())


def maps(case: Case, model: str) -> Picture:
    """True and predicted maps of one frame, and their difference; both views."""
    clip, prediction = case.truth, case.maps[model].prediction
    frame = clip.n_frames // 2
    imager, box = prediction.imager, prediction.box
    truth = torch.from_numpy(prediction.frames.to_canonical(case.truth_vertices)[frame])
    extent_mm = 1e3 * (box.hi - box.lo)
    kinds = {
        "positions": (
            imager.position_maps(truth, box),
            prediction.positions[frame],
            extent_mm,
            "mm",
            LIMIT_MM,
        ),
        "normals": (imager.normal_maps(truth), prediction.normals[frame], 2.0, "", 1.0),
    }
    rows, labels = [], []
    for name, (true, predicted, scale, unit, limit) in kinds.items():
        for view in range(len(imager.cameras)):
            mask = imager.mask[view].numpy()
            pair = [image[view].numpy() for image in (true, predicted)]
            difference = difference_picture(pair[0] * scale, pair[1] * scale, mask, unit=unit, limit=limit)
            rows.append([*(_on_white(image, mask) for image in pair), difference])
            labels.append(name)
    # The views of a kind stand beside each other.
    views = len(imager.cameras)
    rows = [[image for row in rows[i : i + views] for image in row] for i in range(0, len(rows), views)]
    columns = [f"{kind}, {c.name}" for c in imager.cameras for kind in ("true", "predicted", "difference")]
    sheet = contact_sheet(rows, row_labels=labels[::views], column_labels=columns)
    return Picture(sheet, f"{clip.name}, frame {frame}, model {model}")


def meshes(case: Case) -> Picture:
    """The simulated garment and every method's, coloured by error, at some frames of the clip."""
    clip = case.truth
    frames = np.linspace(0.1, 0.95, COLUMNS) * (clip.n_frames - 1)
    methods = case.methods
    rows: list[list[np.ndarray]] = [[] for _ in range(1 + len(methods))]
    for frame in frames.astype(int):
        body = ShadedMesh(clip.body.vertices[frame], clip.body.faces, SKIN)
        truth = ShadedMesh(case.truth_vertices[frame], clip.template.faces)
        camera = picture_camera(truth.vertices, size=(260, 230))
        rows[0].append(mesh_picture([body, truth], camera))
        for row, method in zip(rows[1:], methods, strict=True):
            garment = ShadedMesh(case.vertices[method][frame], clip.template.faces)
            error = case.error_mm(method)[frame]
            row.append(error_picture(garment, error, limit_mm=LIMIT_MM, body=body, camera=camera))
    labels = ["simulated", *(f"{m}, mean {case.error_mm(m).mean():.1f} mm" for m in methods)]
    columns = [f"frame {int(frame)}" for frame in frames]
    return Picture(contact_sheet(rows, row_labels=labels, column_labels=columns), clip.name)


def curves(log: Path) -> list[Picture]:
    """Training losses and validation errors over steps; `log` is a run's log.jsonl."""
    losses = read_curves(log, {"position_loss": "position", "normal_loss": "normal"})
    pictures = [Picture(curve_picture(losses, title="masked L1"), "training")]
    for key, title in (("position_mm", "position error (mm)"), ("normal_degrees", "normal error (degrees)")):
        lines = read_curves(log, {key: "network", f"guess_{key}": "first guess"})
        picture = curve_picture(lines, title=title, y_label="", logarithmic=False)
        pictures.append(Picture(picture, "validation"))
    return pictures


def _on_white(image: np.ndarray, mask: np.ndarray, height: int | None = None) -> np.ndarray:
    """(H, W, 3) map in [0, 1] -> the same with a white background, scaled to `height` by whole pixels if given."""
    shown = np.where(mask[..., None], image, 1.0).clip(0, 1)
    if height is None:
        return shown
    rows = (np.arange(height) * image.shape[0] // height).astype(int)
    columns = (np.arange(height * image.shape[1] // image.shape[0]) * image.shape[0] // height).astype(int)
    return shown[rows[:, None], columns]
