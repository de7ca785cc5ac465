"""Mirror images of poses and residuals by hand, when there are none, and what they are worth on the other side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imgtransfer.data.clip_parts import Template
from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.pose_regression import PoseRegression, PoseRegressionConfig
from imgtransfer.deformers.pose_regression.features import pose_features
from imgtransfer.deformers.pose_regression.mirror import Mirror
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip

CLIP = tube_clip(24)
REFLECT = np.float32([-1, 1, 1])


def reflected(clip):
    """The clip as a mirror shows it; garment and body get the numbers of their mirrored vertices back."""
    order = Mirror.of(clip).vertices[:, 0]
    body = np.array(
        [
            ((clip.body.rest - place * REFLECT) ** 2).sum(1).argmin()
            for place in clip.body.rest.astype(np.float64)
        ]
    )
    return with_arrays(
        clip,
        garment_vertices=clip.garment.vertices[:, order] * REFLECT,
        body_vertices=clip.body.vertices[:, body] * REFLECT,
        poses=clip.skeleton.poses * np.float32([1, -1, -1]),
        trans=clip.skeleton.trans * REFLECT,
    )


def distance_mm(deformer, clip):
    return 1e3 * float(np.linalg.norm(deformer.predict(clip) - clip.garment.vertices, axis=-1).mean())


def test_left_and_right_change_places_and_turns_are_mirrored():
    mirror = Mirror(np.array([0, 2, 1]), np.array([[0]]), np.array([[1.0]]))
    poses, wanted = np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
    poses[0, 0, 2] = 0.3  # leans to its right
    poses[0, 1] = [0.1, 0.2, 0.4]
    wanted[0, 0, 2] = -0.3
    wanted[0, 2] = [0.1, -0.2, -0.4]  # axes are mirrored, and turns about them go the other way
    clip = tube_clip(1)
    three = {"joint_transforms": np.tile(np.eye(3, 4), (1, 2, 1, 1))}
    seen, mirrored = (
        pose_features(with_arrays(clip, poses=value, **three), 0.1) for value in (poses, wanted)
    )
    np.testing.assert_allclose(mirror.features(seen), mirrored, atol=1e-7)


def test_residuals_are_those_of_the_vertices_on_the_other_side():
    mirror = Mirror.of(CLIP)
    residuals = np.random.default_rng(0).normal(size=(2, CLIP.template.vertices.size)).astype(np.float32)
    mirrored = mirror.residuals(residuals).reshape(2, -1, 3)
    for vertex, place in enumerate(CLIP.template.vertices):
        other = np.linalg.norm(CLIP.template.vertices - place * REFLECT, axis=1).argmin()
        wanted = residuals.reshape(2, -1, 3)[:, other] * REFLECT
        np.testing.assert_allclose(mirrored[:, vertex], wanted, atol=1e-4)
    np.testing.assert_allclose(mirror.residuals(mirror.residuals(residuals)), residuals, atol=1e-4)


def test_what_is_not_alike_on_both_sides_has_no_mirror():
    joints = CLIP.skeleton.joints_rest.copy()
    joints[1, 0] += 0.1
    assert Mirror.of(with_arrays(CLIP, joints_rest=joints)) is None
    assert Mirror.of(with_arrays(CLIP, joints_rest=None, parents=None)) is None
    aside = CLIP.template.vertices + np.float32([0.2, 0, 0])
    assert Mirror.of(replace(CLIP, template=Template(aside, CLIP.template.faces))) is None


def test_a_bend_to_one_side_teaches_the_other(tmp_path):
    other = reflected(CLIP)
    errors = {}
    for mirror in (False, True):
        method = PoseRegression(PoseRegressionConfig(steps=20, mirror=mirror))
        method.fit([CLIP], FitFolder(tmp_path))
        errors[mirror] = distance_mm(method, other)
        assert distance_mm(method, CLIP) < 1.0
    assert errors[True] < 1.0
    assert errors[False] > 2 * errors[True]
