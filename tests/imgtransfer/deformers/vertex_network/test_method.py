"""Networks on the vertices: what they look at, and that they learn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from imgtransfer.data.clip import Clip
from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.common.laplacian import graph_laplacian
from imgtransfer.deformers.vertex_network.method import (
    GraphNetwork,
    GraphNetworkConfig,
    PointNet,
    PointNetConfig,
)
from imgtransfer.deformers.vertex_network.network import BODY_INPUTS, INPUTS, VertexNetwork
from render import InputError
from tests.helpers.synthetic import tube_clip
from tests.imgtransfer.deformers.moves import placed, turned

SMALL = {"features": 32, "body_points": 40, "steps": 150, "batch_frames": 4, "learning_rate": 1e-2}
FRAMES = 12


@pytest.fixture(scope="module", params=["pointnet", "gcn"])
def method(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> PointNet:
    made = (
        PointNet(PointNetConfig(**SMALL))
        if request.param == "pointnet"
        else GraphNetwork(GraphNetworkConfig(**SMALL, blocks=3))
    )
    made.fit([tube_clip(FRAMES)], FitFolder(tmp_path_factory.mktemp(request.param)))
    return made


def error_mm(got: np.ndarray, clip: Clip) -> float:
    assert clip.garment is not None
    return float(1e3 * np.linalg.norm(got - clip.garment.vertices, axis=-1).mean())


def test_a_short_clip_is_learned(method: PointNet) -> None:
    clip = tube_clip(FRAMES)
    untrained = type(method)(method.config.model_copy(update={"steps": 0}))
    untrained.faces, untrained.nearest, untrained.points = method.faces, method.nearest, method.points
    untrained.network = untrained._made()
    assert error_mm(method.predict(clip), clip) < error_mm(untrained.predict(clip), clip) / 3


def test_a_clip_turned_about_the_vertical_is_predicted_turned(method: PointNet) -> None:
    clip = tube_clip(FRAMES)
    np.testing.assert_allclose(method.predict(turned(clip)), placed(method.predict(clip)), atol=2e-4)


def test_the_garments_motion_is_not_looked_at(method: PointNet) -> None:
    clip = tube_clip(FRAMES)
    np.testing.assert_array_equal(method.predict(replace(clip, garment=None)), method.predict(clip))


def test_restored_it_predicts_the_same(method: PointNet) -> None:
    again = type(method)(method.config)
    again.restore(method.tensors())
    np.testing.assert_array_equal(again.predict(tube_clip(3)), method.predict(tube_clip(3)))
    other = method.tensors() | {"network.points.0.weight": torch.zeros(3, 3)}
    with pytest.raises(ValueError, match="the weights are of another network"):
        again.restore(other)


def test_another_garment_or_body_is_one_line(method: PointNet) -> None:
    with pytest.raises(InputError, match="another garment"):
        method.predict(tube_clip(2, rings=10))
    with pytest.raises(InputError, match="its body has 74 vertices"):
        method.predict(tube_clip(2, sides=8))


def inputs(vertices: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    return torch.randn(2, vertices, INPUTS, generator=generator), torch.randn(
        2, 5, BODY_INPUTS, generator=generator
    )


def network(laplacian: object = None, blocks: int = 2) -> VertexNetwork:
    torch.manual_seed(0)
    made = VertexNetwork(8, blocks, laplacian)  # type: ignore[arg-type]
    torch.nn.init.normal_(made.out[-1].weight)
    return made


def test_vertices_of_pointnet_have_no_order() -> None:
    made, (vertices, body) = network(), inputs(6)
    order = torch.tensor([3, 0, 5, 1, 4, 2])
    torch.testing.assert_close(
        made(vertices[:, order], body[:, [4, 2, 0, 1, 3]]), made(vertices, body)[:, order]
    )


def test_a_graph_network_sees_as_many_edges_far_as_it_has_layers() -> None:
    """A strip of triangles 0-1-2, 1-2-3, ...: from vertex 0 two edges reach vertex 4."""
    faces = np.array([[i, i + 1, i + 2] for i in range(7)])
    made, (vertices, body) = network(graph_laplacian(faces, 9)), inputs(9)
    other = vertices.clone()
    other[:, 0] += 1
    changed = (made(other, body) != made(vertices, body)).any(-1).any(0)
    assert changed.tolist() == [True] * 5 + [False] * 4


def test_a_layer_by_hand() -> None:
    made, (vertices, body) = network(graph_laplacian(np.array([[0, 1, 2]]), 3), blocks=1), inputs(3)
    told = made.points(vertices)
    means = torch.stack([(told[:, (i + 1) % 3] + told[:, (i + 2) % 3]) / 2 for i in range(3)], dim=1)
    told = told + made.layers[0](told + means)
    code = made.body(body).amax(1)[:, None].expand(-1, 3, -1)
    torch.testing.assert_close(made(vertices, body), made.out(torch.cat([told, code], -1)))


def test_a_fit_goes_on(tmp_path: Path) -> None:
    config = PointNetConfig(**SMALL | {"steps": 4})
    for steps, folder in ((2, "parts"), (4, "parts"), (4, "whole")):
        method = PointNet(config.model_copy(update={"steps": steps}))
        (tmp_path / folder).mkdir(exist_ok=True)
        method.fit([tube_clip(3)], FitFolder(tmp_path / folder))
        if folder == "parts":
            parts = method.tensors()
    assert all(torch.equal(parts[key], value) for key, value in method.tensors().items())
