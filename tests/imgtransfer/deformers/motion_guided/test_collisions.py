"""The residual map takes a garment out of the body."""

import numpy as np
import torch
from scipy.spatial import cKDTree

from imgtransfer.data.clip_parts import Template
from imgtransfer.deformers.common.laplacian import graph_laplacian
from imgtransfer.deformers.motion_guided.collisions import Surface, depths, resolved
from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig
from imgtransfer.deformers.motion_guided.maps import TextureMaps
from imgtransfer.deformers.motion_guided.skinning import local_axes
from imgtransfer.deformers.motion_guided.texture_space import texture_space
from render.mesh.surface import Surface as Look

CONFIG = MotionGuidedConfig(uv_size=8, channels=(4, 4))


def _sheet(height: float) -> tuple[Template, torch.Tensor]:
    """A sheet of 5 by 5 vertices at a height, with the coordinates of a square."""
    x, z = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5), indexing="ij")
    vertices = np.stack([x, np.full_like(x, height), z], -1).reshape(-1, 3).astype(np.float32)
    a = (5 * np.arange(4)[:, None] + np.arange(4)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 6], -1), np.stack([a, a + 6, a + 5], -1)])
    look = Look(faces, np.arange(25), np.ascontiguousarray(vertices[:, [0, 2]]), faces)
    return Template(vertices, faces, look), torch.from_numpy(vertices)


def _resolved(height: float, **settings: float) -> tuple[torch.Tensor, torch.Tensor, Surface]:
    template, garment = _sheet(height)
    space = texture_space(template, 8)
    maps = TextureMaps(
        8, *(torch.from_numpy(part) for part in (space.uvs, space.pixels, space.corners, space.weights))
    )
    floor = _sheet(0.0)[1]
    body = Surface(floor, torch.tensor([0, 1.0, 0]).expand(25, 3))
    clear = resolved(
        garment,
        torch.from_numpy(local_axes(template)),
        body,
        maps=maps,
        laplacian=graph_laplacian(template.faces, 25),
        config=CONFIG.model_copy(update=settings),
    )
    return garment, clear, body


def test_depths_by_hand():
    body = Surface(torch.tensor([[0.0, 0, 0], [5, 0, 0]]), torch.tensor([[0, 1.0, 0], [0, 1, 0]]))
    garment = torch.tensor([[0.1, -0.02, 0], [5, 0.3, 0]])
    np.testing.assert_allclose(depths(garment, body, cKDTree(body.vertices.numpy())), [0.02, 0], atol=1e-9)


def test_a_sheet_in_the_floor_comes_out():
    garment, clear, body = _resolved(-0.005)
    depth = depths(clear, body, cKDTree(body.vertices.numpy()))
    assert depth.sum() < 0.1 * 25 * 0.005
    assert (clear - garment).abs().max() < 0.01


def test_a_sheet_above_the_floor_stays():
    garment, clear, _ = _resolved(0.005)
    assert clear is garment


def test_no_steps_leave_collisions():
    garment, clear, _ = _resolved(-0.005, residual_steps=0)
    assert clear is garment
