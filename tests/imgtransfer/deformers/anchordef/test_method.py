"""AnchorDEF as a whole: it fits a clip, and its predictions keep the laws of every method."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imgtransfer.data.clip_parts import Skeleton
from imgtransfer.deformers.anchordef.config import AnchorDefConfig
from imgtransfer.deformers.anchordef.method import AnchorDef
from imgtransfer.deformers.base import FitFolder
from imgtransfer.evaluation.skinning import lbs_baseline
from render import InputError
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip
from tests.imgtransfer.deformers.compared import every_second_frame, mean_distance_mm
from tests.imgtransfer.deformers.moves import placed, turned

CONFIG = AnchorDefConfig(
    anchors=16,
    anchors_of_vertex=4,
    vertices_of_anchor=6,
    simplified_frames=2,
    width=32,
    layers=1,
    steps=100,
    sequences=2,
    frames=12,
    learning_rate=4e-3,
    tight_within_m=0.3,
)
CLIP = tube_clip(12)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    deformer = AnchorDef(CONFIG)
    deformer.fit([CLIP], FitFolder(tmp_path_factory.mktemp("anchordef")))
    return deformer


def test_one_short_clip_is_fitted_within_3_mm(fitted):
    skinned = mean_distance_mm(lbs_baseline(CLIP), CLIP.garment.vertices)
    error = mean_distance_mm(fitted.predict(CLIP), CLIP.garment.vertices)
    assert error < 3 < skinned


def test_anchors_are_tight_and_loose(fitted):
    assert 0 < fitted.network.tight.sum() < 16


def test_a_prediction_turns_and_moves_with_the_clip(fitted):
    np.testing.assert_allclose(fitted.predict(turned(CLIP)), placed(fitted.predict(CLIP)), atol=2e-5)


def test_the_motion_of_the_garment_is_no_input(fitted):
    np.testing.assert_array_equal(fitted.predict(replace(CLIP, garment=None)), fitted.predict(CLIP))


def test_a_clip_begins_as_its_beginning_does(fitted):
    np.testing.assert_allclose(fitted.predict(CLIP.slice(slice(5))), fitted.predict(CLIP)[:5], atol=1e-5)
    assert fitted.predict(CLIP.slice(slice(1))).shape == (1, 192, 3)


def test_another_frame_rate_is_followed(fitted):
    predicted = fitted.predict(every_second_frame(CLIP))
    assert mean_distance_mm(predicted, fitted.predict(CLIP)[::2]) < 3


def test_what_is_stored_predicts_the_same(fitted):
    other = AnchorDef(CONFIG)
    other.restore(fitted.tensors())
    np.testing.assert_array_equal(other.predict(CLIP), fitted.predict(CLIP))
    assert other.parameters() == fitted.parameters()


@pytest.mark.parametrize(
    "tensors", [{}, {"logits": torch.zeros(3, 3)}], ids=["nothing", "tensors of something else"]
)
def test_tensors_of_something_else_are_refused(tensors):
    with pytest.raises(ValueError, match="anchordef"):
        AnchorDef(CONFIG).restore(tensors)


def test_numbers_of_vertices_that_are_not_there_are_refused(fitted):
    tensors = fitted.tensors()
    with pytest.raises(ValueError, match="numbers from 192 to 192 of 192"):
        AnchorDef(CONFIG).restore(tensors | {"neighbours": tensors["neighbours"].clone().fill_(192)})


def test_another_garment_is_refused(fitted):
    with pytest.raises(InputError, match="another garment"):
        fitted.predict(tube_clip(3, rings=9))


def test_another_skeleton_is_refused(fitted):
    poses = np.zeros((12, 3, 3), np.float32)
    with pytest.raises(InputError, match="poses of 3 joints, and the method was fitted to 2"):
        fitted.predict(with_arrays(CLIP, poses=poses, blend_weights=None))


@pytest.mark.parametrize(
    ("clips", "settings", "message"),
    [
        ([with_arrays(CLIP, fps=60.0), CLIP], {}, "60 frames a second|fitted to clips of one rate"),
        ([replace(CLIP, skeleton=Skeleton())], {}, "has no poses"),
        (
            [replace(CLIP, skeleton=replace(CLIP.skeleton, joints_rest=None))],
            {},
            "joints_rest.*strategy=mixed",
        ),
        ([CLIP], {"anchors": 193}, "193 anchors, but the garment .* has 192 vertices"),
        ([], {}, "no clips"),
    ],
    ids=["two rates", "no poses", "no joints", "more anchors than vertices", "no clips"],
)
def test_clips_that_cannot_be_fitted(clips, settings, message, tmp_path):
    with pytest.raises(InputError, match=message):
        AnchorDef(CONFIG.model_copy(update=settings)).fit(clips, FitFolder(tmp_path))
