"""The methods by their names: those of this package, and those that other packages offer by entry points."""

from __future__ import annotations

import importlib
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from imgtransfer.deformers.base import Deformer
from render import InputError
from render.errors import said_by

GROUP = "imgtransfer.deformers"  # of the entry points
NETWORK = "image_transfer"  # this project's own, which has trainings of its own
_HERE = "imgtransfer.deformers"
BUILT_IN = {
    NETWORK: f"{_HERE}.image_transfer:ImageTransfer",
    "lbs": f"{_HERE}.lbs:Lbs",
    "pose_regression": f"{_HERE}.pose_regression:PoseRegression",
    "virtual_bones": f"{_HERE}.virtual_bones:VirtualBones",
    "anchordef": f"{_HERE}.anchordef:AnchorDef",
    "jointnet": f"{_HERE}.jointnet:JointNet",
    "motion_guided": f"{_HERE}.motion_guided:MotionGuided",
    "pointnet": f"{_HERE}.vertex_network:PointNet",
    "gcn": f"{_HERE}.vertex_network:GraphNetwork",
}


def deformer_names() -> list[str]:
    """All names, those of this package first."""
    return [*BUILT_IN, *(name for name in sorted(_entry_points()) if name not in BUILT_IN)]


def deformer_class(name: Any) -> type[Deformer]:
    """The method of a name; nothing is imported for the others.

    Raises:
        InputError: no such method, or one of another package that cannot be imported or is none.
    """
    if isinstance(name, str) and name in BUILT_IN:
        module, _, attribute = BUILT_IN[name].partition(":")
        built_in: type[Deformer] = getattr(importlib.import_module(module), attribute)
        return built_in
    entry = _entry_points().get(name) if isinstance(name, str) else None
    if entry is None:
        raise InputError(f"method.name: no method {name!r}; there are {', '.join(deformer_names())}")
    try:
        loaded = entry.load()
    except Exception as error:  # whatever another package's module raises
        raise InputError(
            f"method.name: {name} cannot be imported from {entry.value} ({said_by(error)})"
        ) from error
    if not (isinstance(loaded, type) and issubclass(loaded, Deformer)):
        raise InputError(
            f"method.name: {name} is {entry.value}, which is no subclass of imgtransfer.deformers.Deformer"
        )
    return loaded


def _entry_points() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}
