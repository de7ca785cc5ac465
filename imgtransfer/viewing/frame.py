"""What is shown at one time: a garment in a pose, with what it is measured against and made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch

from fusion.obstacles import EdgeCrossings
from imgtransfer.viewing.colours import Colours, Strain, error_mm
from render import Mesh, TemplateImager
from render.mesh.mesh import edges_of


@dataclass(frozen=True, eq=False)
class MapImages:
    """Encoded maps of one frame, for eyes.

    Args:
        views: S names.
        position, normal: (S, H, W, 3) from 0 to 1, background 0; None where there are none.
        mask: (S, H, W) bool.
    """

    views: tuple[str, ...]
    position: np.ndarray | None
    normal: np.ndarray | None
    mask: np.ndarray

    def pictures(self, kind: str) -> list[np.ndarray]:
        """S pictures (H, W, 3) uint8 on white of the kind "positions" or "normals"; none where there are none."""
        images = self.position if kind == "positions" else self.normal
        if images is None:
            return []
        shown = np.where(self.mask[..., None], images, 1.0)
        return list((np.clip(shown, 0, 1) * 255).round().astype(np.uint8))


@dataclass(frozen=True, eq=False)
class Frame:
    """A garment on a body, metres, world.

    Args:
        garment: (N, 3); None where a clip has only a body.
        body: (B, 3).
        truth: (N, 3), where the garment should be; None where nobody knows.
        maps: makes or reads the frame's maps.
    """

    garment: np.ndarray | None
    body: np.ndarray
    truth: np.ndarray | None
    maps: Callable[[], MapImages | None]


class Motion(Protocol):
    """Frames to show, whatever they come from."""

    @property
    def title(self) -> str:
        """What the page calls it."""
        ...

    @property
    def dress(self) -> Dress:
        """The garment and the body that move."""
        ...

    @property
    def n_frames(self) -> int:
        """How many there are."""
        ...

    def frame(self, number: int) -> Frame:
        """One of them.

        Raises:
            InputError: it cannot be read.
        """
        ...


@dataclass(frozen=True, eq=False)
class Dress:
    """What does not change from frame to frame.

    Args:
        rest: the garment at rest, in the shape of the body.
        body: the body at rest.
        imager: of the garment's template, made when it is first asked for; None where no maps belong to it.
    """

    rest: Mesh
    body: Mesh
    imager: Callable[[], TemplateImager | None]

    @cached_property
    def _strain(self) -> Strain:
        return Strain(self.rest)

    @cached_property
    def _through_body(self) -> EdgeCrossings:
        return EdgeCrossings(self.rest.edges, self.body.faces, len(self.body.vertices))

    @cached_property
    def _of_body(self) -> EdgeCrossings:
        return EdgeCrossings(
            edges_of(self.body.faces), self.rest.faces, len(self.rest.vertices), name="garment"
        )

    @cached_property
    def _through_itself(self) -> EdgeCrossings:
        return EdgeCrossings(self.rest.edges, self.rest.faces, len(self.rest.vertices), itself=True)

    def values(self, frame: Frame, colours: Colours) -> np.ndarray | None:
        """(F,) what the faces' colours stand for; None where nothing is known, or the cloth has its own colour."""
        if frame.garment is None:
            return None
        if colours == "error" and frame.truth is not None:
            return error_mm(frame.garment, frame.truth, self.rest.faces)
        return self._strain.percent(frame.garment) if colours == "strain" else None

    def crossing_edges(self, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
        """Ends (E, 2, 3), metres, of the edges of garment or body that pass through the other, and of the garment's
        own that pass through itself.
        """
        if frame.garment is None:
            return np.zeros((0, 2, 3)), np.zeros((0, 2, 3))
        cloth, skin = _batch(frame.garment), _batch(frame.body)
        through = frame.garment[self.rest.edges[self._through_body.query(cloth, skin).marks()[0].numpy()]]
        edges = edges_of(self.body.faces)
        of_body = frame.body[edges[self._of_body.query(skin, cloth).marks()[0].numpy()]]
        itself = frame.garment[self.rest.edges[self._through_itself.query(cloth).marks()[0].numpy()]]
        return np.concatenate([through, of_body]), itself


def _batch(vertices: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(vertices, np.float32))[None]
