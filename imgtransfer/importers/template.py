"""A user's own garment mesh, ready to be put on a body: placed, checked and welded."""

from __future__ import annotations

from pathlib import Path

from imgtransfer.importers.axes import Axes
from imgtransfer.importers.check import check_template
from imgtransfer.importers.findings import refuse
from imgtransfer.importers.weld import weld
from render import Mesh, load_mesh


def load_template(
    path: str | Path, body: Mesh, *, axes: Axes | None = None, welding: bool = False
) -> tuple[Mesh, list[str]]:
    """Read a garment and check it against the body that shall wear it.

    Args:
        path: OBJ, PLY, GLB or STL.
        body: in its rest pose, metres, y up, facing +z; its `source` is what messages call it.
        axes: how the file lies; None for metres, y up, facing +z.
        welding: join split seams.

    Returns:
        The garment in metres, y up, facing +z, with texture coordinates, materials and the file's numbering in its
        `surface`; and what is odd about it but no obstacle, one text each, for the user to read.

    Raises:
        InputError: a file that cannot be read, or severe findings; the message names the settings of a garment's
            configuration that mend them.
    """
    axes = axes or Axes()
    garment = axes.of_mesh(load_mesh(path))
    found = check_template(garment, body, garment_given=axes, welding=welding, say=_as_setting)
    notes = refuse(found, hint="")
    return (weld(garment).mesh if welding else garment), notes


def _as_setting(name: str, value: str) -> str:
    """An option as a garment's configuration has it."""
    return f"`{name.removeprefix('garment-')}: {value or 'true'}`"
