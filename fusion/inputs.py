"""What a garment is fused from and with: maps, surfaces to stay outside of, pins, a start, the lengths to keep.

All of it is in one frame of coordinates, that of the maps, in metres. Arrays are NumPy's or PyTorch's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from render.errors import InputError

Array = np.ndarray | torch.Tensor


@dataclass(frozen=True, eq=False, init=False)
class DecodedMaps:
    """Maps of T frames from S views of H × W pixels, as quantities and no longer as colours.

    Args:
        positions: (T, S, H, W, 3) metres (decoded by their box).
        normals: (T, S, H, W, 3) in [-1, 1]; only their directions count.
        confidence: (T, S, H, W) at least 0, what each pixel counts in the readings of the position maps, in holding
            vertices to their readings, and in the normal term; 1 is as usual, and everywhere 1 is as None. Pixels
            with 0 are ignored, and vertices of which nothing else shows are treated as unseen.

    Attributes:
        positions, normals, confidence: float32 on the CPU; None where not given.

    Raises:
        InputError: something that is no array of numbers.
    """

    positions: torch.Tensor | None
    normals: torch.Tensor | None
    confidence: torch.Tensor | None

    def __init__(
        self, positions: Array | None = None, normals: Array | None = None, confidence: Array | None = None
    ) -> None:
        object.__setattr__(self, "positions", _optional(positions, "DecodedMaps: positions"))
        object.__setattr__(self, "normals", _optional(normals, "DecodedMaps: normals"))
        object.__setattr__(self, "confidence", _optional(confidence, "DecodedMaps: confidence"))

    @property
    def empty(self) -> bool:
        """Whether there is neither a position nor a normal map."""
        return self.positions is None and self.normals is None

    def part(self, frames: slice) -> DecodedMaps:
        """Some of the frames."""
        return DecodedMaps(
            _part(self.positions, frames), _part(self.normals, frames), _part(self.confidence, frames)
        )


@dataclass(frozen=True, eq=False, init=False)
class MovingSurface:
    """A mesh in T poses, one a frame: a body, or a garment that is worn beneath another.

    Args:
        vertices: (T, B, 3) metres.
        faces: (G, 3) integers, counter-clockwise seen from outside.

    Attributes:
        vertices: float32 on the CPU.
        faces: a NumPy array.

    Raises:
        InputError: something that is no array of numbers.
    """

    vertices: torch.Tensor
    faces: np.ndarray

    def __init__(self, vertices: Array, faces: Array) -> None:
        object.__setattr__(self, "vertices", _floats(vertices, "MovingSurface: vertices"))
        object.__setattr__(self, "faces", _array(faces))

    def part(self, frames: slice) -> MovingSurface:
        """Some of the frames."""
        return MovingSurface(self.vertices[frames], self.faces)


@dataclass(frozen=True, eq=False, init=False)
class PinnedVertices:
    """Vertices of the garment that are held exactly.

    Args:
        indices: (P,) integers, which ones, counted from 0.
        positions: (T, P, 3) metres, where; None: where they start.

    Attributes:
        indices: a tensor on the CPU.
        positions: float32 on the CPU, or None.

    Raises:
        InputError: something that is no array of numbers.
    """

    indices: torch.Tensor
    positions: torch.Tensor | None

    def __init__(self, indices: Array, positions: Array | None = None) -> None:
        object.__setattr__(self, "indices", _tensor(indices, "PinnedVertices: indices"))
        object.__setattr__(self, "positions", _optional(positions, "PinnedVertices: positions"))

    def part(self, frames: slice) -> PinnedVertices:
        """Some of the frames."""
        return PinnedVertices(self.indices, _part(self.positions, frames))


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class FusionInputs:
    """What `fuse` is given for T frames. Whether it fits the template and its cameras, `fusion.input_checks` says.

    Args:
        maps: positions, normals and confidence.
        body: what the garment must stay outside of.
        inner: another garment worn beneath, whose outer surface this one stays outside of.
        pins: vertices that are held exactly.
        initial: (T, N, 3) metres, vertices to start from in place of position maps.
        rest: (N, 3) metres, the garment whose edge lengths are kept, where it is not the imager's template: the same
            garment refitted to another body. Pixels and cameras stay the imager's.
        first_frame: the number of the first of these frames in their clip, for messages.
        fps: frames a second, for what is measured in seconds; not needed beside a map file, which has it.
        contact_offset_m: metres off the skin at which the cloth rests where it touches, such as a simulator's contact
            offset: the margin of the second stage where the configuration names none. None: unknown.

    Attributes:
        maps: without any map where none is given.
        body, inner, pins: None where not given.
        initial: float32 on the CPU, or None.
        rest: a NumPy array, or None.

    Raises:
        InputError: something that is no array of numbers.
    """

    maps: DecodedMaps
    body: MovingSurface | None
    inner: MovingSurface | None
    pins: PinnedVertices | None
    initial: torch.Tensor | None
    rest: np.ndarray | None
    first_frame: int
    fps: float | None
    contact_offset_m: float | None

    def __init__(
        self,
        *,
        maps: DecodedMaps | None = None,
        body: MovingSurface | None = None,
        inner: MovingSurface | None = None,
        pins: PinnedVertices | None = None,
        initial: Array | None = None,
        rest: Array | None = None,
        first_frame: int = 0,
        fps: float | None = None,
        contact_offset_m: float | None = None,
    ) -> None:
        object.__setattr__(self, "maps", DecodedMaps() if maps is None else maps)
        object.__setattr__(self, "body", body)
        object.__setattr__(self, "inner", inner)
        object.__setattr__(self, "pins", pins)
        object.__setattr__(self, "initial", _optional(initial, "fuse: initial"))
        object.__setattr__(self, "rest", None if rest is None else _array(rest))
        object.__setattr__(self, "first_frame", first_frame)
        object.__setattr__(self, "fps", fps)
        object.__setattr__(self, "contact_offset_m", contact_offset_m)

    @property
    def n_frames(self) -> int:
        """T, as what has one value a frame says; 0 if nothing has."""
        return next(iter(self.frame_counts().values()), 0)

    def frame_counts(self) -> dict[str, int]:
        """How many frames there are of all that has one value a frame, by name; of what it starts from first."""
        by_frame = {
            "positions": self.maps.positions,
            "initial": self.initial,
            "normals": self.maps.normals,
            "confidence": self.maps.confidence,
            "body.vertices": None if self.body is None else self.body.vertices,
            "inner.vertices": None if self.inner is None else self.inner.vertices,
            "pins.positions": None if self.pins is None else self.pins.positions,
        }
        return {
            name: values.shape[0] if values.ndim else 0
            for name, values in by_frame.items()
            if values is not None
        }

    def part(self, frames: slice) -> FusionInputs:
        """Some of the frames; what is the same in all of them stays."""
        return replace(
            self,
            maps=self.maps.part(frames),
            body=None if self.body is None else self.body.part(frames),
            inner=None if self.inner is None else self.inner.part(frames),
            pins=None if self.pins is None else self.pins.part(frames),
            initial=_part(self.initial, frames),
            first_frame=self.first_frame + frames.indices(self.n_frames)[0],
        )


def _array(values: Array) -> np.ndarray:
    return np.asarray(values.detach().cpu() if isinstance(values, torch.Tensor) else values)


def _tensor(values: Array, name: str) -> torch.Tensor:
    """On the CPU, in the dtype that it has."""
    try:
        return torch.as_tensor(values).detach().cpu()
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{name} must be an array of numbers, found {type(values).__name__}") from error


def _floats(values: Array, name: str) -> torch.Tensor:
    """Float32 on the CPU."""
    return _tensor(values, name).to(torch.float32)


def _optional(values: Array | None, name: str) -> torch.Tensor | None:
    return None if values is None else _floats(values, name)


def _part(values: torch.Tensor | None, frames: slice) -> torch.Tensor | None:
    return None if values is None else values[frames]
