"""The moving garment or the moving body of a clip, checked against its rest pose before its frames are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.checks.weld import weld, weld_motion
from render import InputError, Mesh, load_mesh
from render.files.frame_files import frame_files, read_moving_mesh
from render.files.point_caches import SUFFIXES as CACHES
from render.mesh.mesh import check_finite


@dataclass(frozen=True, eq=False)
class MovedPart:
    """A part with all its frames, metres, y up, facing +z.

    Args:
        rest: the mesh in the rest pose, welded if asked for, with its surface.
        vertices: (T, N, 3) float32. fps: where the file tells, else None.
    """

    rest: Mesh
    vertices: np.ndarray
    fps: float | None


@dataclass(frozen=True, eq=False)
class Part:
    """What is known before the frames are read. Make one with `open`.

    Args:
        moving: folder, pattern or point cache of the frames.
        first: the first frame, or the mesh that a cache moves; in the file's units and axes.
        rest: in the rest pose; metres, y up, facing +z.
        axes: how the files lie.
    """

    moving: Path
    first: Mesh
    rest: Mesh
    axes: Axes

    @classmethod
    def open(cls, what: str, moving: Path, rest: Path | None, axes: Axes) -> Part:
        """Read the first frame and the rest pose.

        Args:
            what: "garment" or "body". rest: a mesh file; None takes the first frame.

        Raises:
            InputError: files that cannot be read, a cache without the mesh that it moves, or a rest pose that is not
                the frames' mesh.
        """
        first = _first(what, moving, rest)
        resting = load_mesh(rest) if rest else first
        if len(first.vertices) != len(resting.vertices) or not np.array_equal(first.faces, resting.faces):
            raise InputError(
                f"{first.source}: {len(first.vertices)} vertices, {len(first.faces)} triangles, but "
                f"{resting.source} has {len(resting.vertices)} and {len(resting.faces)}, or others; the rest pose "
                f"must be the {what}'s own mesh"
            )
        return cls(moving, first, axes.of_mesh(resting), axes)

    def read(self, *, welding: bool = False, progress: Callable[[int], object] | None = None) -> MovedPart:
        """Read all frames.

        Args:
            welding: join split seams. progress: called with 1 after each file.

        Raises:
            InputError: what `read_moving_mesh` refuses, values not finite, or welded seams that part.
        """
        moving = read_moving_mesh(self.moving, topology=self.first, progress=progress)
        vertices = self.axes.apply(moving.vertices)
        check_finite(vertices, str(self.moving))
        if not welding:
            return MovedPart(self.rest, vertices, moving.fps)
        welded = weld(self.rest)
        return MovedPart(welded.mesh, weld_motion(vertices, welded, source=str(self.moving)), moving.fps)


def _first(what: str, moving: Path, rest: Path | None) -> Mesh:
    if moving.suffix.lower() not in CACHES:
        return load_mesh(frame_files(moving)[0])
    if rest is None:
        name = "template" if what == "garment" else "body_rest"
        raise InputError(
            f"{moving}: a point cache has no triangles; put the mesh that it moves beside it as {name}.obj"
        )
    return load_mesh(rest)
