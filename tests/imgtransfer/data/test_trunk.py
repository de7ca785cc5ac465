"""The motion of a body's trunk: exact for rigid bodies, little moved by limbs, each frame by itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.data.trunk import Trunk
from render.mesh.measures import area_fractions
from render.mesh.rigid import rigid_rotation
from tests.helpers.synthetic import tube

RANDOM = np.random.default_rng(3)
TURNS = Rotation.random(4, random_state=5).as_matrix()
SHIFTS = RANDOM.normal(size=(4, 3))


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A box of 8 vertices and 12 faces."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    return np.array(low) + corners * (np.array(high) - np.array(low)), faces


def figure() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A trunk with two arms and two legs, all boxes of fine triangles: vertices, faces, and which limb (0: trunk)."""
    lows = [
        (-0.2, -0.35, -0.1),
        (0.22, 0.2, -0.05),
        (-0.82, 0.2, -0.05),
        (0.02, -1.1, -0.08),
        (-0.18, -1.1, -0.08),
    ]
    highs = [
        (0.2, 0.35, 0.1),
        (0.82, 0.3, 0.05),
        (-0.22, 0.3, 0.05),
        (0.18, -0.37, 0.08),
        (-0.02, -0.37, 0.08),
    ]
    points, faces, limbs = [], [], []
    for number, (low, high) in enumerate(zip(lows, highs, strict=True)):
        limb, triangles = tube(1.0, 1.0, 12, 12, closed=True)
        extent = np.ptp(limb, axis=0)
        limb = (limb - limb.min(axis=0)) / extent * (np.array(high) - low) + low
        faces.append(triangles + sum(map(len, points)))
        points.append(limb)
        limbs.append(np.full(len(limb), number))
    return np.concatenate(points), np.concatenate(faces), np.concatenate(limbs)


def rigid(points: np.ndarray, turns: np.ndarray = TURNS, shifts: np.ndarray = SHIFTS) -> np.ndarray:
    return np.einsum("tab,nb->tna", turns, points) + shifts[:, None]


def gesturing(points: np.ndarray, limbs: np.ndarray, frames: int) -> np.ndarray:
    """The figure with its limbs turned by up to two radians, each about where it hangs on the trunk."""
    moved = np.repeat(points[None], frames, axis=0)
    for limb in range(1, 5):
        own = limbs == limb
        hinge = points[own][np.argmin(np.linalg.norm(points[own], axis=1))]
        for frame in range(frames):
            turn = Rotation.from_rotvec(RANDOM.uniform(-1.2, 1.2, 3)).as_matrix()
            moved[frame, own] = (points[own] - hinge) @ turn.T + hinge
    return moved


def test_a_rigid_motion_is_found_exactly() -> None:
    points, faces, _ = figure()
    rotation, translation = Trunk(points, faces).motion(rigid(points))
    np.testing.assert_allclose(rotation, TURNS, atol=1e-12)
    np.testing.assert_allclose(translation, SHIFTS, atol=1e-12)


def test_a_body_at_rest_stays_where_it_is() -> None:
    points, faces, _ = figure()
    rotation, translation = Trunk(points, faces).motion(points[None])
    np.testing.assert_allclose(rotation[0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(translation[0], 0, atol=1e-12)


def test_limbs_that_move_have_little_part_in_it() -> None:
    """The trunk is still; the rigid fit to the whole body is off by a hundred times as much."""
    points, faces, limbs = figure()
    frames = gesturing(points, limbs, 6)
    rotation, translation = Trunk(points, faces).motion(frames)
    trunk = points[limbs == 0]
    off = np.linalg.norm(rigid(trunk, rotation, translation) - trunk, axis=-1).mean(axis=1)
    whole = [rigid_rotation(points, frame) for frame in frames]
    shifts = [frame.mean(0) - turn @ points.mean(0) for turn, frame in zip(whole, frames, strict=True)]
    before = np.linalg.norm(rigid(trunk, np.stack(whole), np.stack(shifts)) - trunk, axis=-1).mean(axis=1)
    assert off.max() < 1e-3
    assert before.mean() > 0.1


def test_it_moves_with_the_body_that_gestures_on_its_way() -> None:
    points, faces, limbs = figure()
    trunk, frames = Trunk(points, faces), gesturing(points, limbs, 4)
    rotation, translation = trunk.motion(frames)
    moving = np.einsum("tab,tnb->tna", TURNS, frames) + SHIFTS[:, None]
    further, shifted = trunk.motion(moving)
    np.testing.assert_allclose(further, TURNS @ rotation, atol=1e-9)
    np.testing.assert_allclose(shifted, np.einsum("tab,tb->ta", TURNS, translation) + SHIFTS, atol=1e-9)


def test_a_batch_equals_its_frames_one_by_one_bit_for_bit() -> None:
    points, faces, limbs = figure()
    frames, trunk = gesturing(points, limbs, 3), Trunk(points, faces)
    for number, together in enumerate(zip(*trunk.motion(frames), strict=True)):
        for one, of_batch in zip(trunk.motion(frames[number : number + 1]), together, strict=True):
            np.testing.assert_array_equal(one[0], of_batch)


def test_equals_a_plain_loop() -> None:
    """The weights and the fit written out for one frame, as the docstring has them."""
    points, faces, limbs = figure()
    frame = gesturing(points, limbs, 1)[0]
    area = area_fractions(points, faces)
    centre = sum(a * p for a, p in zip(area, points, strict=True))
    distance = np.array([np.sqrt(((p - centre) ** 2).sum()) for p in points])
    near, total = 0.0, 0.0
    for vertex in np.argsort(distance):
        total, near = total + area[vertex], distance[vertex]
        if total >= 0.1:
            break
    nearness = np.exp(-((distance / near) ** 2))
    nearness[nearness <= 1e-3 * nearness.max()] = 0
    radius = np.sqrt(sum(a * d * d for a, d in zip(area, distance, strict=True)))
    weights = area * nearness
    for _ in range(20):
        weights = weights / weights.sum()
        before, after = weights @ points, weights @ frame
        left, _, right = np.linalg.svd((weights[:, None] * (frame - after)).T @ (points - before))
        rotation = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
        shift = after - rotation @ before
        off = ((points @ rotation.T + shift - frame) ** 2).sum(1)
        weights = area * nearness / (1 + off / (0.01 * radius) ** 2) ** 2
    found, translation = Trunk(points, faces).motion(frame[None])
    np.testing.assert_allclose(found[0], rotation, atol=1e-9)
    np.testing.assert_allclose(translation[0], shift, atol=1e-9)


def test_with_a_known_rotation_only_the_place_is_found() -> None:
    points, faces, limbs = figure()
    frames = np.einsum("tab,tnb->tna", TURNS, gesturing(points, limbs, 4)) + SHIFTS[:, None]
    rotation, translation = Trunk(points, faces).motion(frames, TURNS)
    np.testing.assert_array_equal(rotation, TURNS)
    np.testing.assert_allclose(translation, SHIFTS, atol=1e-3)


def test_a_body_of_eight_vertices_that_are_all_as_far_from_the_centre() -> None:
    points, faces = box((-1, -1, -1), (1, 1, 1))
    rotation, translation = Trunk(points, faces).motion(rigid(points))
    np.testing.assert_allclose(rotation, TURNS, atol=1e-12)
    np.testing.assert_allclose(translation, SHIFTS, atol=1e-12)


def test_a_body_in_two_pieces_with_nothing_at_its_centre() -> None:
    left, faces = box((2, 0, 0), (2.3, 1, 0.2))
    points = np.concatenate([left, left * [-1, 1, 1]])
    rotation, translation = Trunk(points, np.concatenate([faces, faces[:, ::-1] + 8])).motion(rigid(points))
    np.testing.assert_allclose(rotation, TURNS, atol=1e-12)
    np.testing.assert_allclose(translation, SHIFTS, atol=1e-12)


@pytest.mark.parametrize(
    "points", [np.zeros((4, 3)), np.outer(np.arange(4.0), [1, 2, 3])], ids=["a point", "a line"]
)
def test_a_body_without_area_is_no_crash(points: np.ndarray) -> None:
    rotation, translation = Trunk(points, np.array([[0, 1, 2], [1, 2, 3]])).motion(rigid(points))
    np.testing.assert_allclose(np.linalg.det(rotation), 1)
    np.testing.assert_allclose(rigid(points, rotation, translation), rigid(points), atol=1e-9)


def test_vertices_that_no_face_uses_do_not_count() -> None:
    points, faces, _ = figure()
    stray = np.concatenate([points, [[0.0, 0.0, 0.0]]])
    frames = np.concatenate([rigid(points), np.full((4, 1, 3), 50.0)], axis=1)
    rotation, translation = Trunk(stray, faces).motion(frames)
    np.testing.assert_allclose(rotation, TURNS, atol=1e-12)
    np.testing.assert_allclose(translation, SHIFTS, atol=1e-12)
