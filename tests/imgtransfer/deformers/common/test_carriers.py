import numpy as np
import torch

from imgtransfer.data.canonical import root_frames
from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.common.carriers import Carried, carriers
from imgtransfer.deformers.virtual_bones.config import VirtualBonesConfig
from imgtransfer.deformers.virtual_bones.method import VirtualBones
from tests.helpers.synthetic import tube_clip
from tests.imgtransfer.deformers.moves import placed, turned


def test_a_rigid_body_carries_bones_by_its_motion():
    rest = np.random.default_rng(0).normal(size=(30, 3))
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    posed = (rest @ quarter.T + [1, 2, 3])[None].astype(np.float32)
    got = carriers(rest, posed, np.array([[1.0, 0, 0], [0, 0, 0]]))
    np.testing.assert_allclose(got.turn[0], [quarter, quarter], atol=1e-6)
    np.testing.assert_allclose(
        got.offset[0], [[0, 3, 3], [1, 2, 3]], atol=1e-6
    )  # (1, 0, 0) goes to (1, 3, 3)


def test_bones_put_on_carriers_and_taken_off_again():
    clip = tube_clip(6)
    body = root_frames(clip, "root").to_canonical(clip.body.vertices)
    own = carriers(clip.body.rest, body, clip.template.vertices[::40])
    turn, offset = own.turn.flip(1), torch.randn(own.offset.shape)
    again = own.without(*own.put(turn, offset))
    torch.testing.assert_close(again[0], turn, atol=1e-5, rtol=0)
    torch.testing.assert_close(again[1], offset, atol=1e-5, rtol=0)
    frames = torch.tensor([4, 1])
    torch.testing.assert_close(
        own.of(frames).put(turn[frames], offset[frames])[0], own.put(turn, offset)[0][frames]
    )


def test_nothing_carries_to_where_things_are():
    turn, offset = torch.randn(2, 3, 3, 3), torch.randn(2, 3, 3)
    got = Carried.nothing(2, 3).put(turn, offset)
    torch.testing.assert_close(got, (turn, offset))


def test_bones_that_follow_the_body_before_anything_is_learned_beat_those_that_follow_the_root(tmp_path):
    clip = tube_clip(16)
    errors = {}
    for follow in ("root", "body"):
        stage = {"steps": 0}
        config = VirtualBonesConfig(
            rig={"bones": 6, "frames": 16, "rounds": 3, "follow": follow}, hidden=4, low=stage, high=stage
        )
        method = VirtualBones(config)
        folder = tmp_path / follow
        folder.mkdir()
        method.fit([clip], FitFolder(folder))
        got = method.predict(clip)
        errors[follow] = np.linalg.norm(got - clip.garment.vertices, axis=-1).mean()
        np.testing.assert_allclose(method.predict(turned(clip)), placed(got), atol=2e-4)
    assert errors["body"] < 0.5 * errors["root"]
