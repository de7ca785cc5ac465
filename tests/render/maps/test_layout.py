"""Meshes laid out flat: images of the layout, and vertices read from them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fusion import fuse_maps
from render import InputError, MapFile, Mesh, PositionBox, TemplateImager, load_maps, save_maps
from render.maps.layout import atlas, flat_layout, layout_camera
from tests.helpers.example_meshes import tube, two_triangles

# A square in two triangles, and the same cut apart along its diagonal: half of it moved to the right.
SQUARE = Mesh(np.array([[0.0, 0, 3], [1, 0, 3], [1, 1, 3], [0, 1, 3]]), np.array([[0, 1, 2], [0, 2, 3]]))
CUT = Mesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [1.2, 0, 0], [2.2, 1, 0], [1.2, 1, 0]]),
    np.array([[0, 1, 2], [3, 4, 5]]),
)


def seen_straight(size: tuple[int, int]) -> TemplateImager:
    return TemplateImager.build(SQUARE, layout=CUT, size=size, backend="numpy")


def test_pixels_show_the_vertices_of_their_chart() -> None:
    imager = seen_straight((40, 88))
    box = PositionBox(np.zeros(3), np.full(3, 4.0))
    image = imager.position_maps(torch.from_numpy(SQUARE.vertices), box)[0] * 4
    # The layout is 2.2 wide in an image whose margins are a twentieth: 36 pixels a metre, 4 of margin at the left.
    rows, columns = np.nonzero(imager.raster.mask[0])
    u, v = (columns + 0.5 - 4.4) / 36, 1 - (rows + 0.5 - 2) / 36
    second = u > 1.1
    wanted = np.stack([u - 1.2 * second, v, np.full(len(u), 3.0)], 1)
    np.testing.assert_allclose(image[rows, columns].numpy(), wanted, atol=1e-9)
    assert len(u) == pytest.approx(36**2, rel=0.05)


def test_vertices_are_read_as_the_mean_of_their_places() -> None:
    imager = seen_straight((40, 88))
    assert imager.visible.all()
    box = PositionBox(np.zeros(3), np.full(3, 4.0))
    vertices = torch.from_numpy(SQUARE.vertices)
    images = imager.position_maps(vertices, box)
    read = imager.sample(images)[0].numpy() * 4
    # Corners of a chart have no pixel of it around them: a pixel, of 1/36 m, each way.
    np.testing.assert_allclose(read, SQUARE.vertices, atol=1.01 / 36)
    # The right half alone says 1 more: the diagonal's vertices, 0 and 2, have a place in either half.
    right = torch.arange(88) > 44
    raised = images + (imager.mask & right)[..., None] / 4
    moved = imager.sample(raised)[0].numpy() * 4 - read
    np.testing.assert_allclose(moved, np.array([0.5, 0, 0.5, 1])[:, None].repeat(3, 1), atol=1e-6)


def test_charts_that_touch_are_read_apart() -> None:
    """The halves of the layout meet without a gap, turned by half: their pixels are neighbours, their cloth is not."""
    close = Mesh(CUT.vertices - np.array([[0, 0, 0]] * 3 + [[1.2, 0, 0]] * 3), CUT.faces)
    imager = TemplateImager.build(SQUARE, layout=close, size=(40, 40), backend="numpy")
    images = torch.zeros(1, 40, 40, 1, dtype=torch.float64)
    images[torch.from_numpy(imager.raster.face_id == 1)] = 1.0
    np.testing.assert_allclose(imager.sample(images)[0, :, 0], [0.5, 0, 0.5, 1], atol=1e-6)


def test_some_frames_are_what_each_is_alone() -> None:
    imager = seen_straight((24, 48))
    frames = torch.randn(3, 4, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    together = imager.normal_maps(frames), imager.sample(imager.operator(frames))
    for index, frame in enumerate(frames):
        assert torch.equal(together[0][index], imager.normal_maps(frame))
        assert torch.equal(together[1][index], imager.sample(imager.operator(frame)))


def test_a_template_laid_out_by_xatlas_comes_back_from_its_images() -> None:
    mesh = tube(24, 16)
    layout = flat_layout(mesh)
    imager = TemplateImager.build(mesh, layout=layout, size=(96, 96), backend="numpy")
    assert imager.visible.mean() > 0.98
    sides = [mesh.vertices[mesh.faces], layout.vertices[layout.faces]]
    of_mesh, of_layout = (
        np.linalg.norm(np.cross(s[:, 1] - s[:, 0], s[:, 2] - s[:, 0]), axis=1).sum() for s in sides
    )
    assert of_layout == pytest.approx(of_mesh)
    vertices = torch.from_numpy(mesh.vertices)
    read = imager.sample(imager.operator(vertices))[0].numpy()
    pixel = np.ptp(layout.vertices, axis=0).max() / (0.9 * 96)
    error = np.linalg.norm(read - mesh.vertices, axis=1)[imager.visible[0]]
    assert error.max() < pixel
    assert error.mean() < 0.2 * pixel


def test_maps_of_a_layout_are_fused_from_their_file(tmp_path: Path) -> None:
    mesh = tube(24, 16)
    imager = TemplateImager.build(mesh, layout=flat_layout(mesh), size=(96, 96), backend="numpy")
    moved = mesh.vertices @ np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]) + [0.02, 0.1, 0.0]
    box = PositionBox.around(moved)
    position, normal = imager.maps(torch.from_numpy(moved.astype(np.float32))[None], box)
    maps = MapFile.of(
        imager,
        position=position.numpy(),
        normal=normal.numpy(),
        box=box,
        rotation=np.eye(3)[None],
        translation=np.zeros((1, 3)),
        fps=30,
    )
    save_maps(tmp_path / "maps.npz", maps)
    read = load_maps(tmp_path / "maps.npz")
    assert read.format_version == 4
    assert read.layout is not None
    np.testing.assert_array_equal(read.layout.vertices, maps.layout_vertices)
    result = fuse_maps(read)
    error = np.linalg.norm(result.vertices[0] - moved, axis=1)
    edge = np.linalg.norm(np.diff(moved[mesh.edges], axis=1), axis=-1).mean()
    assert error.mean() < 0.05 * edge
    with pytest.raises(InputError, match="no room for a layout"):
        save_maps(tmp_path / "folder", maps)
    with pytest.raises(InputError, match="need each other"):
        replace(maps, layout_faces=None)
    with pytest.raises(InputError, match="are not those of the mesh"):
        replace(maps, layout_vertices=CUT.vertices, layout_faces=CUT.faces)


def test_a_layout_of_another_mesh_is_refused() -> None:
    turned = Mesh(CUT.vertices, CUT.faces[::-1])
    TemplateImager.build(
        SQUARE, layout=turned, size=(16, 16), backend="numpy"
    )  # its own names for the corners
    with pytest.raises(InputError, match="6 vertices and 1 faces that are not those of the mesh"):
        TemplateImager.build(two_triangles(), layout=Mesh(CUT.vertices, CUT.faces[:1]), size=(16, 16))
    joined = Mesh(CUT.vertices, np.array([[0, 1, 2], [3, 2, 5]]))
    wrong = Mesh(SQUARE.vertices, np.array([[0, 1, 2], [0, 3, 2]]))
    with pytest.raises(InputError, match="not those of the mesh"):
        TemplateImager.build(wrong, layout=joined, size=(16, 16))


def test_the_camera_sees_the_layout_upright() -> None:
    camera = layout_camera(CUT, (40, 88))
    assert camera.name == "uv"
    places = camera.project(CUT.vertices)[:, :2]
    np.testing.assert_allclose(places[[0, 1, 5]], [[4.4, 38], [40.4, 38], [47.6, 2]], atol=1e-6)


def test_without_xatlas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xatlas", None)
    with pytest.raises(
        InputError, match=r"maps.views: uv needs the package xatlas: pip install 'imgtransfer\[uv\]'"
    ):
        flat_layout(SQUARE)
    with pytest.raises(InputError, match="the drawing of charts needs the package xatlas"):
        atlas(SQUARE.vertices, SQUARE.faces, "the drawing of charts")
