from dataclasses import replace

import numpy as np
import pytest
import torch

from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.checkpoint import load_deformer, save_deformer
from imgtransfer.deformers.virtual_bones.config import VirtualBonesConfig
from imgtransfer.deformers.virtual_bones.method import VirtualBones
from render import InputError
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip
from tests.imgtransfer.deformers.moves import placed, turned

FRAMES = 24
STAGE = {"windows": 1, "window_frames": 24, "warm_up_frames": 4, "learning_rate": 1e-2}
SMALL = VirtualBonesConfig(
    rig={"bones": 6, "frames": 24, "rounds": 4},
    hidden=32,
    dropout=0.0,
    vertex_features=4,
    low=STAGE | {"steps": 100, "decay_steps": 50},
    high=STAGE | {"loss_frames": 8, "steps": 30, "decay_steps": 20},
)
BRIEF = SMALL.model_copy(
    update={key: getattr(SMALL, key).model_copy(update={"steps": 3}) for key in ("low", "high")}
)


def fitted(folder, config=SMALL, clips=None):
    method = VirtualBones(config)
    method.fit(clips or [tube_clip(FRAMES)], FitFolder(folder))
    return method


@pytest.fixture(scope="module")
def method(tmp_path_factory):
    return fitted(tmp_path_factory.mktemp("virtual_bones"))


def error_mm(got, clip):
    return 1e3 * np.linalg.norm(got - clip.garment.vertices, axis=-1).mean()


def test_one_short_clip_is_learned_to_two_millimetres(method):
    clip = tube_clip(FRAMES)
    assert error_mm(method.predict(clip), clip) < 2  # 18 with bones that stay


def test_displacements_take_something_off_what_the_bones_leave(method):
    clip = tube_clip(FRAMES)
    whole = error_mm(method.predict(clip), clip)
    tensors = method.tensors()
    for name in ("mean", "scale"):
        tensors[f"network.high.{name}"] = torch.zeros_like(tensors[f"network.high.{name}"])
    bones = VirtualBones(SMALL)
    bones.restore(tensors)
    assert whole < 0.9 * error_mm(bones.predict(clip), clip)


def test_a_clip_turned_about_the_vertical_is_predicted_turned(method):
    clip = tube_clip(FRAMES)
    np.testing.assert_allclose(method.predict(turned(clip)), placed(method.predict(clip)), atol=2e-4)


def test_the_garments_motion_is_not_looked_at(method):
    clip = tube_clip(FRAMES)
    np.testing.assert_array_equal(method.predict(replace(clip, garment=None)), method.predict(clip))


@pytest.mark.parametrize("frames", [1, 2, 70])
def test_clips_of_any_length(method, frames):
    got = method.predict(tube_clip(frames))
    assert got.shape == (frames, 192, 3)
    assert got.dtype == np.float32
    assert np.isfinite(got).all()


def test_the_beginning_of_a_clip_does_not_depend_on_its_end(method):
    clip = tube_clip(60)
    np.testing.assert_allclose(method.predict(clip)[:20], method.predict(clip.slice(slice(20))), atol=1e-6)


def test_every_second_frame_is_predicted_nearly_as_all_are(method):
    clip = tube_clip(FRAMES + 1)
    half = replace(clip.slice(slice(None, None, 2)), fps=15.0)
    got, want = method.predict(half), method.predict(clip)[::2]
    assert np.linalg.norm(got - want, axis=-1).mean() < 2e-3  # metres


def test_restored_from_a_file_it_predicts_the_same(method, tmp_path):
    again = load_deformer(save_deformer(tmp_path / "method.safetensors", method))
    assert isinstance(again, VirtualBones)
    clip = tube_clip(5)
    np.testing.assert_array_equal(again.predict(clip), method.predict(clip))


def test_parameters_are_the_networks_and_the_weights_that_are_not_zero(tmp_path):
    method = fitted(tmp_path, BRIEF)
    low = 3 * 32 * (15 + 32 + 2) + 36 * 33  # a GRU of 15 features, six numbers of six bones
    high = 3 * 32 * (36 + 32 + 2) + 192 * 4 * 33 + (8 * 4 + 8 * 3) + (16 * 9 + 16 * 8) + 3 * 21
    weights = int((method.tensors()["network.low.skinning.weights"] != 0).sum())
    assert method.parameters() == low + high + weights
    assert 192 <= weights <= 4 * 192


@pytest.mark.parametrize("lost", ["known.faces", "known.fps", "network.low.head.weight", "network.high.mean"])
def test_tensors_that_are_missing_are_refused(method, lost):
    tensors = method.tensors()
    tensors.pop(lost)
    with pytest.raises(ValueError, match=r"known|virtual_bones"):
        VirtualBones(SMALL).restore(tensors)


def test_tensors_of_other_settings_are_refused(method):
    with pytest.raises(ValueError, match="other settings"):
        VirtualBones(SMALL.model_copy(update={"hidden": 16})).restore(method.tensors())


def test_a_fit_that_was_stopped_goes_on_to_the_same(tmp_path):
    whole = fitted(tmp_path, BRIEF)
    (tmp_path / "high.safetensors").unlink()
    again = fitted(tmp_path, BRIEF)
    for name, value in whole.tensors().items():
        torch.testing.assert_close(again.tensors()[name], value, rtol=0, atol=0, msg=name)


def test_a_folder_of_other_settings_is_refused(tmp_path):
    fitted(tmp_path, BRIEF)
    other = BRIEF.model_copy(update={"rig": BRIEF.rig.model_copy(update={"bones": 5})})
    with pytest.raises(InputError, match=r"bones.safetensors: of other clips or settings"):
        fitted(tmp_path, other)


def test_clips_of_another_body_shape_and_length_are_fitted_together(tmp_path):
    clips = [tube_clip(8), tube_clip(5, girth=1.2, tall=1.1, name="tube/large")]
    got = fitted(tmp_path, BRIEF, clips).predict(clips[1])
    assert got.shape == clips[1].garment.vertices.shape
    assert error_mm(got, clips[1]) < 100


def test_a_clip_of_hours_between_its_frames_is_refused_in_one_line(method):
    with pytest.raises(InputError, match=r"tube/bend: fps: 90 frames at 0.01 a second are 8.9e\+03 s long"):
        method.predict(replace(tube_clip(90), fps=0.01))


def test_bad_clips_are_refused_in_one_line(method, tmp_path):
    clip = tube_clip(4)
    bare = with_arrays(clip, poses=None, trans=None, joints_rest=None, parents=None, blend_weights=None)
    more = with_arrays(
        clip,
        poses=np.zeros((4, 3, 3), np.float32),
        joints_rest=np.zeros((3, 3), np.float32),
        parents=np.array([-1, 0, 1]),
        blend_weights=None,
    )
    with pytest.raises(InputError, match="has no poses"):
        method.predict(bare)
    with pytest.raises(InputError, match="poses of 3 joints, and the method was fitted to 2"):
        method.predict(more)
    with pytest.raises(InputError, match=r"another garment \(160 vertices, 288 faces\)"):
        method.predict(tube_clip(4, rings=10))
    with pytest.raises(InputError, match="another garment"):
        fitted(tmp_path, BRIEF, [clip, tube_clip(4, rings=10)])
    with pytest.raises(InputError, match="50 frames a second, tube/bend has 30"):
        fitted(tmp_path, BRIEF, [clip, replace(clip, fps=50.0)])
    with pytest.raises(InputError, match="has no parents of its 2 joints"):
        fitted(tmp_path, BRIEF, [with_arrays(clip, parents=None)])
    with pytest.raises(InputError, match="has no garment_vertices"):
        fitted(tmp_path, BRIEF, [replace(clip, garment=None)])
