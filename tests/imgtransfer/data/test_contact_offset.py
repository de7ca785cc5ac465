"""How far off the skin cloth rests, by boxes whose distances are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from imgtransfer.data.contact_offset import contact_offset, of_clips
from tests.helpers.synthetic import tube_clip

BOX = trimesh.creation.box((2.0, 2.0, 2.0))
FACES = np.asarray(BOX.faces)


def above(*metres: float) -> np.ndarray:
    """(N, 3), N up to 25: points over the box's upper side, so far off."""
    return np.array([[0.04 * number, 1 + height, 0.2] for number, height in enumerate(metres)])


def of(*frames: np.ndarray) -> float | None:
    """Of garments (N, 3), a frame each, over the box."""
    garment = np.stack(frames)
    return contact_offset([(garment, np.repeat(BOX.vertices[None], len(garment), axis=0), FACES)])


def test_a_twentieth_of_the_vertices_are_nearer() -> None:
    """21 points: the second lowest has one of twenty steps below it."""
    assert of(above(0.004, *[0.006] * 20)) == pytest.approx(0.006, abs=1e-6)
    assert of(above(0.004, 0.005, *[0.006] * 19)) == pytest.approx(0.005, abs=1e-6)
    assert of(above(-0.5, 0.005, *[0.3] * 19)) == pytest.approx(0.005, abs=1e-6)  # one squeezed, most far


def test_of_several_frames_the_middle_one_counts() -> None:
    low, middle, high = (above(*[height] * 21) for height in (0.001, 0.005, 0.3))
    assert of(low, high, middle) == pytest.approx(0.005, abs=1e-6)


def test_a_rigid_motion_of_both_changes_nothing() -> None:
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
    garment, body = (
        points @ turn.T + [3, 1, 2] for points in (above(*[0.005] * 21), np.asarray(BOX.vertices))
    )
    assert contact_offset([(garment[None], body[None], FACES)]) == pytest.approx(0.005, abs=1e-6)


def test_cloth_that_comes_nowhere_near_says_nothing_and_cloth_in_the_body_rests_on_it() -> None:
    assert of(above(*[0.021] * 21)) is None
    assert contact_offset([]) is None
    assert of(above(*[-0.01] * 21)) == 0


def test_a_body_turned_inside_out_does_not_count() -> None:
    worn = above(*[0.005] * 21)[None], np.asarray(BOX.vertices)[None]
    assert contact_offset([(*worn, FACES[:, ::-1])]) is None
    assert contact_offset([(*worn, FACES[:, ::-1]), (*worn, FACES)]) == pytest.approx(0.005, abs=1e-6)


def test_of_clips_it_is_that_of_their_frames() -> None:
    clip = tube_clip(girth=0.3)  # 12 mm off the body, and 15 at the ripple's crests
    garment = clip.garment
    assert garment is not None
    known = contact_offset([(garment.vertices, clip.body.vertices, clip.body.faces)])
    assert known == pytest.approx(0.012, abs=0.001)
    assert of_clips([clip, replace(clip, garment=None)]) == known
    assert of_clips([replace(clip, garment=None)]) is None
