"""What `imgtransfer dress` is told, as the settings of one simulated figure: body, garment, and how files are read."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from imgtransfer.bodies.config import AnnyConfig, BodyConfig, SmplConfig
from imgtransfer.cli.mesh_options import chosen_axes
from imgtransfer.cli.mesh_settings import garment_settings, with_joints, with_sequence_options
from imgtransfer.config.loader import parse_config
from imgtransfer.dressing.settling import SOLVER
from imgtransfer.dressing.source import is_motion_file
from imgtransfer.garments.config import (
    DressConfig,
    GarmentConfig,
    MadeConfig,
    SkirtConfig,
    TrousersConfig,
    TShirtConfig,
)
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.simulation.config import ClothConfig, SimulateConfig
from imgtransfer.simulation.motion_config import FileMotions, SequenceFiles
from render import InputError
from render.files.mesh_files import SUFFIXES as MESHES
from render.files.scenes.reader import SUFFIXES as SCENES
from render.limits import FASTEST, SLOWEST

GARMENTS: dict[str, type[MadeConfig]] = {
    "tshirt": TShirtConfig,
    "dress": DressConfig,
    "trousers": TrousersConfig,
    "skirt": SkirtConfig,
}
_MOST_BETAS = 300  # of any SMPL model


def figure_settings(args: argparse.Namespace) -> SimulateConfig:
    """The settings that the arguments make.

    Raises:
        InputError: values that make no sense, or a garment that is neither one of the project's nor a file.
    """
    if args.fps is not None and not SLOWEST <= args.fps <= FASTEST:
        raise InputError(
            f"--fps {args.fps:g}: {SLOWEST:g} to {FASTEST:g} frames a second are wanted; most files have 24 to 120"
        )
    axes, of_garment = chosen_axes(args)
    files = FileMotions() if args.joints is None else with_joints(FileMotions(), args.joints)
    if args.arms_out is not None:
        files = parse_config(
            FileMotions, files.model_dump() | {"arms_out": args.arms_out}, f"--arms-out {args.arms_out:g}"
        )
    if is_motion_file(args.motion) and args.motion_up is not None:
        if args.motion_up not in ("y", "z"):
            raise InputError(f"--motion-up {args.motion_up}: a motion file has y or z up")
        files = files.model_copy(update={"up_axis": args.motion_up})
    return SimulateConfig(
        fps=args.fps or 30.0,
        body=body_settings(args.body, args.smpl),
        garment=_garment(args, of_garment or axes),
        cloth=ClothConfig(fabric=args.fabric) if args.fabric else ClothConfig(),
        solver=SOLVER,
        files=files,
        sequences=with_sequence_options(SequenceFiles(), args, axes) or SequenceFiles(),
    )


def _garment(args: argparse.Namespace, axes: Axes) -> GarmentConfig:
    named = GARMENTS.get(args.garment)
    if named is not None:
        return named(detail="small")
    path = Path(args.garment)
    if not path.is_file():
        near = "no such file" if path.suffix.lower() in (*MESHES, *SCENES) else "no garment of the project's"
        raise InputError(
            f"--garment {args.garment}: {near}; {', '.join(GARMENTS)} or a mesh file (OBJ, PLY, GLB, STL, Alembic, "
            "USD) is wanted"
        )
    return garment_settings(path, args, axes, name=None)


def body_settings(text: str | None, smpl: Path | None) -> BodyConfig:
    """The body that `--body` and `--smpl` ask for.

    Args:
        text: "seed:7", or "weight=0.8,height=0.3" by the names of `AnnyShape`; of SMPL "beta0=1.5,gender=female". None
            is the default shape.
        smpl: a model file or the folder of such; None is the body that comes with the package.

    Raises:
        InputError: another form, a name that there is none of, or a value out of its range.
    """
    said = f"--body {text}"
    if smpl is not None:
        return parse_config(SmplConfig, {"path": smpl, **_of_smpl(text, said)}, said if text else "--smpl")
    if text is None:
        return AnnyConfig()
    seed = re.fullmatch(r"seed:(\d{1,18})", text, re.ASCII)
    if seed is not None:
        return parse_config(AnnyConfig, {"seed": int(seed[1])}, said)
    shape = {name: _number(value, said) for name, value in _pairs(text, said)}
    return parse_config(AnnyConfig, {"shape": shape}, said)


def _of_smpl(text: str | None, said: str) -> dict[str, object]:
    """Gender and coefficients, those that are not named 0."""
    settings: dict[str, object] = {}
    betas: dict[int, float] = {}
    for name, value in [] if text is None else _pairs(text, said):
        number = re.fullmatch(r"beta(\d{1,3})", name, re.ASCII)
        if name == "gender":
            settings["gender"] = value
        elif number is not None and int(number[1]) < _MOST_BETAS:
            betas[int(number[1])] = _number(value, said)
        else:
            raise InputError(
                f"{said}: {name} is none of a SMPL body's; wanted are gender, beta0, beta1 and so on"
            )
    if betas:
        settings["betas"] = [betas.get(number, 0.0) for number in range(max(betas) + 1)]
    return settings


def _pairs(text: str, said: str) -> list[tuple[str, str]]:
    """ "weight=0.8,height=0.3" -> names and values.

    Raises:
        InputError: another form, or a name twice.
    """
    pairs = [part.partition("=") for part in text.split(",")]
    names = [name.strip() for name, _, _ in pairs]
    if not all(equals for _, equals, _ in pairs) or len(set(names)) < len(names):
        raise InputError(
            f"{said}: seed:NUMBER, or names and values such as weight=0.8,height=0.3, each name once, are wanted"
        )
    return [(name, value.strip()) for name, (_, _, value) in zip(names, pairs, strict=True)]


def _number(text: str, said: str) -> float:
    if re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)", text, re.ASCII) is None or len(text) > 20:
        raise InputError(f"{said}: {text or 'nothing'} is no number; one such as 0.8 is wanted")
    return float(text)
