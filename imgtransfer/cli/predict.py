"""`imgtransfer predict`: maps and vertices of the garment for clips of a body in motion."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from shlex import join
from typing import TYPE_CHECKING

from imgtransfer.cli.options import add_clip_choice, chosen_clips, folder_name
from imgtransfer.predictions import MAPS_FILE, POSITION_ONLY_FILE, check_replaceable

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.data.clip import Clip
    from imgtransfer.network.model import Prediction


def add_parser(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "predict",
        help="predict maps and vertices for clips",
        description=f"Writes OUT/CLIP/{MAPS_FILE}, for `imgtransfer fuse`, and OUT/CLIP/{POSITION_ONLY_FILE}, the "
        "vertices read from the position maps alone. The clips need no garment vertices. Clips that this model "
        "has predicted already are left as they are, so a stopped run goes on.",
    )
    parser.add_argument("model", type=Path, help="a run's folder or a model.safetensors")
    parser.add_argument("source", type=Path, help="data set, clip npz or folder of clip npz")
    add_clip_choice(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results, one folder a clip")
    parser.add_argument(
        "--overwrite", action="store_true", help="predict clips again that are predicted already"
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Predict every chosen clip, and say where the results are; a clip's folder appears whole or not at all."""
    from tqdm import tqdm  # noqa: PLC0415

    from imgtransfer.training.checkpoint import fingerprint, load_model  # noqa: PLC0415

    model = load_model(args.model)
    mark = fingerprint(args.model)
    clips = chosen_clips(args, args.source)
    for clip in clips:  # all before any work: a wrong one would stop the command half-way
        model.check_garment(clip)
        check_replaceable(args.out / folder_name(clip.name), "--out")
    for clip in clips:
        folder = args.out / folder_name(clip.name)
        if not args.overwrite and _stands(folder, clip, mark):
            print(f"{folder}  predicted by this model already; --overwrite does it again")
            continue
        prediction = model.predict(
            clip, partial(tqdm, desc=clip.name, unit="batch", leave=False, disable=None)
        )
        save_prediction(folder, prediction, clip, model=mark)
        print(f"{folder}  {clip.n_frames} frames")
    choice = ["--split", args.split] if args.split else []
    choice += [word for name in args.clip or () for word in ("--clip", name)]
    print(f"next     {join(['imgtransfer', 'fuse', str(args.out)])}")
    if all(clip.garment_vertices is not None for clip in clips):
        words = ["imgtransfer", "evaluate", str(args.out), "--truth", str(args.source), *choice]
        print(f"then     {join(words)}")


def save_prediction(folder: Path, prediction: Prediction, clip: Clip, *, model: str) -> None:
    """Write a clip's folder, in place of an earlier one: the maps, and the vertices that the position maps alone give.

    Args:
        folder: appears whole or not at all. What was fused from an earlier prediction goes with that.
        prediction: of the clip.
        clip: with the body; the vertices are written as this clip's garment, world frame.
        model: `fingerprint` of the model, for the record.
    """
    from fusion import initial_vertices  # noqa: PLC0415
    from imgtransfer.data.clip import save_clip  # noqa: PLC0415
    from render import MapFile, save_maps  # noqa: PLC0415
    from render.files import written_whole_folder  # noqa: PLC0415

    maps = MapFile.of(
        prediction.imager,
        position=prediction.positions.numpy(),
        normal=prediction.normals.numpy(),
        box=prediction.box,
        rotation=prediction.frames.rotation,
        translation=prediction.frames.translation,
        fps=prediction.fps,
    )
    vertices = initial_vertices(prediction.imager, prediction.metres()).numpy()
    garment = clip.with_garment(prediction.frames.to_world(vertices))
    with written_whole_folder(folder) as temporary:
        save_maps(temporary / MAPS_FILE, maps)
        save_clip(temporary / POSITION_ONLY_FILE, replace(garment, info=clip.info | {"model": model}))


def _stands(folder: Path, clip: Clip, model: str) -> bool:
    """Whether the folder holds this model's prediction for this very clip."""
    import numpy as np  # noqa: PLC0415

    from imgtransfer.data.clip import load_clip  # noqa: PLC0415
    from render import InputError  # noqa: PLC0415

    if not (folder / MAPS_FILE).is_file():
        return False
    try:
        stored = load_clip(folder / POSITION_ONLY_FILE)
    except InputError:
        return False
    decisive = ("body_rest", "body_faces", "body_vertices", "poses", "trans", "fps")
    return stored.info.get("model") == model and all(
        np.array_equal(getattr(stored, key), getattr(clip, key)) for key in decisive
    )
