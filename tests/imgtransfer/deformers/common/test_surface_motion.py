"""How a body's surface moves at a vertex."""

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip_parts import Body
from imgtransfer.deformers.common.surface_motion import surface_motion
from tests.helpers.synthetic import tube, tube_clip


def test_a_rigid_motion_is_seen_at_every_vertex():
    rest, faces = tube(0.2, 1.0, 6, 8, closed=True)
    turns = Rotation.from_rotvec([[0, 0, 0], [0.3, -1, 0.5]]).as_matrix()
    shifts = np.array([[0, 0, 0], [1.0, 2, 3]])
    posed = np.einsum("tab,nb->tna", turns, rest) + shifts[:, None]
    rotation, translation = surface_motion(Body(rest, faces, posed), np.array([0, 17, 49]))
    np.testing.assert_allclose(rotation, np.repeat(turns[:, None], 3, 1), atol=1e-6)
    np.testing.assert_allclose(translation, np.repeat(shifts[:, None], 3, 1), atol=1e-6)


def test_each_vertex_moves_as_it_does():
    clip = tube_clip(4)
    chosen = np.array([3, 60, 120])
    rotation, translation = surface_motion(clip.body, chosen)
    at = np.einsum("tnab,nb->tna", rotation, clip.body.rest[chosen]) + translation
    np.testing.assert_allclose(at, clip.body.vertices[:, chosen], atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(rotation), 1, atol=1e-9)
