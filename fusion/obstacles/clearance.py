"""The last clean-up: no vertex stays in the body, or below the garment beneath."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from fusion.obstacles.edge_limits import EdgeLimits
from fusion.obstacles.lifting import SdfCache, followed, lifted, padded_places, smoothed
from fusion.obstacles.sdf import Obstacle
from fusion.obstacles.surface_contact import SurfaceContact, SurfaceContacts
from fusion.topology import Topology

# Metres of depth up to which the first round lifts; the reach doubles with every round, and the last two have no limit.
_REACH = 0.02
# Rounds for the cloth between vertices, in multiples of those for vertices: most end after three or four.
_BETWEEN = 2
# Metres above its clearance up to which a vertex is not pushed towards what is below it.
_TOUCHING = 5e-4
# After so many rounds what still crosses is taken for tangled; and rounds for the vertices that are smoothed then.
_TANGLED, _VERTEX_ROUNDS = 7, 6
# Rounds in which edges are made shorter at the end, and cloth is put outside again.
_SHORTENINGS = 4
# Of the search at the end: directions tried at every distance, and in metres the first distance, the ratio of each
# distance to the one before, and the last one.
_DIRECTIONS, _NEAREST, _RATIO, _UTMOST = 64, 1e-3, 1.25, 4.0


@dataclass(frozen=True, eq=False)
class Clearance:
    """What `lift_clear` did.

    Args:
        vertices: (T, N, 3), metres.
        rounds: in which vertices were lifted.
        queried: points that the obstacle was asked about in them, in multiples of T N.
        rounds_between: in which the cloth between vertices was, afterwards.
        relocated: (T, N) bool, vertices that no round got out and a search in all directions did.
        remaining: (T, N) bool, vertices still nearer than the clearance: pinned, or shut in on all sides.
        distance: (T, N) metres, signed distances at the end; of vertices that have clearance to spare, at least.
    """

    vertices: torch.Tensor
    rounds: int
    queried: float
    rounds_between: int
    relocated: torch.Tensor
    remaining: torch.Tensor
    distance: torch.Tensor


def clear_body(
    vertices: torch.Tensor,
    sdf: Obstacle,
    topology: Topology,
    *,
    clearance_m: float,
    rounds: int,
    fixed: torch.Tensor | None = None,
) -> torch.Tensor:
    """The vertices (T, N, 3), metres, of `lift_clear`, which explains the arguments."""
    return lift_clear(vertices, sdf, topology, clearance_m=clearance_m, rounds=rounds, fixed=fixed).vertices


def lift_clear(
    vertices: torch.Tensor,
    sdf: Obstacle,
    topology: Topology,
    *,
    clearance_m: float,
    rounds: int,
    fixed: torch.Tensor | None = None,
    surface: SurfaceContact | None = None,
) -> Clearance:
    """Lift vertices that are nearer to the body than `clearance_m`, or inside it.

    Each round lifts along the distance's gradient, or where that differs from the round before (the fold between arm
    and trunk), along the middle of both. Neighbours that have clearance themselves make half of its step,
    on average over their neighbours; in the last two rounds nothing follows, so that it cannot push anything back
    in. Vertices deeper than a reach, 2 cm at first and twice as much with every round, wait: the cloth around them,
    once it is out, pulls them along by their edges, so that they come out on its side. What is still inside after
    all rounds is put at the nearest clear place of a search in all directions.

    So afterwards no vertex but the pinned ones is nearer than `clearance_m`. Undefined is on which side a vertex comes
    out that is nearer to another side of the body and has no edge to cloth outside.

    Then the cloth between vertices: where an edge of it passes through the body, or an edge of the body through it, the
    least move of the vertices around brings it out (`SurfaceContact`), but not towards what they touch themselves, and
    others follow as above. What seven rounds do not bring out is tangled, such as an edge with its ends on two sides of
    an arm: vertices around it are put where their neighbours draw them, and lifted again. Most cloth is out after three
    or four rounds, and each looks only at what the one before moved; what twenty do not bring out stays.

    Where all this has made edges long, they are shortened and their cloth is brought out again, by turns; frames in
    which that ends outside and with shorter edges keep it.

    The garment may touch or cross itself afterwards: its collisions with itself are outside what the fusion solves.

    Args:
        vertices: (T, N, 3) metres, not changed.
        sdf: one posed obstacle a frame.
        topology: of the garment.
        clearance_m: metres, the distance that lifted vertices get.
        rounds: at most, and twice as many for the cloth between vertices; fewer where all is clear; 0 leaves
            everything as it is.
        fixed: (N,) bool, vertices that must not move; None holds none.
        surface: of this obstacle and topology, where it is used again; made anew if None.
    """
    loose = torch.ones(vertices.shape[1], dtype=torch.bool, device=vertices.device)
    if fixed is not None:
        loose = ~fixed.to(vertices.device)
    cache = SdfCache(vertices, sdf, clearance_m + _TOUCHING)
    number = _lift_vertices(cache, topology, clearance_m=clearance_m, rounds=rounds, loose=loose)
    relocated = torch.zeros_like(cache.distance, dtype=torch.bool)
    between = 0
    if rounds:
        relocated = move_to_clear_places(cache, (cache.distance < clearance_m) & loose, clearance_m)
    asked = cache.asked / max(cache.distance.numel(), 1)
    if rounds:
        surface = surface or SurfaceContact(sdf, topology, vertices.device)
        between = _lift_between(
            cache, surface, topology, clearance_m=clearance_m, rounds=_BETWEEN * rounds, loose=loose
        )
        limits = EdgeLimits(vertices, topology, loose)
        _shorten(cache, surface, limits, topology, clearance_m=clearance_m, loose=loose)
        relocated |= move_to_clear_places(cache, (cache.distance < clearance_m) & loose, clearance_m)
    remaining = cache.distance < clearance_m
    return Clearance(cache.vertices, number, asked, between, relocated, remaining, cache.distance)


def _lift_vertices(
    cache: SdfCache, topology: Topology, *, clearance_m: float, rounds: int, loose: torch.Tensor
) -> int:
    """Lift vertices `loose` (N,) or (T, N) that lack clearance, in so many rounds at most: how many it took."""
    for number in range(rounds):
        missing = (clearance_m - cache.distance) * loose
        if not bool((missing > 0).any()):
            return number
        last = number >= rounds - 2
        reach = float("inf") if last else _REACH * 2**number
        cache.move(lifted(cache, topology, missing, reach=reach, follow=not last, loose=loose))
    return rounds


def _lift_between(
    cache: SdfCache,
    surface: SurfaceContact,
    topology: Topology,
    *,
    clearance_m: float,
    rounds: int,
    loose: torch.Tensor,
) -> int:
    """Lift the cloth between its vertices out of the obstacle, and no vertex back into it: how many rounds it took."""
    moved = None
    for number in range(rounds):
        contacts = surface.find(cache.vertices, cache.distance, moved)
        if contacts is None:
            return number
        before = cache.vertices
        if number % _TANGLED == _TANGLED - 1 and number < rounds - 2:
            tangled = _around(contacts, before, topology, rings=1 + number // _TANGLED) & loose
            cache.move(smoothed(before, tangled, topology))
            left = _VERTEX_ROUNDS
        else:
            lift = contacts.lifts(before, loose, _walls(cache, clearance_m))
            if number < rounds - 2:
                lift = followed(lift, topology, ~(lift != 0).any(-1) & loose)
            cache.move(before + lift)
            left = 1
        # Only those frames: what becomes of one must not depend on which others it is solved with.
        touched = torch.zeros(len(before), dtype=torch.bool, device=before.device)
        touched[contacts.frame] = True
        _lift_vertices(cache, topology, clearance_m=clearance_m, rounds=left, loose=loose & touched[:, None])
        moved = (cache.vertices != before).any(-1)
    return rounds


def _shorten(
    cache: SdfCache,
    surface: SurfaceContact,
    limits: EdgeLimits,
    topology: Topology,
    *,
    clearance_m: float,
    loose: torch.Tensor,
) -> None:
    """Shorten edges that the rounds before have made too long, where nothing has to go back into the obstacle."""
    before, clear = cache.vertices, cache.distance >= clearance_m
    excess = limits.excess(before)
    going, done = excess > 0, torch.zeros_like(excess, dtype=torch.bool)
    for _ in range(_SHORTENINGS):
        if not bool(going.any()):
            break
        cache.move(limits.kept(cache.vertices, _walls(cache, clearance_m), going))
        _lift_vertices(cache, topology, clearance_m=clearance_m, rounds=1, loose=loose & going[:, None])
        moved = (cache.vertices != before).any(-1) & going[:, None]
        contacts = surface.find(cache.vertices, cache.distance, moved)
        out = ((cache.distance >= clearance_m) | ~clear).all(-1)
        if contacts is not None:
            out[contacts.frame] = False
        done |= going & out
        going &= ~out
        if contacts is not None:
            cache.move(cache.vertices + contacts.lifts(before, loose, _walls(cache, clearance_m)))
    done &= limits.excess(cache.vertices) < excess
    cache.move(torch.where(done[:, None, None], cache.vertices, before))


def _walls(cache: SdfCache, clearance_m: float) -> torch.Tensor:
    """(T, N, 3) unit vectors away from what vertices touch, 0 where that is nothing."""
    touching = (cache.distance < clearance_m + _TOUCHING)[..., None]
    return torch.where(touching, cache.direction, 0.0)


def _around(
    contacts: SurfaceContacts, vertices: torch.Tensor, topology: Topology, *, rings: int
) -> torch.Tensor:
    """(T, N) bool, which vertices (T, N, 3) have a contact, with so many rings of neighbours."""
    around = vertices.new_zeros(vertices.shape[:2])
    around[contacts.frame[:, None], contacts.corners] = 1
    for _ in range(rings):
        around = ((around + topology.adjacency(around[..., None])[..., 0]) > 0).to(around)
    return around > 0


def move_to_clear_places(cache: SdfCache, inside: torch.Tensor, clearance_m: float) -> torch.Tensor:
    """Move the vertices `inside` (T, N) each to its nearest clear place among a set of directions and distances.

    Args:
        cache: the vertices (T, N, 3) that are moved in it.
        inside: (T, N) bool, which of them.
        clearance_m: metres, the distance at which a place is clear.

    Returns:
        (T, N) bool, those that have one.
    """
    relocated = torch.zeros_like(inside)
    directions = _sphere(_DIRECTIONS).to(cache.vertices)
    distance = _NEAREST
    while bool(inside.any()) and distance < _UTMOST:
        places = padded_places(inside)
        spots = places[..., None].expand(-1, -1, 3)
        tried = cache.vertices.gather(1, spots)[:, :, None] + distance * directions
        clear = cache.ask(tried.flatten(1, 2)).reshape(tried.shape[:-1]) >= clearance_m
        out = clear.any(-1) & inside.gather(1, places)
        best = clear.to(torch.uint8).argmax(-1)[..., None, None].expand(-1, -1, 1, 3)
        target = torch.where(out[..., None], tried.gather(2, best)[:, :, 0], cache.vertices.gather(1, spots))
        relocated = relocated.scatter(1, places, out | relocated.gather(1, places))
        cache.move(cache.vertices.scatter(1, spots, target))
        inside = inside & ~relocated
        distance *= _RATIO
    return relocated


def _sphere(count: int) -> torch.Tensor:
    """(count, 3) unit vectors spread evenly."""
    k = torch.arange(count, dtype=torch.float64)
    up, angle = 1 - (2 * k + 1) / count, k * torch.pi * (3 - 5**0.5)
    around = (1 - up.square()).sqrt()
    return torch.stack([around * angle.cos(), up, around * angle.sin()], dim=1)
