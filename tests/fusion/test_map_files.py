"""Map files as the fusion reads them: decoded, grown beyond their outline, and held against the template."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fusion import FusionConfig, FusionInputs, MapReading, MovingSurface, fuse, fuse_maps
from fusion.grown_maps import GrownMaps
from fusion.map_files import _MapReader, _weighted
from render import InputError, MapFile, Mesh, PositionBox, TemplateImager
from tests.helpers.example_meshes import two_triangles
from tests.helpers.fusion_examples import inputs_of, true_maps

SQUARE = two_triangles()
FEW = FusionConfig(edge_iterations=2, normal_iterations=2)
# The square moved by 0.1 m, and turned a little about the vertical.
TURN = np.array([[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]])
TRUTH = torch.from_numpy(np.stack([SQUARE.vertices + 0.1, SQUARE.vertices @ TURN.T])).float()


@pytest.fixture(scope="module")
def imager():
    return TemplateImager.build(SQUARE, views=("front", "back"), size=(20, 24), backend="numpy")


def maps_of(imager, **changed):
    positions, normals = true_maps(imager, TRUTH)
    box, mask = PositionBox.around(TRUTH.numpy()), imager.mask[..., None]
    arguments = {
        "position": (box.encode(positions) * mask).numpy(),
        "normal": ((normals + 1) / 2 * mask).numpy(),
        "box": box,
        "rotation": np.stack([np.eye(3)] * 2),
        "translation": np.zeros((2, 3)),
        "fps": 30,
    }
    return MapFile.of(imager, **arguments | changed)


@pytest.fixture
def maps(imager):
    return maps_of(imager)


def test_what_is_read_is_in_metres_and_of_unit_directions(imager, maps):
    read = _MapReader(maps, MapReading(), from_positions=True)(maps)
    positions, normals = true_maps(imager, TRUTH)
    mask = imager.mask.expand(2, -1, -1, -1)
    torch.testing.assert_close(read.positions[mask], positions[mask], rtol=0, atol=1e-6)
    torch.testing.assert_close(read.normals[mask], normals[mask], rtol=0, atol=1e-6)
    assert read.confidence is None


def test_a_file_is_fused_as_what_is_in_it(imager, maps):
    positions, normals = true_maps(imager, TRUTH)
    want = fuse(imager, inputs_of(positions=positions, normals=normals), FEW)
    found = fuse_maps(maps, config=FEW)
    np.testing.assert_allclose(found.vertices, want.vertices, atol=1e-5)
    np.testing.assert_allclose(found.initial, want.initial, atol=1e-5)


@pytest.mark.parametrize(
    ("positions_only", "initial", "want"),
    [(False, False, (True, True)), (True, False, (True, False)), (False, True, (False, True))],
)
def test_only_the_maps_that_are_needed_are_read(maps, positions_only, initial, want):
    reader = _MapReader(maps, MapReading(positions_only=positions_only), from_positions=not initial)
    read = reader(maps)
    assert (read.positions is not None, read.normals is not None) == want
    assert reader.imaged


def test_initial_vertices_alone_need_something_to_be_fused_with(maps):
    only = MapReading(positions_only=True)
    with pytest.raises(InputError, match="nothing to fuse"):
        fuse_maps(maps, FusionInputs(initial=TRUTH), FEW, reading=only)
    inner = MovingSurface(TRUTH - torch.tensor([0, 0, 0.0005]), SQUARE.faces)
    lifted = fuse_maps(
        maps, FusionInputs(initial=0.5 * TRUTH[:1].repeat(2, 1, 1), inner=inner), FEW, reading=only
    )
    assert lifted.report["terms"].keys() == {"normal"}  # for the obstacle
    assert np.isfinite(lifted.vertices).all()


def test_a_file_without_positions_needs_initial_vertices(imager):
    normals_only = maps_of(imager, position=None)
    with pytest.raises(InputError, match="maps: no position maps to start from, only normals"):
        fuse_maps(normals_only)
    found = fuse_maps(normals_only, FusionInputs(initial=TRUTH), FEW)
    np.testing.assert_array_equal(found.initial, TRUTH)


def test_a_template_of_other_vertices_or_another_outline_is_refused(maps):
    more = Mesh(np.concatenate([SQUARE.vertices, [[0, 0, 0]]]), SQUARE.faces, source="other.obj")
    with pytest.raises(InputError, match=r"other\.obj: 5 vertices, but the maps .* template of 4"):
        fuse_maps(maps, reading=MapReading(template=more))
    wide = Mesh(SQUARE.vertices * [1.2, 1, 1], SQUARE.faces, source="wide.obj")
    with pytest.raises(InputError, match=r"wide\.obj: \d+\.\d % of its pixels lie outside the maps' silh"):
        fuse_maps(maps, reading=MapReading(template=wide))
    narrow = Mesh(SQUARE.vertices * [0.9, 1, 1], SQUARE.faces)  # all of its pixels are there
    assert fuse_maps(maps, config=FEW, reading=MapReading(template=narrow)).vertices.shape == (2, 4, 3)


def test_values_are_grown_over_what_the_mask_lacks_and_what_is_eroded(imager):
    """The columns at the rim hold nonsense. Left out, they get what their neighbours say, within a fifth of a pixel."""
    mask, needed = imager.mask.numpy(), imager.mask.numpy()
    images = (imager.operator(torch.from_numpy(SQUARE.vertices))[None] * imager.mask[..., None]).numpy()
    spoilt = images.copy()
    columns = np.flatnonzero(needed[0].any(0))
    spoilt[:, :, :, columns[[0, -1]]] = 77.0
    grown = GrownMaps(imager, mask, 1)(spoilt)
    np.testing.assert_allclose(grown[:, needed], images[:, needed], atol=0.2 / 18)
    assert GrownMaps(imager, mask, 0)(spoilt) is spoilt  # nothing to do


def test_a_pixel_that_the_mask_lacks_is_grown_over(imager):
    needed = imager.mask.numpy()
    lacking = needed.copy()
    row, column = (int(part[len(part) // 2]) for part in np.nonzero(needed[0]))
    lacking[0, row, column] = False
    assert 1 / needed.sum() < 0.01  # of which that many are let pass
    images = (imager.operator(torch.from_numpy(SQUARE.vertices))[None] * imager.mask[..., None]).numpy()
    spoilt = images.copy()
    spoilt[:, 0, row, column] = 77.0
    np.testing.assert_allclose(
        GrownMaps(imager, lacking, 0)(spoilt)[:, needed], images[:, needed], atol=0.2 / 18
    )


def test_pixels_are_not_counted_below_zero(imager):
    with pytest.raises(InputError, match="erode is -1; pixels are counted from 0"):
        GrownMaps(imager, imager.mask.numpy(), -1)


def test_only_pixels_of_the_template_make_a_file_weighted(imager):
    confidence = np.ones((2, *imager.mask.shape), np.float32)
    assert not _weighted(maps_of(imager), imager)
    assert not _weighted(maps_of(imager, confidence=confidence), imager)
    outside = confidence.copy()
    outside[:, ~imager.mask.numpy()] = 0.5
    assert not _weighted(maps_of(imager, confidence=outside), imager)
    row, column = (int(part[0]) for part in np.nonzero(imager.mask[1].numpy()))
    confidence[1, 1, row, column] = 0.5
    assert _weighted(maps_of(imager, confidence=confidence), imager)


def test_rest_of_the_inputs_comes_before_the_file_s(imager):
    """The file says that edges are a tenth longer; the inputs say a fifth."""
    weights = {"weight_displacement": 1e-6, "edge_iterations": 200, "edge_tolerance": 0.0}
    config = FusionConfig(normal_iterations=0, **weights)
    maps = maps_of(imager, rest_vertices=1.1 * SQUARE.vertices)
    for rest, want in ((None, 1.1), (1.2 * SQUARE.vertices, 1.2)):
        found = fuse_maps(maps, FusionInputs(rest=rest), config).vertices
        lengths = np.linalg.norm(found[:, 0] - found[:, 1], axis=-1)
        np.testing.assert_allclose(lengths, want, rtol=1e-2)


def test_frames_are_fused_each_with_its_own(maps):
    """One frame is fused as it is among others, and the two in the other order."""
    swapped = replace(maps, position=maps.position[::-1].copy(), normal=maps.normal[::-1].copy())
    want = fuse_maps(maps, config=FEW).vertices
    np.testing.assert_allclose(fuse_maps(swapped, config=FEW).vertices, want[::-1], atol=1e-6)
    alone = fuse_maps(maps.part(slice(1, 2)), config=FEW).vertices
    np.testing.assert_allclose(alone[0], want[1], atol=1e-6)


def test_the_file_s_contact_offset_is_the_margin_unless_another_is_said(maps):
    """The square hovers 0.1 m above a floor that its margin reaches, 3 cm of it."""
    floor = np.array([[-9, 0, -9], [-9, 0, 9], [9, 0, 9], [9, 0, -9], [0, -9, 0]], np.float64)
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]])
    lowest = float(TRUTH[..., 1].min())
    raised = np.repeat((floor + np.array([0, lowest - 0.001, 0]))[None], 2, axis=0)
    inputs = FusionInputs(body=MovingSurface(raised, faces))
    known = replace(maps, contact_offset_m=0.03)

    def margin(maps, inputs=inputs, config=FEW):
        result = fuse_maps(maps, inputs, config)
        height = result.vertices[..., 1].min() - (lowest - 0.001)
        return result.report["collision_margin_m"], height, result.vertices

    assert margin(maps)[0] == 0
    said, height, vertices = margin(known)
    assert (said, height) == (0.03, pytest.approx(0.03, abs=2e-4))
    same = margin(maps, config=FEW.model_copy(update={"collision_margin_m": 0.03}))[2]
    np.testing.assert_array_equal(vertices, same)
    assert margin(known, config=FEW.model_copy(update={"collision_margin_m": 0.0}))[0] == 0
    assert margin(known, inputs=replace(inputs, contact_offset_m=0.01))[0] == 0.01
    with pytest.raises(InputError, match=r"fuse: contact_offset_m is 0\.5"):
        margin(maps, inputs=replace(inputs, contact_offset_m=0.5))
