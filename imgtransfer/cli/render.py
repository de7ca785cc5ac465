"""`imgtransfer render`: clips as maps, for other programs and for eyes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.cli.options import add_clip_choice, chosen_clips, cut_frames, folder_name, image_size

if TYPE_CHECKING:
    import numpy as np

    from imgtransfer.data.clip import Clip
    from render import PositionBox, TemplateImager

SHEET_FRAMES = 5  # rows of a contact sheet


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "render",
        help="write the maps of clips, as npz and as PNG contact sheets",
        description="For each clip a folder with garment.npz, body.npz and sheets of positions, normals, "
        "mask and depth. Both are seen by the same cameras and encoded by the garment's box.",
    )
    parser.add_argument("source", type=Path, help="data set, clip npz or folder of clip npz")
    parser.add_argument("--out", required=True, type=Path, help="folder for the results")
    add_clip_choice(parser)
    parser.add_argument("--frames", default=":", help="one number, or START:STOP:STEP; default all")
    parser.add_argument("--size", default="256", help="pixels: 256, or HEIGHTxWIDTH; default 256")
    parser.add_argument("--views", default="front,back", help="out of front, back, left, right")
    parser.add_argument(
        "--root",
        choices=("heading", "root"),
        default="heading",
        help="what the canonical frame removes: the heading, or the whole root rotation; default heading",
    )
    parser.add_argument(
        "--backend",
        choices=("auto", "egl", "osmesa", "numpy"),
        default="auto",
        help="what rasterises; default the first that works",
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Render every clip that is asked for; a clip's folder appears whole or not at all."""
    from imgtransfer.data.canonical import root_frames  # noqa: PLC0415
    from render import Mesh, PositionBox, TemplateImager  # noqa: PLC0415
    from render.files import written_whole_folder  # noqa: PLC0415

    size = image_size(args.size)
    for whole in chosen_clips(args, args.source):
        clip = cut_frames(whole, args.frames)
        garment = TemplateImager.build(
            Mesh(clip.template_vertices, clip.garment_faces, f"{clip.name}: garment"),
            views=args.views.split(","),
            size=size,
            backend=args.backend,
        )
        body = TemplateImager.build(
            Mesh(clip.body_rest, clip.body_faces, f"{clip.name}: body"),
            cameras=garment.cameras,
            backend=args.backend,
        )
        frames = root_frames(clip, args.root)
        moving = {"body": (body, frames.to_canonical(clip.body_vertices))}
        if clip.garment_vertices is not None:
            moving["garment"] = (garment, frames.to_canonical(clip.garment_vertices))
        box = PositionBox.around(moving["garment" if "garment" in moving else "body"][1])
        target = args.out / folder_name(clip.name)
        with written_whole_folder(target) as folder:
            for name, (imager, vertices) in moving.items():
                _write_maps(folder, name, imager, vertices, clip, box, frames.rotation, frames.translation)
        print(f"{target}  {clip.n_frames} frames, {garment.raster.backend}")


def _write_maps(  # noqa: PLR0917
    folder: Path,
    name: str,
    imager: TemplateImager,
    vertices: np.ndarray,
    clip: Clip,
    box: PositionBox,
    rotation: np.ndarray,
    translation: np.ndarray,
) -> None:
    """Write <name>.npz, <name>_maps.png and <name>_template.png."""
    import torch  # noqa: PLC0415

    from render import MapFile, contact_sheet, save_maps, write_png  # noqa: PLC0415
    from render.pictures import map_sheet  # noqa: PLC0415

    points = torch.from_numpy(vertices)
    maps = {
        "position": imager.position_maps(points, box).numpy(),
        "normal": imager.normal_maps(points).numpy(),
    }
    save_maps(
        folder / f"{name}.npz",
        MapFile.of(imager, **maps, box=box, rotation=rotation, translation=translation, fps=clip.fps),
    )
    mask, views = imager.raster.mask, [camera.name for camera in imager.cameras]
    shown = sorted({round(i * (clip.n_frames - 1) / (SHEET_FRAMES - 1)) for i in range(SHEET_FRAMES)})
    title = f"{clip.name}: {name}"
    write_png(folder / f"{name}_maps.png", map_sheet(maps, mask, views, frames=shown, title=title))
    depth = imager.raster.depth
    near, far = depth[mask].min(), depth[mask].max()
    shade = 1 - 0.85 * (depth - near) / max(far - near, 1e-6)  # near is bright
    shade[~mask] = 0
    template = [[*mask.astype(float)], [*shade]]
    labels = ["mask", f"depth, {near:.2f} m (bright) to {far:.2f} m"]
    write_png(
        folder / f"{name}_template.png",
        contact_sheet(template, row_labels=labels, column_labels=views, title=f"{title} at rest"),
    )
