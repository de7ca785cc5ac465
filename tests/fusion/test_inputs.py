"""What `fuse` accepts and refuses, argument by argument."""

import numpy as np
import pytest
import torch

from fusion import DecodedMaps, FusionInputs, MovingSurface, PinnedVertices, fuse_maps
from fusion.input_checks import checked, rest_mesh
from render import InputError, load_maps
from tests.helpers.fusion_examples import cylinder_body, imager_of, inputs_of, tube, write_example

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
        "pins": (np.array([3, 1]), np.zeros((FRAMES, 2, 3))),
        "body": (np.stack([body.vertices] * FRAMES), np.asarray(body.faces)),
        "inner": (torch.zeros(FRAMES, 3, 3), torch.tensor([[0, 1, 2]])),
    }


def test_everything_comes_out_as_said(imager, good):
    found = checked(inputs_of(**good), imager)
    assert found.n_frames == FRAMES
    assert found.pins.indices.tolist() == [3, 1]
    assert found.pins.indices.dtype == torch.int64
    for values in (found.maps.confidence, found.pins.positions, found.body.vertices, found.inner.vertices):
        assert values.dtype == torch.float32
    assert torch.equal(found.maps.confidence[1] == 1, imager.mask)
    assert found.inner.faces.tolist() == [[0, 1, 2]]


def test_what_is_not_given_is_none(imager, good):
    given = inputs_of(positions=good["positions"], pins=([], None))
    found = checked(given, imager)
    assert (found.maps.normals, found.maps.confidence) == (None, None)
    assert (found.initial, found.pins, found.body, found.inner, found.rest) == (None,) * 5
    assert FusionInputs().n_frames == 0
    assert FusionInputs().maps.empty


def test_a_part_has_its_frames_of_everything_and_knows_their_number(good):
    by_frame = {
        "positions": np.arange(3.0),
        "normals": np.arange(3.0),
        "confidence": np.arange(3.0),
        "initial": np.arange(3.0),
        "rest": np.arange(3.0),
        "body": (np.arange(3.0), good["body"][1]),
        "inner": (np.arange(3.0), good["inner"][1]),
        "pins": (np.array([3, 1]), np.arange(3.0)),
    }
    part = inputs_of(**by_frame).part(slice(1, 3))
    values = [part.maps.positions, part.maps.normals, part.maps.confidence, part.initial]
    values += [part.body.vertices, part.inner.vertices, part.pins.positions]
    assert [value.tolist() for value in values] == [[1.0, 2.0]] * 7
    assert (part.rest.tolist(), part.pins.indices.tolist()) == ([0.0, 1.0, 2.0], [3, 1])
    assert (part.n_frames, part.first_frame) == (2, 1)
    assert part.part(slice(1, 2)).first_frame == 2
    assert set(part.frame_counts().values()) == {2}
    assert len(part.frame_counts()) == 7


def test_mistakes_in_a_part_are_told_by_the_frames_of_the_clip(imager, good):
    good["positions"] = np.concatenate([good["positions"]] * 3)
    good["positions"][4, 0, 24, 20] = np.inf
    assert imager.mask[0, 24, 20]
    with pytest.raises(InputError, match=r"the first at \[4, 0, 24, 20\]"):
        checked(inputs_of(positions=good["positions"]).part(slice(3, 6)), imager)


def test_confidence_of_the_background_does_not_count(imager, good):
    good["confidence"][:, ~imager.mask.numpy()] = np.nan
    assert torch.isfinite(checked(inputs_of(**good), imager).maps.confidence).all()


ZEROS = np.zeros((FRAMES, 2, 3))
MISTAKES = {
    "confidence shape": ({"confidence": np.ones((FRAMES, 2, 3, 3))}, "confidence must have shape"),
    "pins out of range": ({"pins": ([0, 544], ZEROS)}, r"vertex 544, but the template has 0\.\.543"),
    "pins negative": ({"pins": ([-1, 0], ZEROS)}, "vertex -1"),
    "pins twice": ({"pins": ([7, 7], ZEROS)}, "vertex 7 more than once"),
    "pins that are no numbers of vertices": ({"pins": ([0.5, 1.0], ZEROS)}, "whole numbers"),
    "pins without numbers": ({"pins": (None, ZEROS)}, "indices must be an array of numbers, found NoneType"),
    "positions of other pins": ({"pins": ([1], ZEROS)}, r"pins\.positions must have shape \(2, 1, 3\)"),
    "inner without faces": ({"inner": (ZEROS, None)}, r"inner\.faces: faces must be integers"),
    "inner of one frame": ({"inner": (ZEROS[:1], [[0, 1, 1]])}, r"inner\.vertices must have shape"),
    "inner face out of range": ({"inner": (ZEROS, [[0, 1, 3]])}, r"inner\.faces: face 0"),
    "body without vertices": ({"body": (np.zeros(3), [[0, 1, 2]])}, r"body\.vertices must have shape"),
    "body not finite": ({"body": (ZEROS + np.nan, [[0, 1, 1]])}, r"body\.vertices has 4 values .* \[0, 0\]"),
    "positions that are words": (
        {"positions": ["here"]},
        "positions must be an array of numbers, found list",
    ),
    "no frames": ({"positions": np.zeros((0, 2, 48, 40, 3))}, "no frames"),
    "no axes": ({"positions": np.float32(0)}, "no frames"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(imager, good, name):
    changed, message = MISTAKES[name]
    with pytest.raises(InputError, match=message):
        checked(inputs_of(**(good | changed)), imager)


def test_confidence_that_is_negative_or_nowhere_is_refused(imager, good):
    low = good["confidence"].copy()
    low[0, imager.mask.numpy()] = -0.5
    with pytest.raises(InputError, match=r"at least 0 .* found -0\.5"):
        checked(inputs_of(**(good | {"confidence": low})), imager)
    none = good["confidence"].copy()
    none[1] = 0
    with pytest.raises(InputError, match="0 at every covered pixel of frame 1"):
        checked(inputs_of(**(good | {"confidence": none})), imager)
    only = good | {"positions": None, "normals": None, "initial": np.zeros((FRAMES, 544, 3))}
    with pytest.raises(InputError, match="belongs to maps"):
        checked(inputs_of(**only), imager)


def test_the_rest_shape_is_the_template_where_none_is_given(imager):
    assert rest_mesh(None, imager.mesh) is imager.mesh
    wide = 1.2 * imager.mesh.vertices
    np.testing.assert_array_equal(rest_mesh(wide, imager.mesh).vertices, wide)


def test_a_map_file_is_fused_with_as_many_frames_and_no_other_maps(tmp_path, good):
    write_example(tmp_path, FRAMES)
    maps, (bodies, faces) = load_maps(tmp_path / "maps.npz"), good["body"]
    with pytest.raises(InputError, match=r"body\.vertices has 1 frames, but the maps have 2"):
        fuse_maps(maps, FusionInputs(body=MovingSurface(bodies[:1], faces)))
    with pytest.raises(InputError, match=r"pins\.positions has 3 frames, but the maps have 2"):
        fuse_maps(maps, FusionInputs(pins=PinnedVertices([0, 1], np.zeros((3, 2, 3)))))
    with pytest.raises(InputError, match="the maps are those of the map file"):
        fuse_maps(maps, FusionInputs(maps=DecodedMaps(good["positions"])))
