"""The user's garment and moving body as `simulate` and `dress` are told of them, as settings of a simulation."""

from __future__ import annotations

import argparse
from pathlib import Path

from imgtransfer.cli.mesh_options import OF_AXES, OF_SEQUENCES, chosen_motion_axes
from imgtransfer.config.loader import parse_config, read_yaml
from imgtransfer.garments.config import TemplateConfig
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.simulation.motion_config import FileMotions, SequenceFiles


def garment_settings(path: Path, args: argparse.Namespace, axes: Axes, *, name: str | None) -> TemplateConfig:
    """The user's garment mesh.

    Args:
        args: with weld, pinned, anyway and garment_object. axes: how the garment's file lies.
        name: of the garment in data sets; None is the file's.
    """
    return TemplateConfig(
        path=path,
        **{key: getattr(axes, key) for key in _said(axes)},
        object=args.garment_object,
        weld=args.weld,
        pinned=args.pinned,
        anyway=args.anyway,
        name=name,
    )


def with_sequence_options(
    settings: SequenceFiles, args: argparse.Namespace, axes: Axes
) -> SequenceFiles | None:
    """Settings of mesh sequences with what the arguments say; None where they say nothing.

    Raises:
        InputError: an unknown axis or unit of the frames.
    """
    chosen_motion_axes(args)  # names the option of what is no axis
    given = {name: getattr(args, name) for name in (*OF_SEQUENCES, "weld") if getattr(args, name)}
    if any(getattr(args, name) for name in OF_AXES):
        given |= {name: getattr(axes, name) for name in _said(axes)}
    if not given:
        return None
    kept = settings.model_dump(exclude_unset=True)
    if "scale" in given:
        kept.pop("unit", None)
    return SequenceFiles(**kept | given)


def with_joints(files: FileMotions, path: Path) -> FileMotions:
    """Settings of motion files, with the joints that a YAML file names.

    Raises:
        InputError: a file that cannot be read, or joints that are none of SMPL's.
    """
    content = read_yaml(path, "a YAML file of SMPL's joints and a BVH skeleton's names of them")
    joints = parse_config(FileMotions, {"joints": content}, str(path)).joints
    return files.model_copy(update={"joints": joints})


def _said(axes: Axes) -> set[str]:
    """What is given of axes; an axis that points up decides the one that is faced."""
    return set(axes.given) | ({"facing"} if "up" in axes.given else set())
