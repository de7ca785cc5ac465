from dataclasses import replace

import numpy as np
import pytest
import torch

from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.checkpoint import load_deformer, save_deformer
from imgtransfer.deformers.jointnet.config import JointNetConfig
from imgtransfer.deformers.jointnet.method import JointNet
from render import InputError
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube_clip
from tests.imgtransfer.deformers.moves import placed, turned

FRAMES = 24
STAGE = {"windows": 1, "window_frames": 24, "warm_up_frames": 4, "loss_frames": 12, "learning_rate": 1e-2}
SMALL = JointNetConfig(
    rig={"bones": 6, "frames": 24, "rounds": 4},
    hidden=16,
    joint_features=16,
    bone_layers=(32,),
    shapes=4,
    shape_layers=(16,),
    dropout=0.0,
    low=STAGE | {"steps": 90, "decay_steps": 40},
    high=STAGE | {"steps": 40, "decay_steps": 20},
)
BRIEF = SMALL.model_copy(
    update={key: getattr(SMALL, key).model_copy(update={"steps": 3}) for key in ("low", "high")}
)


def fitted(folder, config=SMALL, clips=None):
    method = JointNet(config)
    method.fit(clips or [tube_clip(FRAMES)], FitFolder(folder))
    return method


@pytest.fixture(scope="module")
def method(tmp_path_factory):
    return fitted(tmp_path_factory.mktemp("jointnet"))


def error_mm(got, clip):
    return 1e3 * np.linalg.norm(got - clip.garment.vertices, axis=-1).mean()


def test_one_short_clip_is_learned_to_three_millimetres(method):
    clip = tube_clip(FRAMES)
    assert error_mm(method.predict(clip), clip) < 3  # 17 with bones that stay


def test_a_clip_turned_about_the_vertical_is_predicted_turned(method):
    clip = tube_clip(FRAMES)
    np.testing.assert_allclose(method.predict(turned(clip)), placed(method.predict(clip)), atol=2e-4)


def test_the_garments_motion_is_not_looked_at(method):
    clip = tube_clip(FRAMES)
    np.testing.assert_array_equal(method.predict(replace(clip, garment=None)), method.predict(clip))


@pytest.mark.parametrize("frames", [1, 70])
def test_clips_of_any_length(method, frames):
    got = method.predict(tube_clip(frames))
    assert got.shape == (frames, 192, 3)
    assert np.isfinite(got).all()


def test_every_second_frame_is_predicted_nearly_as_all_are(method):
    clip = tube_clip(FRAMES + 1)
    half = replace(clip.slice(slice(None, None, 2)), fps=15.0)
    assert np.linalg.norm(method.predict(half) - method.predict(clip)[::2], axis=-1).mean() < 2e-3  # metres


def test_restored_from_a_file_it_predicts_the_same(method, tmp_path):
    again = load_deformer(save_deformer(tmp_path / "method.safetensors", method))
    assert isinstance(again, JointNet)
    clip = tube_clip(5)
    np.testing.assert_array_equal(again.predict(clip), method.predict(clip))


def test_tensors_of_other_settings_are_refused(method):
    with pytest.raises(ValueError, match="other settings"):
        JointNet(SMALL.model_copy(update={"hidden": 8})).restore(method.tensors())


def test_a_fit_that_was_stopped_goes_on_to_the_same(tmp_path):
    whole = fitted(tmp_path, BRIEF)
    (tmp_path / "high.safetensors").unlink()
    again = fitted(tmp_path, BRIEF)
    for name, value in whole.tensors().items():
        torch.testing.assert_close(again.tensors()[name], value, rtol=0, atol=0, msg=name)


def test_sparsity_takes_associations_to_nothing(tmp_path):
    config = BRIEF.model_copy(
        update={
            "sparse_weight": 10.0,
            "normal_weight": 0.0,
            "low": BRIEF.low.model_copy(update={"steps": 25, "learning_rate": 0.1}),
        }
    )
    active = fitted(tmp_path, config)._network.low.active()
    assert (active == 0).float().mean() > 0.5


def test_bad_clips_are_refused_in_one_line(method):
    clip = tube_clip(4)
    with pytest.raises(InputError, match="has no poses"):
        method.predict(
            with_arrays(clip, poses=None, trans=None, joints_rest=None, parents=None, blend_weights=None)
        )
    with pytest.raises(InputError, match="another garment"):
        method.predict(tube_clip(4, rings=10))
