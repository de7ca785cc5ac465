"""Whether what `fuse` is given fits a template and its cameras, and holds numbers that can be meant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from fusion.inputs import DecodedMaps, FusionInputs, MovingSurface, PinnedVertices
from render.errors import InputError
from render.limits import FARTHEST, check_contact_offset
from render.maps.imager import TemplateImager
from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh, check_faces, check_finite

# By which factor the edges of one garment may differ between body shapes; centimetres are a hundred times metres.
_SHAPES_DIFFER = 3.0
_LARGEST_NORMAL, _HEAVIEST = 1e4, 1e6  # a normal's component, a confidence


def checked(inputs: FusionInputs, imager: TemplateImager) -> FusionInputs:
    """The same inputs, checked: maps are finite in the background too, where confidence is 0; no pins are None.

    `rest` is checked where its mesh is made, once and not with every batch: `rest_mesh`.

    Args:
        inputs: of T frames.
        imager: of the template, N vertices, with S cameras of H × W pixels.

    Raises:
        InputError: as `fuse` says.
    """
    maps, initial, n_frames = inputs.maps, inputs.initial, inputs.n_frames
    if (maps.positions is None) == (initial is None):
        raise InputError("fuse: give position maps or initial vertices to start from, and not both")
    if n_frames == 0:
        raise InputError("fuse: no frames; the first axis of the maps is the frame")
    if inputs.contact_offset_m is not None:
        check_contact_offset(inputs.contact_offset_m, "fuse")
    n_vertices, first = len(imager.mesh.vertices), inputs.first_frame
    if initial is not None:
        _check_points("initial", initial, (n_frames, n_vertices, 3), first)
    return replace(
        inputs,
        maps=_checked_maps(maps, n_frames, imager.mask, first),
        body=_checked_surface("body", inputs.body, n_frames, first),
        inner=_checked_surface("inner", inputs.inner, n_frames, first),
        pins=_checked_pins(inputs.pins, n_frames, n_vertices, first),
    )


def rest_mesh(rest: np.ndarray | None, template: Mesh) -> Mesh:
    """The garment whose edge lengths are kept.

    Args:
        rest: (N, 3) metres; None for the template as it is.
        template: its faces, and about how long edges are.

    Raises:
        InputError: another shape, values that are not finite, or edges that are not about as long as the template's.
    """
    if rest is None:
        return template
    if rest.shape != template.vertices.shape:
        raise InputError(f"fuse: rest must have shape {template.vertices.shape}, found {rest.shape}")
    check_finite(rest, "fuse: rest")
    mesh = Mesh(rest, template.faces, "fuse: rest")
    rests, templates = (np.median(edge_lengths(m.vertices, m.edges)) for m in (mesh, template))
    if not templates / _SHAPES_DIFFER <= rests <= templates * _SHAPES_DIFFER:
        raise InputError(
            f"fuse: the edges of rest are {rests:.3g} m long (median), those of the template {templates:.3g} m; "
            "the same garment is wanted, refitted to another body, in metres"
        )
    return mesh


def _checked_maps(maps: DecodedMaps, n_frames: int, mask: torch.Tensor, first: int) -> DecodedMaps:
    if maps.empty and maps.confidence is not None:
        raise InputError("fuse: confidence belongs to maps, found neither positions nor normals")
    shape = (n_frames, *mask.shape)
    positions, normals, confidence = maps.positions, maps.normals, maps.confidence
    if positions is not None:
        positions = _checked_images("positions", positions, (*shape, 3), mask, first=first, limit=FARTHEST)
    if normals is not None:
        normals = _checked_images("normals", normals, (*shape, 3), mask, first=first, limit=_LARGEST_NORMAL)
    if confidence is not None:
        confidence = _checked_images("confidence", confidence, shape, mask, first=first, limit=_HEAVIEST)
        confidence = torch.where(mask, confidence, 0.0)
        _check_counts(confidence, first)
    return DecodedMaps(positions, normals, confidence)


def _check_counts(confidence: torch.Tensor, first: int) -> None:
    """Refuse negative weights, and frames in which no pixel counts; (T, S, H, W), 0 in the background."""
    if bool((confidence < 0).any()):
        raise InputError(
            f"fuse: confidence must be at least 0 (1 is as usual), found {float(confidence.min())}"
        )
    empty = (confidence == 0).flatten(1).all(1)
    if bool(empty.any()):
        raise InputError(
            f"fuse: confidence is 0 at every covered pixel of frame {first + int(empty.nonzero()[0])}; "
            "leave it out"
        )


def _checked_surface(
    name: str, surface: MovingSurface | None, n_frames: int, first: int
) -> MovingSurface | None:
    if surface is None:
        return None
    vertices = surface.vertices
    count = int(vertices.shape[-2]) if vertices.ndim > 1 else 0
    _check_points(f"{name}.vertices", vertices, (n_frames, count, 3), first)
    check_faces(surface.faces, count, f"fuse: {name}.faces")
    return surface


def _checked_pins(
    pins: PinnedVertices | None, n_frames: int, n_vertices: int, first: int
) -> PinnedVertices | None:
    if pins is None or pins.indices.numel() == 0:
        return None
    indices = pins.indices
    if indices.ndim != 1 or indices.is_floating_point() or indices.dtype == torch.bool:
        raise InputError(
            f"fuse: pins.indices must be whole numbers (P,), found {indices.dtype} {tuple(indices.shape)}"
        )
    indices = indices.long()
    bad = indices[(indices < 0) | (indices >= n_vertices)]
    if len(bad):
        raise InputError(
            f"fuse: pins.indices names vertex {int(bad[0])}, but the template has 0..{n_vertices - 1}"
        )
    numbers, counts = np.unique(indices.numpy(), return_counts=True)
    if len(numbers) < len(indices):
        raise InputError(f"fuse: pins.indices names vertex {int(numbers[counts > 1][0])} more than once")
    if pins.positions is not None:
        _check_points("pins.positions", pins.positions, (n_frames, len(indices), 3), first)
    return PinnedVertices(indices, pins.positions)


def _check_points(name: str, points: torch.Tensor, shape: tuple[int, ...], first: int) -> None:
    """Refuse points (T, N, 3) of another shape, not finite, or farther than anything lies."""
    _check_shape(name, points, shape)
    usable = (points.abs() <= FARTHEST).all(-1)  # NaN is not
    if not bool(usable.all()):
        raise _out_of_range(name, ~usable, FARTHEST, first)


def _checked_images(
    name: str, images: torch.Tensor, shape: tuple[int, ...], mask: torch.Tensor, *, first: int, limit: float
) -> torch.Tensor:
    """Refuse values beyond a limit where the mask (S, H, W) is; elsewhere all become 0 if any is not finite."""
    _check_shape(name, images, shape)
    least, most = images.aminmax()  # a NaN makes both one; nothing as large as the images is made
    if -limit <= float(least) and float(most) <= limit:
        return images
    usable = images.abs() <= limit  # NaN is not
    inside = mask
    if len(shape) == 5:
        usable, inside = usable.all(-1), mask[..., None]
    bad = ~usable & mask
    if bool(bad.any()):
        raise _out_of_range(name, bad, limit, first)
    return torch.where(inside, images, 0.0)


def _check_shape(name: str, values: torch.Tensor, shape: tuple[int, ...]) -> None:
    if tuple(values.shape) != shape:
        raise InputError(f"fuse: {name} must have shape {shape}, found {tuple(values.shape)}")


def _out_of_range(name: str, bad: torch.Tensor, limit: float, first: int) -> InputError:
    """The error for `bad` (T, ...), where the values are; the first of T frames is number `first`."""
    frame, *place = bad.nonzero()[0].tolist()
    return InputError(
        f"fuse: {name} has {int(bad.sum())} values that are not finite or beyond ±{limit:g}, the first at "
        f"{[first + frame, *place]}"
    )
