"""Motion guided garments as a whole: a clip is fitted, and predictions keep the laws of every method."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imgtransfer.data.clip_parts import Template
from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig
from imgtransfer.deformers.motion_guided.layers import on_garment
from imgtransfer.deformers.motion_guided.measures import penetration_percent, rollout_errors_mm
from imgtransfer.deformers.motion_guided.method import MotionGuided
from imgtransfer.evaluation.skinning import lbs_baseline
from render import InputError
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip
from tests.imgtransfer.deformers.compared import every_second_frame, mean_distance_mm
from tests.imgtransfer.deformers.moves import placed, turned

CONFIG = MotionGuidedConfig(
    seeds=24,
    uv_size=8,
    channels=(16, 32),
    features=16,
    latent=16,
    static_steps=240,
    dynamic_steps=160,
    learning_rate=8e-3,
    halve_steps=80,
    warm_up_frames=2,
    residual_steps=5,
)
CLIP = tube_clip(12)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    deformer = MotionGuided(CONFIG)
    deformer.fit([CLIP], FitFolder(tmp_path_factory.mktemp("motion_guided")))
    return deformer


def test_one_short_clip_is_fitted_within_4_mm(fitted):
    skinned = mean_distance_mm(lbs_baseline(CLIP), CLIP.garment.vertices)
    assert mean_distance_mm(fitted.predict(CLIP), CLIP.garment.vertices) < 4 < skinned


def test_roll_outs_from_true_frames_stay_within_4_mm(fitted):
    errors = rollout_errors_mm(fitted, CLIP, lengths=(1, 5, 50, None), starts=3)
    assert errors.keys() == {"1", "5", "all"}  # there are no 50 frames
    assert max(errors.values()) < 4


def test_a_prediction_turns_and_moves_with_the_clip(fitted):
    prediction = fitted.predict(turned(CLIP))
    np.testing.assert_allclose(prediction, placed(fitted.predict(CLIP)), atol=5e-4)


def test_the_motion_of_the_garment_is_no_input(fitted):
    np.testing.assert_array_equal(fitted.predict(replace(CLIP, garment=None)), fitted.predict(CLIP))


def test_a_clip_begins_as_its_beginning_does(fitted):
    np.testing.assert_allclose(fitted.predict(CLIP.slice(slice(5))), fitted.predict(CLIP)[:5], atol=1e-5)
    assert fitted.predict(CLIP.slice(slice(1))).shape == (1, 192, 3)


def test_another_frame_rate_is_followed(fitted):
    predicted = fitted.predict(every_second_frame(CLIP))
    assert mean_distance_mm(predicted, fitted.predict(CLIP)[:11:2]) < 3


def test_a_batch_of_frames_equals_its_singles(fitted):
    model, rollout = fitted.model, fitted.rollout(CLIP)
    garments = torch.from_numpy(rollout.body.frames.to_canonical(CLIP.garment.vertices))
    seeds = rollout.body.seeds
    with torch.no_grad():
        whole = model.static_code(garments, seeds.points, rollout.rest)
        single = model.static_code(garments[4:5], seeds.points[4:5], rollout.rest)
    torch.testing.assert_close(single[0], whole[4], rtol=1e-4, atol=1e-5)


def test_what_is_stored_predicts_the_same(fitted):
    other = MotionGuided(CONFIG)
    other.restore(fitted.tensors())
    np.testing.assert_array_equal(other.predict(CLIP), fitted.predict(CLIP))
    assert other.parameters() == fitted.parameters()


def test_tensors_of_something_else_are_refused():
    with pytest.raises(ValueError, match="motion_guided"):
        MotionGuided(CONFIG).restore({"seeds": torch.zeros(3)})


def test_a_garment_on_a_garment(fitted, tmp_path):
    inner = Template(CLIP.template.vertices * np.float32([0.9, 1, 0.9]), CLIP.template.faces)
    middle = CLIP.garment.vertices.mean(1, keepdims=True)
    clip = on_garment(CLIP, inner, middle + 0.95 * (CLIP.garment.vertices - middle))
    with pytest.raises(InputError, match="a body of 192 vertices"):
        fitted.predict(clip)
    few = {"static_steps": 10, "dynamic_steps": 3, "seeds": 12}
    deformer = MotionGuided(CONFIG.model_copy(update=few))
    deformer.fit([clip], FitFolder(tmp_path))
    assert mean_distance_mm(deformer.predict(clip), CLIP.garment.vertices) < 20


def test_penetration_by_motion():
    inside = CLIP.garment.vertices.copy()
    inside[:, :48] = CLIP.body.vertices.mean(1, keepdims=True)  # a quarter of the vertices
    percent = penetration_percent({"true": (CLIP, CLIP.garment.vertices), "in": (CLIP, inside)})
    assert percent == {"true": 0.0, "in": 25.0}


@pytest.mark.parametrize(
    ("clips", "message"),
    [
        ([CLIP.slice(slice(3))], "3 frames.* of 4 or more"),
        ([CLIP, with_arrays(CLIP, fps=60.0)], "60 frames a second"),
        ([CLIP, tube_clip(12, sides=9)], "another body mesh"),
    ],
    ids=["three frames", "two rates", "two bodies"],
)
def test_clips_that_cannot_be_fitted(clips, message, tmp_path):
    with pytest.raises(InputError, match=message):
        MotionGuided(CONFIG).fit(clips, FitFolder(tmp_path))


def test_numbers_of_vertices_that_are_not_there_are_refused(fitted):
    tensors = fitted.tensors()
    with pytest.raises(ValueError, match="numbers from 192 to 192 of 192"):
        MotionGuided(CONFIG).restore(tensors | {"maps.corners": tensors["maps.corners"].clone().fill_(192)})


def test_another_garment_is_refused(fitted):
    with pytest.raises(InputError, match="another garment"):
        fitted.predict(tube_clip(3, rings=9))


def test_a_size_that_the_layers_do_not_halve_to_two_is_refused():
    with pytest.raises(ValueError, match="3 channels halve a map of 16 pixels to 2"):
        MotionGuidedConfig(uv_size=8, channels=(4, 4, 4))
