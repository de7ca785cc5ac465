"""Clips of a moving body whose frames are made when they are asked for."""

from dataclasses import replace

import numpy as np
import pytest

from imgtransfer.bodies.config import make_body
from imgtransfer.data.clip_parts import Template
from imgtransfer.dressing.readers import MeshReader, PosedReader
from imgtransfer.motions.library import make_motion
from render import Mesh, MeshSequence
from tests.helpers import synthetic
from tests.helpers.clips import assert_same_clip

TEMPLATE = Template(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))


@pytest.fixture(scope="module")
def posed():
    motion = replace(make_motion("walk", seed=1, seconds=1), leg_length=0.8)
    return PosedReader(
        name="cloth/walk",
        template=TEMPLATE,
        body=make_body(),
        motion=motion,
        frames=range(3, 20, 2),
        fps=15.0,
        info={"source": "a test"},
    )


def test_a_posed_body_is_that_of_its_skeleton_where_the_motion_is(posed):
    clip, motion = posed.clip(), posed.motion
    numbers = list(posed.frames)
    expected = posed.body.pose(motion.poses[numbers], motion.trans[numbers], leg_length=0.8)
    np.testing.assert_array_equal(clip.body.vertices, expected.vertices)
    root = clip.skeleton.joints_rest[0] + clip.skeleton.trans
    np.testing.assert_allclose(root, expected.joints[:, 0], atol=1e-5)
    assert (clip.fps, clip.name, clip.n_frames, clip.garment) == (15.0, "cloth/walk", 9, None)


@pytest.mark.parametrize("count", [1, 4, 9, 50])
def test_parts_are_the_whole(posed, count):
    whole, done = posed.clip(), 0
    for part in posed.parts(count):
        assert_same_clip(part, whole.slice(slice(done, done + count)))
        done += part.n_frames
    assert done == posed.n_frames == 9


def test_a_body_of_meshes():
    body = synthetic.tube_clip(5).body
    sequence = MeshSequence.of_array(Mesh(body.rest, body.faces), body.vertices.astype(np.float64))
    reader = MeshReader(
        name="cloth/walk", template=TEMPLATE, body=sequence.selected(slice(1, None)), fps=24.0
    )
    assert reader.n_frames == 4
    np.testing.assert_array_equal(reader.clip(1, 3).body.vertices, body.vertices[2:4])
    parts = [part.body.vertices for part in reader.parts(3)]
    assert [len(part) for part in parts] == [3, 1]
    np.testing.assert_array_equal(np.concatenate(parts), body.vertices[1:])
    np.testing.assert_array_equal(reader.clip(0, 1).body.rest, body.rest)
