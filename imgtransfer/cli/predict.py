"""`imgtransfer predict`: maps and vertices of the garment for clips of a body in motion."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.cli.options import add_clip_choice, chosen_clips, folder_name

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.data.clip import Clip
    from imgtransfer.network.model import Prediction

MAPS_FILE, VERTICES_FILE = "maps.npz", "position_only.npz"


def add_parser(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "predict",
        help="predict maps and vertices for clips",
        description=f"Writes OUT/CLIP/{MAPS_FILE}, for `imgtransfer fuse`, and OUT/CLIP/{VERTICES_FILE}, the vertices "
        "read from the position maps alone. The clips need no garment vertices.",
    )
    parser.add_argument("model", type=Path, help="a run's folder or a model.safetensors")
    parser.add_argument("source", type=Path, help="data set, clip npz or folder of clip npz")
    add_clip_choice(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results, one folder a clip")
    return parser


def run(args: argparse.Namespace) -> None:
    """Predict every chosen clip, and say where the results are."""
    from tqdm import tqdm  # noqa: PLC0415

    from imgtransfer.training.checkpoint import load_model  # noqa: PLC0415

    model = load_model(args.model)
    clips = chosen_clips(args, args.source)
    for clip in clips:  # all before any work: a wrong one would stop the command half-way
        model.check_garment(clip)
    for clip in clips:
        prediction = model.predict(clip, partial(tqdm, desc=clip.name, unit="batch", leave=False))
        folder = args.out / folder_name(clip.name)
        save_prediction(folder, prediction, clip)
        print(f"{clip.name}: {clip.n_frames} frames in {folder}")
    maps, body = folder / MAPS_FILE, folder / VERTICES_FILE
    print(f"next: imgtransfer fuse --maps {maps} --body {body} --out {folder}-fused")


def save_prediction(folder: Path, prediction: Prediction, clip: Clip) -> None:
    """Write `maps.npz`, and `position_only.npz` with the vertices that the position maps alone give, world frame."""
    from fusion import initial_vertices  # noqa: PLC0415
    from imgtransfer.data.clip import save_clip  # noqa: PLC0415
    from render import MapFile, save_maps  # noqa: PLC0415

    maps = MapFile.of(
        prediction.imager,
        position=prediction.positions.numpy(),
        normal=prediction.normals.numpy(),
        box=prediction.box,
        rotation=prediction.frames.rotation,
        translation=prediction.frames.translation,
        fps=prediction.fps,
    )
    save_maps(folder / MAPS_FILE, maps)
    vertices = initial_vertices(prediction.imager, prediction.metres()).numpy()
    save_clip(folder / VERTICES_FILE, clip.with_garment(prediction.frames.to_world(vertices)))
