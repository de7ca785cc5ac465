"""`rest`: edges are kept to the lengths of the garment's own shape, pixels are those of the imager's template."""

import dataclasses

import numpy as np
import pytest
import torch

from fusion import FusionConfig, FusionResult, fuse, fuse_maps
from render import (
    InputError,
    MapFile,
    Mesh,
    PositionBox,
    TemplateImager,
    encode_normals,
    frame_cameras,
    load_maps,
    save_maps,
)
from tests.helpers.fusion_examples import cylinder_body, imager_of, inputs_of, leaning, true_maps, tube

SIDE, LONGER = 0.1, 1.1
SOLVERS = ("local_global", "adam")


@pytest.fixture(scope="module")
def square():
    """Two triangles with a side of 10 cm that face the camera."""
    corners = SIDE * np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "square")
    cameras = frame_cameras(mesh, views=("front",), size=(32, 32))
    return TemplateImager.build(mesh, cameras=cameras, backend="numpy")


def fused(imager, solver, rest, *, normals: bool) -> FusionResult:
    """The template's own maps, and edges that are to be those of `rest`; nothing else pulls."""
    positions, facing = true_maps(imager, torch.tensor(imager.mesh.vertices, dtype=torch.float32)[None])
    config = FusionConfig(
        solver=solver,
        weight_displacement=0.0,
        edge_tolerance=1e-6,
        normal_tolerance=1e-6,
        edge_steps=200,
        normal_steps=20,
        learning_rate_m=1e-4,
    )
    inputs = inputs_of(positions=positions, normals=facing if normals else None, rest=rest)
    return fuse(imager, inputs, config)


@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize("solver", SOLVERS)
def test_edges_get_the_lengths_of_rest_and_not_of_the_template(square, solver, normals):
    result = fused(square, solver, LONGER * square.mesh.vertices, normals=normals)
    wanted = LONGER * SIDE * np.sqrt([1, 2, 1, 1, 1])  # the second of the five edges is the diagonal
    start, end = (
        np.linalg.norm(np.diff(vertices[0][square.mesh.edges], axis=1)[:, 0], axis=1)
        for vertices in (result.initial, result.vertices)
    )
    np.testing.assert_allclose(end, wanted, rtol=2e-3)
    reported = result.report["terms"]["edge"]["start"]["edge_length_m2"]
    assert reported == pytest.approx(np.square(start - wanted).mean(), rel=1e-4)
    if normals:
        assert result.report["terms"]["normal"]["end"]["edge_length_m2"] < 1e-7


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_template_as_rest_is_as_none(square, solver):
    given, none = (fused(square, solver, rest, normals=True) for rest in (square.mesh.vertices, None))
    np.testing.assert_array_equal(given.vertices, none.vertices)
    np.testing.assert_allclose(none.vertices[0], square.mesh.vertices, atol=2e-4)


@pytest.fixture(scope="module")
def wide_tube():
    """Imager of the tube, the tube 15 % wider, and its positions and normals as it leans."""
    imager = imager_of(tube())
    wide = imager.mesh.vertices * [1.15, 1, 1.15]
    return imager, wide, true_maps(imager, torch.from_numpy(leaning(wide, 2)))


def test_another_shape_comes_out_of_exact_maps_with_its_rest(wide_tube):
    imager, wide, (positions, normals) = wide_tube
    body = cylinder_body()
    arguments = {
        "positions": positions,
        "normals": normals,
        "body": (leaning(body.vertices, 2), body.faces),
    }
    off = [
        1000
        * np.linalg.norm(
            fuse(imager, inputs_of(rest=rest, **arguments)).vertices - leaning(wide, 2), axis=-1
        ).mean()
        for rest in (wide, None)
    ]
    assert off[0] < 1
    assert off[1] > 5 * off[0]  # drawn to the narrower template


@pytest.mark.parametrize("name", ["maps.npz", "maps"], ids=["npz", "exr"])
def test_a_map_file_brings_its_rest_along(wide_tube, tmp_path, name):
    imager, wide, (positions, normals) = wide_tube
    box = PositionBox.around(leaning(wide, 2))
    mask = imager.mask[..., None]
    maps = MapFile.of(
        imager,
        position=(box.encode(positions) * mask).numpy(),
        normal=(encode_normals(normals) * mask).numpy(),
        box=box,
        rotation=np.stack([np.eye(3)] * 2),
        translation=np.zeros((2, 3)),
        fps=30,
        rest_vertices=wide,
    )
    save_maps(tmp_path / name, maps)
    read = load_maps(tmp_path / name)
    np.testing.assert_array_equal(read.rest.vertices, wide)
    found = fuse_maps(read)
    decoded = {"positions": box.decode(maps.position), "normals": 2 * maps.normal - 1}
    given = fuse(imager, inputs_of(**decoded, rest=wide))
    np.testing.assert_allclose(found.vertices, given.vertices, atol=1e-4)  # the maps' encoding rounds
    without = fuse_maps(dataclasses.replace(read, rest_vertices=None))
    assert np.abs(without.vertices - found.vertices).max() > 0.002


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda v: v[:-1], r"rest must have shape \(544, 3\), found \(543, 3\)"),
        (lambda v: v * 100, r"edges of rest are .* m long \(median\), those of the template .*, in metres"),
        (lambda v: np.where(v > 0.1, np.nan, v), r"rest: vertex \d+ is .*, not finite"),
    ],
)
def test_a_rest_that_does_not_fit_is_one_line(wide_tube, spoil, message):
    imager, wide, (positions, _) = wide_tube
    with pytest.raises(InputError, match=message) as error:
        fuse(imager, inputs_of(positions=positions, rest=spoil(wide)))
    assert "\n" not in str(error.value)
