"""Canonical frames: what they remove, and that it comes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from render import InputError


@pytest.mark.parametrize("mode", ["root", "heading"])
def test_there_and_back(tube_clip: Clip, mode: str) -> None:
    frames = root_frames(tube_clip, mode)
    back = frames.to_world(frames.to_canonical(tube_clip.garment.vertices))
    np.testing.assert_allclose(back, tube_clip.garment.vertices, atol=1e-6)


@pytest.mark.parametrize("mode", ["root", "heading"])
def test_a_body_that_only_turns_and_walks_stays_at_rest(tube_clip: Clip, mode: str) -> None:
    poses = tube_clip.skeleton.poses.copy()
    poses[:, 1] = 0
    turn = Rotation.from_rotvec(poses[:, 0]).as_matrix()
    root = tube_clip.skeleton.joints_rest[0]
    body = (
        np.einsum("tab,nb->tna", turn, tube_clip.body.rest - root) + root + tube_clip.skeleton.trans[:, None]
    )
    walking = replace(
        tube_clip,
        skeleton=replace(tube_clip.skeleton, poses=poses),
        body=replace(tube_clip.body, vertices=body.astype(np.float32)),
    )
    canonical = root_frames(walking, mode).to_canonical(walking.body.vertices)
    np.testing.assert_allclose(canonical, np.broadcast_to(tube_clip.body.rest, canonical.shape), atol=1e-6)


def test_root_removes_the_tilt_and_heading_keeps_it(tube_clip: Clip) -> None:
    tilt, turn = Rotation.from_rotvec([0.4, 0, 0]), Rotation.from_rotvec([0, 1.1, 0])
    poses = tube_clip.skeleton.poses.copy()
    poses[:, 0] = (turn * tilt).as_rotvec()
    tilted = replace(tube_clip, skeleton=replace(tube_clip.skeleton, poses=poses))
    np.testing.assert_allclose(root_frames(tilted, "root").rotation[0], (turn * tilt).as_matrix(), atol=1e-6)
    np.testing.assert_allclose(root_frames(tilted, "heading").rotation[0], turn.as_matrix(), atol=1e-6)


def test_a_rigid_body_without_poses_is_followed_exactly(tube_clip: Clip) -> None:
    turn, shift = Rotation.from_rotvec([0.3, -0.8, 0.2]), np.array([1.0, 2.0, 3.0])
    body = (turn.apply(tube_clip.body.rest) + shift)[None].astype(np.float32)
    still = replace(
        tube_clip,
        garment=None,
        body=replace(tube_clip.body, vertices=body),
        skeleton=replace(tube_clip.skeleton, poses=None, trans=None),
    )
    frames = root_frames(still, "root")
    np.testing.assert_allclose(frames.rotation[0], turn.as_matrix(), atol=1e-6)
    np.testing.assert_allclose(frames.to_canonical(body)[0], tube_clip.body.rest, atol=1e-5)


@pytest.mark.parametrize("mode", ["root", "heading"])
@pytest.mark.parametrize("missing", ["joints_rest", "trans"])
def test_poses_without_the_joint_or_its_place_keep_the_rotation_and_find_the_place(
    tube_clip: Clip, mode: str, missing: str
) -> None:
    """The root joint rests at (0, 0.1, 0): with (0, 0, 0) in its place a tilted body would be off by centimetres."""
    turn = Rotation.from_rotvec([[0.9, 0.2 * t, 0.4] for t in range(tube_clip.n_frames)])
    poses = tube_clip.skeleton.poses.copy()
    poses[:, 0], poses[:, 1] = turn.as_rotvec(), 0
    root, trans = tube_clip.skeleton.joints_rest[0], tube_clip.skeleton.trans
    body = np.einsum("tab,nb->tna", turn.as_matrix(), tube_clip.body.rest - root) + root + trans[:, None]
    whole = replace(
        tube_clip,
        skeleton=replace(tube_clip.skeleton, poses=poses),
        body=replace(tube_clip.body, vertices=body.astype(np.float32)),
    )
    partial = replace(whole, skeleton=replace(whole.skeleton, **{missing: None}))
    wanted, frames = root_frames(whole, mode), root_frames(partial, mode)
    np.testing.assert_array_equal(frames.rotation, wanted.rotation)
    # Of the heading, what is turned back turns about another point: the place of the canonical body differs.
    if mode == "root":
        np.testing.assert_allclose(frames.translation, wanted.translation, atol=1e-6)
    middle = frames.to_canonical(partial.body.vertices).mean(axis=1)
    np.testing.assert_allclose(middle, np.broadcast_to(tube_clip.body.rest.mean(0), middle.shape), atol=0.02)


def test_one_frame_alone_has_the_frame_that_it_has_in_the_clip(tube_clip: Clip) -> None:
    unknown = replace(tube_clip, skeleton=replace(tube_clip.skeleton, poses=None))
    together, alone = root_frames(unknown, "root"), root_frames(unknown.slice(slice(3, 4)), "root")
    np.testing.assert_array_equal(alone.rotation[0], together.rotation[3])
    np.testing.assert_array_equal(alone.translation[0], together.translation[3])


def test_results_that_are_not_finite_do_not_reach_the_world(tube_clip: Clip) -> None:
    frames, vertices = root_frames(tube_clip, "root"), tube_clip.garment.vertices.copy()
    vertices[4, 7] = np.nan
    with pytest.raises(InputError, match=r"frame 4, vertex 7 is .* not finite"):
        frames.to_world(vertices)
