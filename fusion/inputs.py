"""What `fuse` is given, checked once."""

from __future__ import annotations

import numpy as np
import torch

from render.errors import InputError
from render.imager import TemplateImager

Array = np.ndarray | torch.Tensor


class FusionInputs:
    """The arguments of `fuse`, checked, as float32 tensors on the CPU; None where not given.

    Background pixels of the maps are 0 here, whatever they held.

    Raises:
        InputError: as `fuse` says.
    """

    def __init__(
        self,
        imager: TemplateImager,
        *,
        positions: Array | None,
        normals: Array | None,
        initial: Array | None,
        body_vertices: Array | None,
        body_faces: Array | None,
    ) -> None:
        if (positions is None) == (initial is None):
            raise InputError("fuse: give position maps or initial vertices to start from, and not both")
        if (body_vertices is None) != (body_faces is None):
            raise InputError("fuse: body_vertices and body_faces belong together, found only one of them")
        start = positions if positions is not None else initial
        assert start is not None
        self.n_frames = len(start)
        maps = (self.n_frames, *imager.mask.shape, 3)
        mask = imager.mask
        self.positions = _checked("positions", positions, maps, mask)
        self.normals = _checked("normals", normals, maps, mask)
        self.initial = _checked("initial", initial, (self.n_frames, len(imager.mesh.vertices), 3))
        n_body = 0 if body_vertices is None else int(body_vertices.shape[-2])
        self.body_vertices = _checked("body_vertices", body_vertices, (self.n_frames, n_body, 3))
        self.body_faces = body_faces
        if self.n_frames == 0:
            raise InputError("fuse: no frames; the first axis of the maps is the frame")


def _checked(
    name: str, values: Array | None, shape: tuple[int, ...], mask: torch.Tensor | None = None
) -> torch.Tensor | None:
    """Float32 on the CPU; InputError for another shape, or a value that is not finite (under the mask)."""
    if values is None:
        return None
    tensor = torch.as_tensor(values).detach().to("cpu", torch.float32)
    if tuple(tensor.shape) != shape:
        raise InputError(f"fuse: {name} must have shape {shape}, found {tuple(tensor.shape)}")
    finite = torch.isfinite(tensor).all(-1)
    bad = ~finite if mask is None else ~finite & mask
    if bool(bad.any()):
        first = bad.nonzero()[0].tolist()
        raise InputError(
            f"fuse: {name} has {int(bad.sum())} values that are not finite, the first at {first}"
        )
    return tensor if mask is None else torch.where(mask[..., None], tensor, 0.0)
