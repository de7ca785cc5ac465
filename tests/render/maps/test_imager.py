import numpy as np
import pytest
import torch

from render import (
    InputError,
    Mesh,
    PositionBox,
    TemplateImager,
    decode_normals,
    frame_cameras,
    vertex_normals,
)
from tests.helpers.example_meshes import sphere, tube, two_quads, two_triangles


@pytest.fixture(scope="module")
def imager():
    return TemplateImager.build(tube(), size=(128, 96))


def rotation(angle):
    return torch.tensor(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]],
        dtype=torch.float64,
    )


def test_attributes(imager):
    mesh = tube()
    assert imager.size == (128, 96)
    assert imager.mask.shape == (2, 128, 96)
    assert imager.visible.shape == (2, len(mesh.vertices))
    assert imager.visible.dtype == bool
    assert torch.equal(imager.faces, torch.tensor(mesh.faces))
    assert [camera.name for camera in imager.cameras] == ["front", "back"]


def test_position_maps_show_where_each_pixel_s_ray_meets_the_template(imager):
    box = PositionBox.around(imager.mesh.vertices)
    maps = imager.position_maps(torch.tensor(imager.mesh.vertices), box)
    assert (maps[~imager.mask] == 0).all()
    assert maps[imager.mask].min() > 0
    assert maps[imager.mask].max() < 1
    for view, camera in enumerate(imager.cameras):
        rows, columns = np.nonzero(imager.mask[view].numpy())
        projected = camera.project(box.decode(maps)[view].numpy()[rows, columns])
        # Centres that snapping put outside their face are moved onto it, by less than 1/100 pixel.
        np.testing.assert_allclose(projected[:, :2], np.stack([columns + 0.5, rows + 0.5], 1), atol=0.01)
        np.testing.assert_allclose(projected[:, 2], imager.raster.depth[view][rows, columns], atol=1e-6)


def test_the_silhouette_is_the_template_s_whatever_the_deformation(imager):
    box = PositionBox([-9, -9, -9], [9, 9, 9])
    vertices = torch.tensor(imager.mesh.vertices, dtype=torch.float32)
    maps = imager.position_maps(torch.stack([vertices, vertices * 3 + 1]), box)
    assert maps.shape == (2, 2, 128, 96, 3)
    assert maps.dtype == torch.float32
    assert torch.equal((maps != 0).any(-1), imager.mask.expand(2, -1, -1, -1))


def test_normal_maps_of_a_square_by_hand():
    imager = TemplateImager.build(two_triangles(), size=(16, 16))
    flat = torch.tensor(two_triangles().vertices)
    maps = imager.normal_maps(torch.stack([flat, flat @ rotation(np.pi / 2).T]))  # facing +z, then +x
    for image, colour in zip(maps, ([0.5, 0.5, 1.0], [1.0, 0.5, 0.5]), strict=True):
        expected = torch.tensor(colour, dtype=torch.float64).expand(int(imager.mask.sum()), 3)
        torch.testing.assert_close(image[imager.mask], expected)
    assert (maps[:, ~imager.mask] == 0).all()


def test_maps_turn_with_the_mesh(imager):
    box = PositionBox([-1, -1, -1], [1, 1, 1])
    vertices = torch.tensor(imager.mesh.vertices)
    turn, shift = rotation(0.7), torch.tensor([0.1, -0.2, 0.05], dtype=torch.float64)
    moved = vertices @ turn.T + shift
    plain = box.decode(imager.position_maps(vertices, box))[imager.mask]
    torch.testing.assert_close(
        box.decode(imager.position_maps(moved, box))[imager.mask], plain @ turn.T + shift
    )
    normals = decode_normals(imager.normal_maps(vertices))[imager.mask]
    torch.testing.assert_close(decode_normals(imager.normal_maps(moved))[imager.mask], normals @ turn.T)


@pytest.mark.parametrize("size", [(96, 64), (128, 128), (256, 256)])
def test_sampling_the_template_s_own_positions_returns_the_vertices(size):
    imager = TemplateImager.build(tube(), size=size)
    vertices = torch.tensor(imager.mesh.vertices)
    box = PositionBox.around(imager.mesh.vertices)
    read = box.decode(imager.sample(imager.position_maps(vertices, box)))
    error = (read - vertices).norm(dim=-1).numpy()[imager.visible]
    camera = imager.cameras[0]
    pixel = camera.project(np.zeros(3))[2] / (
        camera.projection[1, 1] * size[0] / 2
    )  # metres at the tube's axis
    assert error.mean() < 0.2 * pixel
    assert np.percentile(error, 90) < 0.25 * pixel
    assert (
        error.max() < 11 * pixel
    )  # at the silhouette; no pixel deeper than ten is taken for the same surface


def test_sampling_follows_an_affine_deformation(imager):
    # The weights were fitted on the template; stretching and shearing it must not cost accuracy.
    vertices = torch.tensor(imager.mesh.vertices)
    matrix = torch.tensor([[1.2, 0.3, 0], [0, 0.8, 0.1], [0.2, 0, 1]], dtype=torch.float64)
    moved = vertices @ matrix.T + 1
    plain = imager.sample(imager.operator(vertices)) - vertices
    read = imager.sample(imager.operator(moved)) - moved
    visible = torch.from_numpy(imager.visible)
    torch.testing.assert_close(read[visible], (plain @ matrix.T)[visible], atol=1e-9, rtol=0)


def test_sampling_inside_a_plane_is_exact():
    # Bilinear weights reproduce what is linear over the image; on the plane, everything affine is.
    grid = np.linspace(-0.5, 0.5, 12)
    x, y = np.meshgrid(grid, grid)
    index = np.arange(144).reshape(12, 12)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    mesh = Mesh(np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3), faces)
    imager = TemplateImager.build(mesh, size=(64, 64))
    assert imager.visible.all()
    inside = np.abs(mesh.vertices[:, :2]).max(axis=1) < 0.49
    vertices = torch.tensor(mesh.vertices)
    read = imager.sample(imager.operator(vertices))
    torch.testing.assert_close(read[:, inside], vertices[inside].expand(2, -1, -1), atol=1e-9, rtol=0)


def test_sampling_leaves_constants_alone_and_never_sees_the_background(imager):
    # 1 on the silhouette, a wild value around it.
    images = torch.where(imager.mask[..., None], 1.0, 1e6).to(torch.float64)
    read = imager.sample(images)[torch.from_numpy(imager.visible)]
    torch.testing.assert_close(read, torch.ones_like(read), atol=1e-9, rtol=0)


def test_sampling_never_sees_a_surface_in_front():
    # Rear square larger than the front one, its vertices seen just beside the front square's border.
    quads = two_quads()
    border = np.linspace(-0.26, 0.26, 9)
    strip = np.stack([border, np.full(9, 0.275), np.full(9, -0.2)], -1)
    front = quads.vertices[:4] * 0.5
    rear = np.concatenate([strip, [[-0.4, 0.6, -0.2], [0.4, 0.6, -0.2], [0, -0.6, -0.2]]])
    fan = [[4 + k, 5 + k, 14] for k in range(8)] + [[4 + k, 5 + k, 15] for k in range(8)]
    mesh = Mesh(np.concatenate([front, rear]), np.concatenate([quads.faces[:2], fan]))
    imager = TemplateImager.build(mesh, views=["front"], size=(48, 48))
    colour = torch.zeros(len(mesh.vertices), 1, dtype=torch.float64)
    colour[4:] = 1.0  # front square 0, rear 1
    read = imager.sample(imager.operator(colour))[0, :, 0]
    visible = torch.from_numpy(imager.visible[0])
    assert visible[4:13].sum() >= 2
    torch.testing.assert_close(read[visible], colour[visible, 0], atol=1e-9, rtol=0)


def test_vertices_that_nothing_covers_are_read_as_zero():
    mesh = Mesh(
        np.concatenate([two_triangles().vertices, [[0.0, 0.0, 0.5], [3, 0, 0], [0, 0, 90]]]),
        two_triangles().faces,
    )
    cameras = frame_cameras(two_triangles(), views=["front"], size=(16, 16))
    imager = TemplateImager.build(mesh, cameras=cameras)
    read = imager.sample(torch.ones(1, 16, 16, 1))
    np.testing.assert_array_equal(imager.visible[0, 4:], [False, False, False])
    np.testing.assert_allclose(
        read[0, :, 0], [1, 1, 1, 1, 1, 0, 0], atol=1e-6
    )  # the fifth floats before the square


def test_sampling_is_differentiable_and_batched(imager):
    torch.manual_seed(0)
    images = torch.randn(2, 2, 128, 96, 3, dtype=torch.float64, requires_grad=True)
    read = imager.sample(images)
    assert read.shape == (2, 2, len(imager.mesh.vertices), 3)
    for k in range(2):
        torch.testing.assert_close(read[k], imager.sample(images[k]))
    weights = torch.randn_like(read)
    (gradient,) = torch.autograd.grad((read * weights).sum(), images)
    assert (gradient[:, ~imager.mask] == 0).all()
    step = torch.randn_like(images)
    torch.testing.assert_close((gradient * step).sum(), (imager.sample(step) * weights).sum())


def test_the_body_is_imaged_with_the_garment_s_cameras(imager):
    body = sphere(0.2)
    imaged = TemplateImager.build(body, cameras=imager.cameras)
    assert imaged.cameras == imager.cameras
    assert imaged.size == imager.size
    normals = vertex_normals(torch.tensor(body.vertices), imaged.faces)
    read = decode_normals(imaged.sample(imaged.normal_maps(torch.tensor(body.vertices))))[0]
    facing = (imaged.visible[0]) & (body.vertices[:, 2] > 0.1)
    assert facing.sum() > 100
    assert (read - normals)[facing].norm(dim=-1).max() < 0.05


def test_images_of_another_size_are_refused(imager):
    with pytest.raises(InputError, match="images must have shape"):
        imager.sample(torch.zeros(2, 96, 128, 3))
    with pytest.raises(InputError, match="images must have shape"):
        imager.sample(torch.zeros(1, 128, 96, 3))


def test_both_kinds_of_maps_together_are_those_made_apart(imager):
    vertices = torch.tensor(imager.mesh.vertices).expand(2, -1, -1) * torch.tensor([1.0, 1.1, 0.9])
    box = PositionBox.around(vertices.numpy())
    positions, normals = imager.maps(vertices, box)
    torch.testing.assert_close(positions, imager.position_maps(vertices, box), rtol=0, atol=1e-14)
    torch.testing.assert_close(normals, imager.normal_maps(vertices), rtol=0, atol=1e-14)


def test_maps_are_made_without_working_out_how_they_would_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bodies are imaged and never read back, and that is most of what an imager costs."""
    monkeypatch.setattr("render.maps.imager.sampling", None)  # to call it fails
    imager = TemplateImager.build(tube(), size=(32, 24))
    maps = imager.position_maps(
        torch.from_numpy(imager.mesh.vertices), PositionBox.around(imager.mesh.vertices)
    )
    assert maps.shape == (2, 32, 24, 3)
    with pytest.raises(TypeError):
        _ = imager.visible
