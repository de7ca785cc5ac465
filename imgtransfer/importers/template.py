"""A user's own garment mesh, ready to be put on a body: placed, checked and welded."""

from __future__ import annotations

from pathlib import Path

from imgtransfer.importers.axes import Axes
from imgtransfer.importers.check import check_template
from imgtransfer.importers.findings import Say, refuse
from imgtransfer.importers.weld import weld
from render import Mesh, load_mesh


def as_setting(name: str, value: str) -> str:
    """An option as a garment's configuration has it."""
    return f"`{name.removeprefix('garment-')}: {value or 'true'}`"


def load_template(
    path: str | Path,
    body: Mesh,
    *,
    axes: Axes | None = None,
    body_axes: Axes | None = None,
    welding: bool = False,
    anyway: bool = False,
    say: Say = as_setting,
) -> tuple[Mesh, list[str]]:
    """Read a garment and check it against the body that shall wear it.

    Args:
        path: OBJ, PLY, GLB or STL.
        body: in its rest pose, metres, y up, facing +z; its `source` is what messages call it.
        axes: how the file lies; None for metres, y up, facing +z.
        body_axes: how the body's file lay, where it came from one.
        welding: join split seams.
        anyway: take it although the checks found something.
        say: how messages name an option of the garment and its value.

    Returns:
        The garment in metres, y up, facing +z, with texture coordinates, materials and the file's numbering in its
        `surface`; and what is odd about it but no obstacle, one text each, for the user to read.

    Raises:
        InputError: a file that cannot be read, or severe findings; the message names the settings that mend them.
    """
    axes = axes or Axes()
    garment = axes.of_mesh(load_mesh(path))
    found = check_template(garment, body, given=body_axes, garment_given=axes, welding=welding, say=say)
    notes = refuse(found, anyway=anyway, hint=f" ({say('anyway', '')} goes on all the same)")
    return (weld(garment).mesh if welding else garment), notes
