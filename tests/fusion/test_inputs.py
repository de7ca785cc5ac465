"""What `fuse` accepts and refuses, argument by argument."""

import numpy as np
import pytest
import torch

from fusion.inputs import FusionInputs
from render import InputError
from tests.helpers.fusion_examples import cylinder_body, imager_of, tube

FRAMES = 2


@pytest.fixture(scope="module")
def imager():
    return imager_of(tube())


@pytest.fixture
def good(imager):
    """Arguments that are accepted."""
    maps = np.zeros((FRAMES, *imager.mask.shape, 3), np.float32)
    body = cylinder_body()
    return {
        "positions": maps,
        "normals": maps,
        "initial": None,
        "confidence": np.ones((FRAMES, *imager.mask.shape)),
        "pinned": np.array([3, 1]),
        "pinned_positions": np.zeros((FRAMES, 2, 3)),
        "body_vertices": np.stack([body.vertices] * FRAMES),
        "body_faces": np.asarray(body.faces),
        "inner_vertices": torch.zeros(FRAMES, 3, 3),
        "inner_faces": torch.tensor([[0, 1, 2]]),
    }


def test_everything_comes_out_as_said(imager, good):
    found = FusionInputs(imager, **good)
    assert found.n_frames == FRAMES
    assert found.pinned.tolist() == [3, 1]
    assert found.pinned.dtype == torch.int64
    assert (
        found.confidence.dtype == found.pinned_positions.dtype == found.inner_vertices.dtype == torch.float32
    )
    assert torch.equal(found.confidence[1] == 1, imager.mask)
    assert found.inner_faces.dtype == np.int64


def test_what_is_not_given_is_none(imager, good):
    found = FusionInputs(imager, positions=good["positions"], normals=None, initial=None, pinned=[])
    for name in (
        "normals",
        "initial",
        "confidence",
        "pinned",
        "pinned_positions",
        "body_vertices",
        "inner_faces",
    ):
        assert getattr(found, name) is None


def test_confidence_of_the_background_does_not_count(imager, good):
    good["confidence"][:, ~imager.mask.numpy()] = np.nan
    assert torch.isfinite(FusionInputs(imager, **good).confidence).all()


MISTAKES = {
    "confidence shape": ({"confidence": np.ones((FRAMES, 2, 3, 3))}, "confidence must have shape"),
    "pins out of range": ({"pinned": [0, 544]}, r"vertex 544, but the template has 0\.\.543"),
    "pins negative": ({"pinned": [-1, 0]}, "vertex -1"),
    "pins twice": ({"pinned": [7, 7]}, "vertex 7 more than once"),
    "pins that are no numbers of vertices": ({"pinned": [0.5, 1.0]}, "whole numbers"),
    "pins without numbers": ({"pinned": None}, "pinned_positions need pinned"),
    "positions of other pins": ({"pinned": [1]}, r"pinned_positions must have shape \(2, 1, 3\)"),
    "inner without faces": ({"inner_faces": None}, "inner_vertices and inner_faces belong together"),
    "inner of one frame": ({"inner_vertices": np.zeros((1, 3, 3))}, "inner_vertices must have shape"),
    "inner face out of range": ({"inner_faces": np.array([[0, 1, 3]])}, "inner_faces: face 0"),
    "body without vertices": ({"body_vertices": np.zeros(3)}, "body_vertices must have shape"),
    "no frames": ({"positions": np.zeros((0, 2, 48, 40, 3))}, "no frames"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(imager, good, name):
    changed, message = MISTAKES[name]
    with pytest.raises(InputError, match=message):
        FusionInputs(imager, **(good | changed))


def test_confidence_that_is_negative_or_nowhere_is_refused(imager, good):
    low = good["confidence"].copy()
    low[0, imager.mask.numpy()] = -0.5
    with pytest.raises(InputError, match=r"at least 0 .* found -0\.5"):
        FusionInputs(imager, **(good | {"confidence": low}))
    none = good["confidence"].copy()
    none[1] = 0
    with pytest.raises(InputError, match="0 at every covered pixel of frame 1"):
        FusionInputs(imager, **(good | {"confidence": none}))
    only = good | {"positions": None, "normals": None, "initial": np.zeros((FRAMES, 544, 3))}
    with pytest.raises(InputError, match="belongs to maps"):
        FusionInputs(imager, **only)
