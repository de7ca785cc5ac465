"""Pictures of every garment on three body shapes, at rest and in motion, and a table of the meshes.

    python scripts/pictures/garments.py [--out docs/images] [--detail full] [--posed] [--numbers]

Writes OUT/garments_rest.png (front, side and back); with --posed OUT/garments_posed.png, too, for which every garment
is simulated on every shape (12 clips, some minutes each at full detail); with --numbers prints the table. Needs the
extra `simulate`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from fusion import BodySdf
from imgtransfer.bodies.anny import AnnyBody, load_body
from imgtransfer.bodies.config import AnnyConfig
from imgtransfer.bodies.shape import AnnyShape
from imgtransfer.garments.checks import mesh_quality
from imgtransfer.garments.config import DressConfig, MadeConfig, SkirtConfig, TrousersConfig, TShirtConfig
from imgtransfer.garments.garment import Garment, make_garment
from imgtransfer.motions.library import make_motion
from imgtransfer.report.pictures import SKIN, ShadedMesh, mesh_picture, picture_camera
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.run import simulate_clip
from render.pictures import contact_sheet, write_png

SHAPES = {
    "slim man": AnnyShape(gender=0.05, age=0.7, muscle=0.55, weight=0.3, height=0.4, proportions=0.3),
    "woman": AnnyShape(gender=0.95, age=0.7, muscle=0.5, weight=0.45, height=0.4, proportions=0.3),
    "heavy woman": AnnyShape(gender=1.0, age=0.85, muscle=0.4, weight=0.9, height=0.35, proportions=0.5),
}
GARMENTS: tuple[type[MadeConfig], ...] = (TShirtConfig, DressConfig, TrousersConfig, SkirtConfig)
VIEWS = (("front", 0.0), ("left", 0.0), ("back", 0.0))
SIZE = (300, 190)  # pixels, height and width of one picture
MOTION, SEED, TEMPO, SECONDS = "kick", 107, 1.2, 2.0
FRAMES = (25, 42, 52)


def rest_sheet(garments: dict[tuple[str, str], Garment]) -> np.ndarray:
    """(H, W, 3) uint8: a row a garment, for each shape front, side and back."""

    def pictures(shape: str, garment: Garment) -> list[np.ndarray]:
        body = load_body(SHAPES[shape])
        surfaces = [
            ShadedMesh(body.rest, body.faces, SKIN),
            ShadedMesh(garment.mesh.vertices, garment.mesh.faces),
        ]
        return [
            mesh_picture(surfaces, picture_camera(body.rest, view=view, turn_degrees=turn, size=SIZE))
            for view, turn in VIEWS
        ]

    return _sheet(
        "At rest", lambda kind, shape: pictures(shape, garments[kind, shape]), [view for view, _ in VIEWS]
    )


def posed_sheet(detail: str) -> np.ndarray:
    """(H, W, 3) uint8: a row a garment, for each shape some frames of a simulated motion."""
    motion = make_motion(MOTION, seed=SEED, tempo=TEMPO, seconds=SECONDS)

    def pictures(kind: str, shape: str) -> list[np.ndarray]:
        config = SimulateConfig.model_validate(
            {
                "garment": {"kind": kind, "detail": detail},
                "body": AnnyConfig(shape=SHAPES[shape]),
                "solver": {"self_contact": True},
            }
        )
        clip = simulate_clip(motion, config)[0]
        assert clip.garment is not None
        drawn = []
        for frame in FRAMES:
            body, cloth = clip.body.vertices[frame], clip.garment.vertices[frame]
            surfaces = [ShadedMesh(body, clip.body.faces, SKIN), ShadedMesh(cloth, clip.template.faces)]
            drawn.append(mesh_picture(surfaces, picture_camera(body, size=SIZE)))
        return drawn

    return _sheet(f"In motion ({MOTION}, seed {SEED})", pictures, [f"frame {frame}" for frame in FRAMES])


def numbers(garments: dict[tuple[str, str], Garment]) -> str:
    """A Markdown table of the meshes."""
    lines = [
        "| garment | body | vertices | faces | openings | edges, mm (spread) | smallest angle (1st percentile) | "
        "to the body, mm: least, median |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for (kind, shape), garment in garments.items():
        quality, clearance = mesh_quality(garment.mesh), 1000 * _clearance(load_body(SHAPES[shape]), garment)
        lines.append(
            f"| {kind} | {shape} | {quality.vertices} | {quality.faces} | {quality.openings} | "
            f"{1000 * quality.edge_median:.1f} ({100 * quality.edge_spread:.0f} %) | "
            f"{quality.angle_min:.0f}° ({quality.angle_p1:.0f}°) | {clearance.min():.1f}, {np.median(clearance):.1f} |"
        )
    return "\n".join(lines)


def _clearance(body: AnnyBody, garment: Garment) -> np.ndarray:
    """(N,) metres from the garment's vertices to the body."""
    sdf = BodySdf(body.faces, len(body.rest))
    sdf.update(body.rest)
    return sdf.distance(torch.from_numpy(garment.mesh.vertices)).numpy()


def _sheet(title: str, pictures: Callable[[str, str], list[np.ndarray]], columns: list[str]) -> np.ndarray:
    """Pictures of every garment (rows) on every shape (groups of columns)."""
    rows = []
    with tqdm(total=len(GARMENTS) * len(SHAPES), desc=title) as bar:
        for config in GARMENTS:
            row = []
            for shape in SHAPES:
                row += pictures(config().kind, shape)
                bar.update()
            rows.append(row)
    labels = [f"{shape}, {column}" for shape in SHAPES for column in columns]
    return contact_sheet(
        rows, row_labels=[config().kind for config in GARMENTS], column_labels=labels, title=title
    )


def main() -> None:
    """Write the pictures and say where they are."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("docs/images"), help="folder (default docs/images)")
    parser.add_argument(
        "--detail", choices=("full", "small"), default="full", help="of the meshes (default full)"
    )
    parser.add_argument("--posed", action="store_true", help="simulate and draw the garments in motion, too")
    parser.add_argument("--numbers", action="store_true", help="print a table of the meshes")
    args = parser.parse_args()
    garments = {
        (config().kind, shape): make_garment(load_body(figure), config(detail=args.detail))
        for config in tqdm(GARMENTS, desc="making", unit="garment")
        for shape, figure in SHAPES.items()
    }
    sheets = {"garments_rest": rest_sheet(garments)}
    if args.posed:
        sheets["garments_posed"] = posed_sheet(args.detail)
    for name, sheet in sheets.items():
        write_png(args.out / f"{name}.png", sheet)
        print(f"{args.out / name}.png")
    if args.numbers:
        print(numbers(garments))


if __name__ == "__main__":
    main()
