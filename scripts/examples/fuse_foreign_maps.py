#!/usr/bin/env python
"""The example of docs/fusion.md: maps that another program made, fused with `imgtransfer fuse`.

Takes frames of a simulated T-shirt from the sample data as the truth, and plays the other program: it makes position
and normal maps of them, blurs them together with the background, adds noise, and writes them with NumPy alone. Then it
fuses them in several ways, prints how far each result is from the truth, and draws a picture.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from scipy.ndimage import gaussian_filter
from tabulate import tabulate

from fusion import BodySdf
from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import open_clips
from imgtransfer.report.pictures import SKIN, ShadedMesh, error_picture, mesh_picture, picture_camera
from render import Mesh, TemplateImager, contact_sheet, vertex_normals, write_png

PROJECT = Path(__file__).resolve().parents[2]
SAMPLE = PROJECT / "configs" / "sample_data" / "tshirt.zarr.zip"
CLIP, FRAMES = "tshirt/punch_s101", slice(10, 60, 12)
BLUR_PIXELS = 1.5  # of maps of 256 x 256; the noise is as smooth
POSITION_NOISE_M, NORMAL_NOISE = 0.004, 0.08
LIMIT_MM, CELL = 20.0, 200  # of the picture: the brightest error colour; pixels

# What is fused, by name: more and more of the options. Files are in the folder of the example.
ERODED, BODY = ["--erode", "4"], ["--body", "body.npz"]
RUNS = {
    "as they come": [],
    "--erode, positions only": [*ERODED, "--positions-only"],
    "--erode": ERODED,
    "+ --body": ERODED + BODY,
    "+ --config": [*ERODED, *BODY, "--config", "trust.yaml"],
}
TRUST = "weight_displacement: 0.5   # 25 times the default: these positions are good\n"


@dataclass(frozen=True, eq=False)
class Truth:
    """What the maps show: the clip's frames, and the template's imager."""

    clip: Clip
    imager: TemplateImager

    @property
    def vertices(self) -> np.ndarray:
        """(T, N, 3) float32, metres."""
        assert self.clip.garment is not None
        return self.clip.garment.vertices


def other_program(folder: Path, size: int, frames: slice) -> Truth:
    """Write template.obj, maps.npz and body.npz, as someone else's program might."""
    clip = open_clips(SAMPLE, names=[CLIP])[0].slice(frames)
    template = Mesh(clip.template.vertices, clip.template.faces)
    truth = Truth(clip, TemplateImager.build(template, size=(size, size)))
    imager, points = truth.imager, torch.from_numpy(truth.vertices)
    mask = imager.mask.numpy()
    positions = imager.operator(points).numpy()
    normals = imager.operator(vertex_normals(points, imager.faces)).numpy()

    low, high = (
        truth.vertices.min((0, 1)) - 0.02,
        truth.vertices.max((0, 1)) + 0.02,
    )  # metres: colours 0 and 1
    positions = disturbed((positions - low) / (high - low), mask, size, POSITION_NOISE_M / (high - low))
    normals = disturbed((normals + 1) / 2, mask, size, NORMAL_NOISE / 2)

    trimesh.Trimesh(template.vertices, template.faces, process=False).export(folder / "template.obj")
    np.savez(folder / "body.npz", body_faces=clip.body.faces, body_vertices=clip.body.vertices)
    arrays: dict[str, Any] = {
        "format": "imgtransfer-maps",
        "format_version": 2,
        "position": positions,  # (frames, views, height, width, 3) in [0, 1], row 0 at the top
        "normal": normals,  # (n + 1) / 2
        "mask": mask,  # (views, height, width)
        "box_lo": low,
        "box_hi": high,
        "views": np.array(["front", "back"]),
        "view_matrices": np.stack([camera.view for camera in imager.cameras]),  # world to camera
        "projection_matrices": np.stack([camera.projection for camera in imager.cameras]),  # OpenGL's
        "template_vertices": template.vertices,
        "template_faces": template.faces,
        "rotation": np.tile(np.eye(3), (len(positions), 1, 1)),  # these maps are in world coordinates
        "translation": np.zeros((len(positions), 3)),
        "fps": 30.0,
    }
    np.savez(folder / "maps.npz", **arrays)
    return truth


def disturbed(maps: np.ndarray, mask: np.ndarray, size: int, noise: float | np.ndarray) -> np.ndarray:
    """Encoded maps (T, S, H, W, 3), blurred with the background as a convolution does, plus smooth noise (standard
    deviation, in colours); float32, background 0.
    """
    sigma = (0, 0, BLUR_PIXELS * size / 256, BLUR_PIXELS * size / 256, 0)
    inside = mask[..., None]
    field = gaussian_filter(np.random.default_rng(0).standard_normal(maps.shape), sigma)
    blurred = gaussian_filter(np.where(inside, maps, 0), sigma) + noise * field / field.std()
    return np.where(inside, blurred, 0).astype(np.float32)


def fused(folder: Path, number: int, options: list[str]) -> np.ndarray:
    """Run the command; returns the garment (T, N, 3)."""
    out = folder / f"fused_{number}"
    words = ["fuse", "--template", folder / "template.obj", "--maps", folder / "maps.npz", "--out", out]
    words += [folder / word if word.endswith((".npz", ".yaml")) else word for word in options]
    print("\nimgtransfer", *words)
    if main([str(word) for word in words]):
        raise SystemExit("that fusion failed; see the line above")
    with np.load(out / "fused.npz") as found:
        return found["garment_vertices"]


def measured(vertices: np.ndarray, truth: Truth) -> list[float]:
    """Mean distance to the truth (mm), mean angle of the vertex normals (degrees), share inside the body (%)."""
    clip, faces = truth.clip, truth.imager.faces
    normals = [
        vertex_normals(torch.from_numpy(points).double(), faces) for points in (vertices, truth.vertices)
    ]
    angle = torch.rad2deg(torch.acos((normals[0] * normals[1]).sum(-1).clamp(-1, 1))).mean()
    sdf = BodySdf(clip.body.faces, clip.body.vertices.shape[1])
    sdf.update(clip.body.vertices)
    inside = (sdf.query(torch.from_numpy(vertices)).distance < 0).double().mean()
    distance = np.linalg.norm(vertices - truth.vertices, axis=-1).mean()
    return [1000 * float(distance), float(angle), 100 * float(inside)]


def picture(folder: Path, results: dict[str, np.ndarray], truth: Truth) -> np.ndarray:
    """The maps of one frame, its truth, and what the first and the last run made of it, coloured by the error."""
    clip, frame, faces = truth.clip, len(truth.vertices) // 2, truth.clip.template.faces
    body = ShadedMesh(clip.body.vertices[frame], clip.body.faces, SKIN)
    camera = picture_camera(truth.vertices[frame], size=(CELL, CELL))
    shown: dict[str, np.ndarray] = {}
    with np.load(folder / "maps.npz") as maps:
        mask = maps["mask"][0][..., None]
        pixel = np.arange(CELL) * len(mask) // CELL
        for name in ("position", "normal"):
            shown[f"{name}s given"] = np.where(mask, maps[name][frame, 0], 1.0)[pixel[:, None], pixel]
    shown["truth"] = mesh_picture([body, ShadedMesh(truth.vertices[frame], faces)], camera)
    first, last = next(iter(results)), list(results)[-1]
    shown["all of it"] = mesh_picture([body, ShadedMesh(results[last][frame], faces)], camera)
    for name, title in ((first, f"error, {first}"), (last, "error, all of it")):
        error = 1000 * np.linalg.norm(results[name][frame] - truth.vertices[frame], axis=-1)
        surface = ShadedMesh(results[name][frame], faces)
        shown[title] = error_picture(surface, error, limit_mm=LIMIT_MM, camera=camera)
    return contact_sheet([list(shown.values())], column_labels=list(shown))


def example(folder: Path, *, quick: bool) -> dict[str, list[float]]:
    """Everything; returns what was measured, by run."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trust.yaml").write_text(TRUST)
    truth = other_program(folder, 128 if quick else 256, slice(10, 11) if quick else FRAMES)
    results = {name: fused(folder, number, options) for number, (name, options) in enumerate(RUNS.items())}
    found = {name: measured(vertices, truth) for name, vertices in results.items()}
    write_png(folder / "example.png", picture(folder, results, truth))
    headers = ["", "RMSE (mm)", "normals (degrees)", "inside body (%)"]
    print("\n" + tabulate([[name, *row] for name, row in found.items()], headers=headers, floatfmt=".2f"))
    print(f"\nresults  {folder}: example.png and a folder a run")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("fusion-example"), help="default fusion-example")
    parser.add_argument("--quick", action="store_true", help="one frame, small maps: shows that it runs")
    options = parser.parse_args()
    example(options.out, quick=options.quick)
