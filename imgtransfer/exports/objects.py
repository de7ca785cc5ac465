"""The moving meshes of a clip, as the files that they came from have them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imgtransfer.data.clip import Clip
from render import Mesh
from render.mesh.surface import Surface, plain_surface

COLOURS = {"body": (0.80, 0.66, 0.56, 1.0), "garment": (0.23, 0.42, 0.68, 1.0)}  # linear RGBA


@dataclass(frozen=True, eq=False)
class MovingObject:
    """One mesh of an animation; its vertices come frame by frame.

    Args:
        name: "garment" or "body", which programs call the object.
        rest: the mesh at rest, N vertices.
    """

    name: str
    rest: Mesh

    @property
    def surface(self) -> Surface:
        """Faces, texture coordinates and materials in the numbering of the file that the mesh came from."""
        return self.rest.surface or plain_surface(self.rest.faces, len(self.rest.vertices))

    def moved(self, part: Clip) -> np.ndarray:
        """(t, N, 3) float32 metres: the mesh in the frames of a part of its clip, in the numbering of the clip."""
        if self.name == "body":
            return part.body.vertices
        assert part.garment is not None  # as in the first part
        return part.garment.vertices

    def of_file(self, part: Clip) -> np.ndarray:
        """(t, M, 3) float32 metres: the same in the numbering of `surface`."""
        return self.surface.of_file(self.moved(part))


def objects_of(clip: Clip) -> list[MovingObject]:
    """The body, and the garment where the clip has one in motion."""
    body = MovingObject("body", Mesh(clip.body.rest, clip.body.faces, source=clip.name))
    return [body] if clip.garment is None else [body, MovingObject("garment", clip.template_mesh)]
