"""`imgtransfer fuse`: maps to meshes, those of `imgtransfer predict` and those that another model made."""

from __future__ import annotations

import argparse
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from imgtransfer.predictions import (
    FUSED_FILE,
    MAPS_FILE,
    POSITION_ONLY_FILE,
    REPORT_FILE,
    check_replaceable,
    predicted_clips,
)
from render import InputError

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from fusion import FusionConfig
    from imgtransfer.fusing import Body, Fused
    from render import Mesh


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "fuse",
        help="recover meshes from position and normal maps",
        usage="%(prog)s PREDICTIONS [options]\n       %(prog)s --maps FILE --out DIR [options]",
        description=f"Recovers the garment's vertices and writes them, in world coordinates, to {FUSED_FILE}, with "
        f"the report {REPORT_FILE}. For PREDICTIONS they are put beside the maps of each clip; clips that are fused "
        "with the same settings already are left as they are, so a stopped run goes on. With --maps, one map file "
        "of any program is fused.",
    )
    parser.add_argument(
        "predictions",
        nargs="?",
        type=Path,
        metavar="PREDICTIONS",
        help="what `imgtransfer predict` wrote, or one clip's folder in it",
    )
    parser.add_argument("--overwrite", action="store_true", help="fuse clips again that are fused already")
    parser.add_argument("--config", type=Path, help="YAML with the fusion's hyper-parameters that differ")
    parser.add_argument("--positions-only", action="store_true", help="leave the normal maps out")
    parser.add_argument("--meshes", choices=("obj", "ply"), help="also write one mesh file a frame")
    parser.add_argument(
        "--device", default="cpu", help="torch device that computes: cpu or cuda; default cpu"
    )
    single = parser.add_argument_group("one map file, in place of PREDICTIONS")
    single.add_argument("--maps", type=Path, metavar="FILE", help="map file, npz")
    single.add_argument("--out", type=Path, metavar="DIR", help="folder for the results")
    single.add_argument("--template", type=Path, help="mesh in place of the map file's template")
    single.add_argument(
        "--body",
        type=Path,
        help="npz with body_faces and body_vertices (frames, vertices, 3) in world coordinates, metres; "
        "a clip npz will do. The garment is then kept out of the body",
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Fuse one map file, or every clip of a prediction."""
    from fusion.config import FusionConfig, load_config  # noqa: PLC0415

    _check_form(args)
    _check_device(args.device)
    config = load_config(args.config) if args.config else FusionConfig()
    if args.maps is not None:
        _fuse_file(args, config)
        return
    for folder in predicted_clips(args.predictions):
        _fuse_predicted(folder, args, config)
    print(f"next     imgtransfer evaluate {quote(str(args.predictions))} --truth SOURCE")


def _check_form(args: argparse.Namespace) -> None:
    """Raise InputError unless the arguments are those of one form."""
    if (args.predictions is None) == (args.maps is None):
        raise InputError("fuse: give either PREDICTIONS or --maps FILE --out DIR")
    if args.maps is None:
        for option in ("out", "template", "body"):
            if getattr(args, option) is not None:
                raise InputError(f"fuse: --{option} goes with --maps; PREDICTIONS have that in their folders")
    elif args.out is None:
        raise InputError("fuse: --maps needs --out DIR, the folder for the results")
    elif args.overwrite:
        raise InputError("fuse: --overwrite goes with PREDICTIONS; what --maps wrote to --out is replaced")


def _check_device(device: str) -> None:
    import torch  # noqa: PLC0415

    try:
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"--device {device}: not usable here ({reason}); use cpu") from error


def _fuse_file(args: argparse.Namespace, config: FusionConfig) -> None:
    """Fuse --maps; the folder --out appears whole or not at all."""
    from imgtransfer.fusing import load_body, save_fused  # noqa: PLC0415
    from render import load_mesh  # noqa: PLC0415
    from render.files import written_whole_folder  # noqa: PLC0415

    check_replaceable(args.out, "--out")
    body = load_body(args.body) if args.body else None
    result = _fused(args.maps, body, args, config, load_mesh(args.template) if args.template else None)
    with written_whole_folder(args.out) as folder:
        save_fused(folder, result, meshes=args.meshes)
    _say(args.out, result)


def _fuse_predicted(folder: Path, args: argparse.Namespace, config: FusionConfig) -> None:
    """Fuse one clip's folder, unless that was done with these settings since it was predicted."""
    from imgtransfer.data.clip import load_clip  # noqa: PLC0415
    from imgtransfer.fusing import fused_as, load_body, save_fused, save_meshes, settings  # noqa: PLC0415

    maps, target = folder / MAPS_FILE, folder / FUSED_FILE
    newer = target.is_file() and target.stat().st_mtime_ns >= maps.stat().st_mtime_ns
    if (
        newer
        and not args.overwrite
        and fused_as(target) == settings(config.model_dump(), args.positions_only)
    ):
        print(f"{folder}  fused with these settings already; --overwrite does it again")
        if args.meshes:
            clip = load_clip(target)
            assert clip.garment_vertices is not None
            save_meshes(folder, clip.garment_vertices, clip.garment_faces, args.meshes)
        return
    result = _fused(maps, load_body(folder / POSITION_ONLY_FILE), args, config)
    save_fused(folder, result, meshes=args.meshes)
    _say(folder, result)


def _fused(
    path: Path,
    body: Body | None,
    args: argparse.Namespace,
    config: FusionConfig,
    template: Mesh | None = None,
) -> Fused:
    """Read and fuse one map file, with a bar."""
    from tqdm import tqdm  # noqa: PLC0415

    from imgtransfer.fusing import fused  # noqa: PLC0415
    from render import load_maps  # noqa: PLC0415

    maps = load_maps(path)
    name = path.parent.name if path.name == MAPS_FILE else path.stem
    with tqdm(total=len(maps.rotation), desc=name, unit="frame", leave=False, disable=None) as bar:
        try:
            return fused(
                maps,
                body,
                template=template,
                config=config,
                positions_only=args.positions_only,
                device=args.device,
                progress=bar.update,
            )
        except InputError as error:
            bar.close()
            raise InputError(f"{path}: {error}") from error


def _say(folder: Path, result: Fused) -> None:
    report = result.report
    print(f"{folder}  {report['frames']} frames, {report['seconds']:.1f} s")
