"""The skinned baseline, and the skinning under it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imgtransfer.data.clip import Clip
from imgtransfer.data.skinning import joint_transforms, skin
from imgtransfer.evaluation.skinning import lbs_baseline
from render import InputError
from tests.helpers import synthetic
from tests.helpers.clips import with_arrays


def test_the_body_skinned_reproduces_the_body(tube_clip: Clip) -> None:
    posed = skin(tube_clip.body.rest, tube_clip.skeleton.blend_weights, joint_transforms(tube_clip))
    np.testing.assert_allclose(posed, tube_clip.body.vertices, atol=1e-6)


def test_two_joints_by_hand() -> None:
    transforms = np.zeros((1, 2, 3, 4))
    transforms[0, 0, :, :3] = np.eye(3)
    transforms[0, 1] = [[0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0]]  # a quarter turn about z, then 5 along x
    rest = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(skin(rest, np.array([[0.0, 1.0]]), transforms), [[[3.0, 1.0, 3.0]]])
    np.testing.assert_allclose(skin(rest, np.array([[0.5, 0.5]]), transforms), [[[2.0, 1.5, 3.0]]])


def test_stored_transforms_take_the_place_of_poses(tube_clip: Clip) -> None:
    stored = replace(
        tube_clip,
        skeleton=replace(
            tube_clip.skeleton,
            joint_transforms=joint_transforms(tube_clip),
            poses=None,
            trans=None,
            parents=None,
        ),
    )
    np.testing.assert_array_equal(lbs_baseline(stored), lbs_baseline(tube_clip))


def test_the_baseline_takes_the_weights_of_the_nearest_body_vertex(tube_clip: Clip) -> None:
    template = tube_clip.body.rest[:100] * np.float32([1.1, 1, 1.1])
    bare = replace(
        tube_clip,
        template=replace(tube_clip.template, vertices=template, faces=np.array([[0, 1, 2]])),
        garment=None,
    )
    by_hand = skin(
        bare.template.vertices, tube_clip.skeleton.blend_weights[:100], joint_transforms(tube_clip)
    )
    np.testing.assert_allclose(lbs_baseline(bare), by_hand, atol=1e-6)


def test_the_baseline_is_near_the_truth_of_the_tube(tube_clip: Clip) -> None:
    error = np.linalg.norm(lbs_baseline(tube_clip) - tube_clip.garment.vertices, axis=-1)
    assert 1e-3 < error.mean() < 1e-2  # the ripple, which skinning cannot know, is up to 8 mm


@pytest.mark.parametrize("missing", ["blend_weights", "poses", "trans", "parents"])
def test_a_clip_without_skinning_is_refused(tube_clip: Clip, missing: str) -> None:
    with pytest.raises(InputError, match=f"no skinning; it lacks .*{missing}"):
        lbs_baseline(with_arrays(tube_clip, **{missing: None}))


def test_weights_and_joints_that_do_not_fit_are_refused(tube_clip: Clip) -> None:
    with pytest.raises(InputError, match="3 columns for 2 joints"):
        lbs_baseline(
            replace(
                tube_clip,
                skeleton=replace(
                    tube_clip.skeleton, blend_weights=np.ones((len(tube_clip.body.rest), 3), np.float32)
                ),
            )
        )
    with pytest.raises(InputError, match="a parent must come before"):
        lbs_baseline(replace(tube_clip, skeleton=replace(tube_clip.skeleton, parents=np.array([1, -1]))))


def test_the_fixture_keeps_the_garment_outside_the_body() -> None:
    clip = synthetic.tube_clip(2)
    assert np.linalg.norm(clip.template.vertices[:, [0, 2]], axis=1).min() > 0.185
