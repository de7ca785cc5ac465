"""Where vertices may go: above the obstacle's tangent planes below them, and nowhere if they are pinned."""

from __future__ import annotations

from typing import Any

import torch

from fusion.losses import collision_loss
from fusion.obstacles.cached import tracker_of
from fusion.obstacles.sdf import Obstacle
from fusion.obstacles.surface_contact import SurfaceContact
from fusion.solvers.energy import Energy
from fusion.solvers.recorder import Recorder, frames_last
from fusion.solvers.torn_cloth import torn_away
from fusion.topology import Topology

_FAR = 1.0  # metres: an obstacle is said to be so far from vertices that wait for the next query
_TOUCHING = 1e-5  # metres: a vertex nearer to its plane than this touches it
# Metres above the margin beyond which a vertex may keep an older plane, moved to where the obstacle can at most be: it
# hardly moves as far before the next query.
_REACHED = 0.003


class Contact:
    """An obstacle that is asked for only every few steps.

    In between, the surface below each vertex is its tangent plane; within the few millimetres that a vertex moves,
    that is as good. At the second query, where the cloth between vertices is in the obstacle although they are not,
    their planes are raised, and stay so, for the clean-up to do what is left: looking again at every query costs more
    than all else of it and leaves no less. At the first one, most of such cloth comes out with its vertices. Vertices
    so deep that the way out would tear them from the cloth around them have no plane until
    the second query; that cloth pulls them out on its side.

    Args:
        obstacle: one posed obstacle a frame.
        like: (T, N, 3), sets device and dtype.
        margin_m: metres of clearance that vertices keep.
        every_steps: steps between two queries.
        surface: finds where the cloth between vertices is in the obstacle; None: only vertices are kept out.
        loose: (N,) bool, vertices that may move; None for all.
        topology: of the cloth; None: no vertex waits.

    Attributes:
        normal: (T, N, 3) unit vectors away from the surface, 0 where it is too far to matter.
        offset: (T, N) metres: a vertex x is above its plane where normal · x is at least this.
        depth: (T,) metres, the collision term of equation 7 at the last query.
    """

    def __init__(
        self,
        obstacle: Obstacle,
        like: torch.Tensor,
        *,
        margin_m: float,
        every_steps: int,
        surface: SurfaceContact | None = None,
        loose: torch.Tensor | None = None,
        topology: Topology | None = None,
    ) -> None:
        self._tracker, self._margin, self._every = tracker_of(obstacle), margin_m, every_steps
        self._surface, self._topology, self._asked = surface, topology, False
        self._raised: torch.Tensor | None = None  # (T, N) metres by which planes are
        self._loose = like.new_ones(like.shape[1], dtype=torch.bool) if loose is None else loose
        self.normal = frames_last(*like.shape, like=like)
        self.offset = frames_last(*like.shape[:2], like=like)
        self.depth = self.normal.new_zeros(len(like))

    def due(self, step: int) -> bool:
        """Whether it is time for a query."""
        return step % self._every == 0

    def update_planes(self, vertices: torch.Tensor, going: torch.Tensor | None = None) -> None:
        """Take new planes at vertices (T, N, 3).

        Args:
            going: (T,) bool, frames that are not finished; the planes of others mean nothing afterwards. They are not
                asked about, so that what is known of a frame does not depend on those beside it. None: all.
        """
        # Obstacles want the numbers of a vertex side by side, not those of a group of frames.
        vertices = vertices.contiguous()
        near = self._tracker.near(vertices, self._margin + _REACHED, going)
        distance, normal = near.distance, near.direction
        depth = collision_loss(distance, margin_m=self._margin)
        self.depth = depth if going is None else torch.where(going, depth, self.depth)
        lift = (self._margin - distance).clamp(min=0) * self._loose
        if self._topology is not None and not self._asked:
            waiting = torn_away(vertices, lift[..., None] * normal, self._topology)
            normal, lift = normal * ~waiting[..., None], lift * ~waiting
            distance = torch.where(waiting, _FAR, distance)
        self.normal.copy_(normal)
        self.offset.copy_(_dot(normal, vertices) + (self._margin - distance))
        if self._surface is not None and self._asked:
            if self._raised is None:
                lifted = vertices + lift[..., None] * normal
                self._raised = self._heights(self._surface, lifted, distance + lift)
            self.offset += self._raised
        self._asked = True

    def measure(self, vertices: torch.Tensor) -> None:
        """Set the depth at vertices (T, N, 3), and leave the planes."""
        near = self._tracker.near(vertices.contiguous(), self._margin)
        self.depth = collision_loss(near.distance, margin_m=self._margin)

    def _heights(
        self, surface: SurfaceContact, vertices: torch.Tensor, distance: torch.Tensor
    ) -> torch.Tensor:
        """(T, N) metres by which planes are to be raised so that the cloth between vertices (T, N, 3) that are on or
        above them is outside.

        To where it is, whatever heights the vertices around have, if it is so far from the obstacle as they all are;
        but no vertex higher than the least move that brings it out.
        """
        contacts = surface.find(vertices, distance)
        if contacts is None:
            return torch.zeros_like(distance)
        step = contacts.lifts(vertices, self._loose, torch.zeros_like(vertices))
        height = torch.minimum(contacts.even_heights(distance), distance + _dot(step, self.normal))
        return (height - self._margin).clamp(min=0) * self._loose


def _dot(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """(T, N) products of vectors (T, N, 3), summed in one order, where torch's own depends on T and on the strides."""
    x, y, z = (first * second).unbind(-1)
    return x + y + z


class ConstrainedStep:
    """Steps of the vertices of an energy along the directions that planes and pins leave open to them.

    Args:
        energy: its `active` frames move, its `gradient` presses vertices against their planes, its `vertices`
            are where steps lead.
        loose: (N,) bool, vertices that may move; None for all.
        contact: the obstacle; None without.

    Attributes:
        vertices: (T, N, 3), from where steps go.
        direction: (T, N, 3), along which.
        length: (T,), how far.
        gradient: (T, N, 3), the energy's at `vertices`.
        open_gradient: (T, N, 3), what of the gradient is open.
    """

    def __init__(self, energy: Energy, loose: torch.Tensor | None, contact: Contact | None) -> None:
        like = energy.vertices
        self.vertices, self.gradient, self.direction, self.open_gradient = (
            frames_last(*like.shape, like=like) for _ in range(4)
        )
        self.length = frames_last(len(like), like=like)
        self.length.fill_(1)
        self._planes, self._loose = contact and (contact.normal, contact.offset), loose
        self._advance = record = Recorder(like, energy.busy)
        vertices, _, *limits = self.limits(record)[:-1]
        moving, length = record.frames(energy.active), record.frames(self.length)
        target, direction = record.frames(energy.vertices), record.frames(self.direction)
        record("advance", like.shape[1], moving, vertices, direction, length, *limits, target)

    def limits(self, record: Recorder) -> list[Any]:
        """What tells which directions are open, for kernels: vertices, gradient, planes, pins, and what touches."""
        normal, offset = map(record.frames, self._planes) if self._planes else (None, None)
        loose = None if self._loose is None else record.ints(self._loose)
        return [record.frames(self.vertices), record.frames(self.gradient), normal, offset, loose, _TOUCHING]

    def advance(self) -> None:
        """Put the energy's vertices where the step leads, and out of the obstacle."""
        self._advance.run()
