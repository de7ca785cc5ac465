"""Maps in texture space by hand values."""

import math

import numpy as np
import torch

from imgtransfer.deformers.motion_guided.maps import TextureMaps, interaction_forces


def _maps() -> TextureMaps:
    # Two pixels of a 2 by 2 map: one shows vertex 0, one the middle of vertices 1 and 2.
    return TextureMaps(
        2,
        torch.tensor([[0.25, 0.25], [0.75, 0.25], [0.5, 0.25]]),
        torch.tensor([0, 3]),
        torch.tensor([[0, 1, 2], [0, 1, 2]]),
        torch.tensor([[1.0, 0, 0], [0, 0.5, 0.5]]),
    )


def test_values_at_pixels_and_images():
    values = torch.tensor([[[1.0, 10], [2, 20], [4, 40]]])
    at_pixels = _maps().at_pixels(values)
    np.testing.assert_allclose(at_pixels, [[[1, 10], [3, 30]]])
    np.testing.assert_allclose(_maps().image(at_pixels), [[[[1, 0], [0, 3]], [[10, 0], [0, 30]]]])


def test_where_there_is_garment():
    np.testing.assert_array_equal(_maps().covered(), [[[[1, 0], [0, 1]]]])


def test_u_goes_with_columns_and_reading_is_bilinear():
    image = torch.tensor([[[[1.0, 5], [7, 9]]]])
    np.testing.assert_allclose(_maps().at_vertices(image)[0, :, 0], [1, 5, 3])


def test_only_points_behind_a_seed_point_are_pushed_along_its_normal():
    points = torch.tensor([[[0, 0, 0.3], [0, 0, -0.2]]])
    seeds, normals = torch.tensor([[[1.0, 0, 0]]]), torch.tensor([[[0, 0, 1.0]]])
    distance = torch.tensor([[[0.5], [0.4]]])
    forces = interaction_forces(points, seeds, normals, distance, sigma=0.2)
    np.testing.assert_allclose(forces, [[[0, 0, 0], [0, 0, 0.2 * math.exp(-2)]]], rtol=1e-6)
