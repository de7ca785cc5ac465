"""What `fuse` is given, checked once."""

from __future__ import annotations

import copy

import numpy as np
import torch

from render.errors import InputError
from render.limits import FARTHEST
from render.maps.imager import TemplateImager
from render.mesh.mesh import Mesh, check_faces, check_finite

Array = np.ndarray | torch.Tensor

# By which factor the edges of one garment may differ between body shapes; centimetres are a hundred times metres.
_SHAPES_DIFFER = 3.0
# The arguments with one value a frame.
_BY_FRAME = (
    "positions",
    "normals",
    "initial",
    "confidence",
    "pinned_positions",
    "body_vertices",
    "inner_vertices",
)
_LIMITS = {"normals": 1e4, "confidence": 1e6}  # no unit; all else is in metres


class FusionInputs:
    """The arguments of `fuse` for T frames, checked; None where not given.

    Attributes:
        n_frames: T.
        first: the number of the first of them in their clip.
        rest: the garment whose edge lengths are kept; the imager's template where none is given.
        positions, normals: (T, S, H, W, 3) float32 on the CPU, finite in the background too, whatever it held.
        confidence: (T, S, H, W) float32 on the CPU, at least 0, 0 in the background.
        initial: (T, N, 3) float32 on the CPU.
        pinned: (P,) int64 on the CPU, different vertices; None for P = 0 too.
        pinned_positions: (T, P, 3) float32 on the CPU; None where pinned vertices stay where they start.
        body_vertices, inner_vertices: (T, B, 3) and (T, M, 3) float32 on the CPU.
        body_faces, inner_faces: (G, 3) and (K, 3) int64 arrays.

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
        rest: Array | None = None,
        confidence: Array | None = None,
        pinned: Array | None = None,
        pinned_positions: Array | None = None,
        body_vertices: Array | None = None,
        body_faces: Array | None = None,
        inner_vertices: Array | None = None,
        inner_faces: Array | None = None,
    ) -> None:
        self._imager = imager
        self.rest = _checked_rest(rest, imager.mesh)
        self.pinned = _checked_pins(pinned, pinned_positions, len(imager.mesh.vertices))
        self.body_faces = _faces("body", body_vertices, body_faces)
        self.inner_faces = _faces("inner", inner_vertices, inner_faces)
        self._take(
            0,
            positions=positions,
            normals=normals,
            initial=initial,
            confidence=confidence,
            pinned_positions=pinned_positions,
            body_vertices=body_vertices,
            inner_vertices=inner_vertices,
        )
        for name in ("body", "inner"):
            vertices, faces = getattr(self, f"{name}_vertices"), getattr(self, f"{name}_faces")
            if faces is not None:
                check_faces(faces, vertices.shape[1], f"{name}_faces")
                setattr(self, f"{name}_faces", faces.astype(np.int64))

    def others(self, first: int, **frames: Array | None) -> FusionInputs:
        """Other frames of the same garment, pins and surfaces.

        Args:
            first: the number of the first of them, for messages.
            frames: by argument, what has one value a frame; the same arguments as these frames were made with.
        """
        found = copy.copy(self)
        found._take(first, **{name: frames.get(name) for name in _BY_FRAME})
        return found

    def part(self, frames: slice) -> FusionInputs:
        """Some of these frames."""
        found = copy.copy(self)
        for name in _BY_FRAME:
            values = getattr(self, name)
            setattr(found, name, None if values is None else values[frames])
        chosen = range(*frames.indices(self.n_frames))
        found.first, found.n_frames = self.first + chosen.start, len(chosen)
        return found

    def _take(
        self,
        first: int,
        *,
        positions: Array | None,
        normals: Array | None,
        initial: Array | None,
        confidence: Array | None,
        pinned_positions: Array | None,
        body_vertices: Array | None,
        inner_vertices: Array | None,
    ) -> None:
        """Check what has one value a frame; `first` is the number of the first frame."""
        if (positions is None) == (initial is None):
            raise InputError("fuse: give position maps or initial vertices to start from, and not both")
        start = positions if positions is not None else initial
        assert start is not None
        if start.ndim == 0 or len(start) == 0:
            raise InputError("fuse: no frames; the first axis of the maps is the frame")
        self.n_frames, self.first = len(start), first
        mask = self._imager.mask
        maps = (self.n_frames, *mask.shape, 3)
        self.positions = self._checked("positions", positions, maps, mask)
        self.normals = self._checked("normals", normals, maps, mask)
        self.confidence = self._checked_confidence(confidence, mask)
        self.initial = self._checked("initial", initial, (self.n_frames, len(self.rest.vertices), 3))
        self.pinned_positions = self.body_vertices = self.inner_vertices = None
        if self.pinned is not None:
            shape = (self.n_frames, len(self.pinned), 3)
            self.pinned_positions = self._checked("pinned_positions", pinned_positions, shape)
        if self.body_faces is not None:
            self.body_vertices = self._checked_surface("body", body_vertices)
        if self.inner_faces is not None:
            self.inner_vertices = self._checked_surface("inner", inner_vertices)

    def _checked_confidence(self, values: Array | None, mask: torch.Tensor) -> torch.Tensor | None:
        """Refuse negative weights, and frames in which no pixel counts."""
        if values is not None and self.positions is None and self.normals is None:
            raise InputError("fuse: confidence belongs to maps, found neither positions nor normals")
        confidence = self._checked("confidence", values, (self.n_frames, *mask.shape), mask)
        if confidence is None:
            return None
        confidence = torch.where(mask, confidence, 0.0)
        if bool((confidence < 0).any()):
            raise InputError(
                f"fuse: confidence must be at least 0 (1 is as usual), found {float(confidence.min())}"
            )
        empty = (confidence == 0).flatten(1).all(1)
        if bool(empty.any()):
            raise InputError(
                f"fuse: confidence is 0 at every covered pixel of frame {self.first + int(empty.nonzero()[0])}; "
                "leave it out"
            )
        return confidence

    def _checked_surface(self, name: str, vertices: Array | None) -> torch.Tensor | None:
        """One surface a frame."""
        count = int(vertices.shape[-2]) if vertices is not None and vertices.ndim > 1 else 0
        return self._checked(f"{name}_vertices", vertices, (self.n_frames, count, 3))

    def _checked(
        self, name: str, values: Array | None, shape: tuple[int, ...], mask: torch.Tensor | None = None
    ) -> torch.Tensor | None:
        """Float32 on the CPU; InputError for another shape, or values not finite or beyond a limit (under the mask).

        The mask (S, H, W) says which of axes 1 to 3 of `values` count; others become 0 if any is not finite.
        """
        if values is None:
            return None
        tensor = torch.as_tensor(values).detach().to("cpu", torch.float32)
        if tuple(tensor.shape) != shape:
            raise InputError(f"fuse: {name} must have shape {shape}, found {tuple(tensor.shape)}")
        limit = _LIMITS.get(name, FARTHEST)
        finite = tensor.abs() <= limit  # NaN is not
        if bool(finite.all()):
            return tensor
        if len(shape) != 4:
            finite = finite.all(-1)
        bad = ~finite if mask is None else ~finite & mask
        if mask is None or bool(bad.any()):
            frame, *place = bad.nonzero()[0].tolist()
            raise InputError(
                f"fuse: {name} has {int(bad.sum())} values that are not finite or beyond ±{limit:g}, the first at "
                f"{[self.first + frame, *place]}"
            )
        return torch.where(mask[..., None] if len(shape) == 5 else mask, tensor, 0.0)


def _checked_pins(pinned: Array | None, positions: Array | None, n_vertices: int) -> torch.Tensor | None:
    if pinned is None:
        if positions is not None:
            raise InputError("fuse: pinned_positions need pinned, the numbers of these vertices")
        return None
    tensor = torch.as_tensor(pinned).detach().cpu()
    if tensor.numel() == 0:
        return None
    if tensor.ndim != 1 or tensor.is_floating_point() or tensor.dtype == torch.bool:
        raise InputError(
            f"fuse: pinned must be whole numbers (P,), found {tensor.dtype} {tuple(tensor.shape)}"
        )
    tensor = tensor.long()
    bad = tensor[(tensor < 0) | (tensor >= n_vertices)]
    if len(bad):
        raise InputError(f"fuse: pinned names vertex {int(bad[0])}, but the template has 0..{n_vertices - 1}")
    numbers, counts = tensor.unique(return_counts=True)
    if len(numbers) < len(tensor):
        raise InputError(f"fuse: pinned names vertex {int(numbers[counts > 1][0])} more than once")
    return tensor


def _faces(name: str, vertices: Array | None, faces: Array | None) -> np.ndarray | None:
    """The faces of a surface that moves: vertices and faces are given, or neither."""
    if vertices is None and faces is None:
        return None
    if vertices is None or faces is None:
        raise InputError(f"fuse: {name}_vertices and {name}_faces belong together, found only one of them")
    return np.asarray(faces.detach().cpu() if isinstance(faces, torch.Tensor) else faces)


def _checked_rest(rest: Array | None, template: Mesh) -> Mesh:
    """The rest shape as a mesh; InputError unless its edges are about as long as the template's."""
    if rest is None:
        return template
    vertices = np.asarray(rest.detach().cpu() if isinstance(rest, torch.Tensor) else rest, np.float64)
    if vertices.shape != template.vertices.shape:
        raise InputError(f"fuse: rest must have shape {template.vertices.shape}, found {vertices.shape}")
    check_finite(vertices, "fuse: rest")
    mesh = Mesh(vertices, template.faces, "fuse: rest")
    rests, templates = (
        np.median(np.linalg.norm(np.diff(m.vertices[m.edges], axis=1), axis=-1)) for m in (mesh, template)
    )
    if not templates / _SHAPES_DIFFER <= rests <= templates * _SHAPES_DIFFER:
        raise InputError(
            f"fuse: the edges of rest are {rests:.3g} m long (median), those of the template {templates:.3g} m; "
            "the same garment is wanted, refitted to another body, in metres"
        )
    return mesh
