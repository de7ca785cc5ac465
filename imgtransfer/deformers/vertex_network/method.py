"""The deformers `pointnet` and `gcn`: the garment's vertices estimated by a network on them (the paper's table 7).

The paper does not say how its two were made. Here both see of each vertex the template and the nearest body vertex, and
a code of all of the body; positions alone are estimated, from single frames in the canonical frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from pydantic import Field
from scipy.spatial import cKDTree
from torch import Tensor

from imgtransfer.config.schema import Ratio, Section
from imgtransfer.data.canonical import RootFrames, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.base import Deformer, FitFolder, check_faces, same_garment
from imgtransfer.deformers.common.laplacian import graph_laplacian
from imgtransfer.deformers.descent import descend
from imgtransfer.deformers.vertex_network.network import VertexNetwork
from render import InputError, vertex_normals

_AT_ONCE = 32  # frames that are predicted together


class PointNetConfig(Section):
    """A network on the garment's vertices that pools over all of them."""

    features: int = Field(128, ge=1, le=4096, description="Width of the layers.")
    body_points: int = Field(
        512, ge=1, le=100_000, description="Vertices of the body at most, evenly taken, that it is told by."
    )
    steps: int = Field(10_000, ge=0, le=10**9, description="Steps of Adam, a batch each.")
    batch_frames: int = Field(8, ge=1, le=4096, description="Frames of a batch.")
    learning_rate: Ratio = Field(1e-3, gt=0, le=10, description="Adam's.")


class GraphNetworkConfig(PointNetConfig):
    """A network on the garment's vertices that looks along its edges."""

    blocks: int = Field(8, ge=1, le=256, description="Layers; each sees one edge farther.")


class PointNet(Deformer):
    """Each vertex by itself, with codes of all vertices and of the body."""

    name: ClassVar[str] = "pointnet"
    Config = PointNetConfig
    faces: np.ndarray  # (F, 3), by which the garment is known again
    nearest: Tensor  # (N,) int64, of each vertex the nearest body vertex at rest
    points: Tensor  # (P,) int64, the body's
    network: VertexNetwork

    def fit(self, clips: Sequence[Clip], folder: FitFolder) -> None:
        if folder.threads is not None:
            torch.set_num_threads(folder.threads)
        first, config = same_garment(clips), self._settings()
        self.faces = first.template.faces
        count = len(first.body.rest)
        self.nearest = torch.from_numpy(cKDTree(first.body.rest).query(first.template.vertices)[1])
        self.points = torch.linspace(0, count - 1, min(config.body_points, count)).round().long()
        shown = [self._shown(clip, root_frames(clip, "root")) for clip in clips]
        vertices, bodies = (torch.cat(parts) for parts in zip(*shown, strict=True))
        truth = torch.cat([_offsets(clip) for clip in clips])
        torch.manual_seed(folder.seed)
        self.network = self._made()

        def loss(step: int) -> dict[str, Tensor]:
            generator = torch.Generator().manual_seed(hash((folder.seed, step)) & 0x7FFFFFFF)
            some = torch.randint(len(truth), (config.batch_frames,), generator=generator)
            return {"position_m": (self.network(vertices[some], bodies[some]) - truth[some]).abs().mean()}

        descend(
            self.network,
            loss,
            stage=self.name,
            steps=config.steps,
            learning_rate=lambda _: config.learning_rate,
            folder=folder,
        )

    @torch.no_grad()
    def predict(self, clip: Clip) -> np.ndarray:
        check_faces(clip, self.faces)
        frames = root_frames(clip, "root")
        shown = zip(*(part.split(_AT_ONCE) for part in self._shown(clip, frames)), strict=True)
        offsets = torch.cat([self.network(vertices, body) for vertices, body in shown])
        return frames.to_world(clip.template.vertices + offsets.numpy())

    def tensors(self) -> dict[str, Tensor]:
        fixed = {
            "faces": torch.from_numpy(self.faces),
            "nearest": self.nearest,
            "points": self.points,
        }
        return fixed | {f"network.{key}": value for key, value in self.network.state_dict().items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        self.faces = tensors["faces"].numpy()
        self.nearest, self.points = tensors["nearest"], tensors["points"]
        count = len(self.nearest)
        if self.faces.ndim != 2 or self.faces.min() < 0 or self.faces.max() >= count:
            raise ValueError(f"faces must be of the {count} vertices")
        if min(int(self.nearest.min()), int(self.points.min())) < 0:
            raise ValueError("body vertices must be numbers from 0 on")
        start = "network."
        weights = {key.removeprefix(start): tensors[key] for key in tensors if key.startswith(start)}
        self.network = self._made()
        try:
            self.network.load_state_dict(weights, strict=True)
        except RuntimeError as error:
            raise ValueError(f"the weights are of another network ({error})") from error
        self.network.eval()

    def _settings(self) -> PointNetConfig:
        assert isinstance(self.config, PointNetConfig)
        return self.config

    def _made(self) -> VertexNetwork:
        return VertexNetwork(self._settings().features, 0, None)

    def _shown(self, clip: Clip, frames: RootFrames) -> tuple[Tensor, Tensor]:
        """What the network is told of a clip's frames: of vertices (T, N, 12), of body points (T, P, 6)."""
        if len(clip.body.rest) <= int(max(self.nearest.max(), self.points.max())):
            raise InputError(
                f"{clip.name}: its body has {len(clip.body.rest)} vertices, and {self.name} was fitted to one with "
                "more; clips of one body are wanted"
            )
        posed = torch.from_numpy(frames.to_canonical(clip.body.vertices))
        told = torch.cat([posed, vertex_normals(posed, torch.from_numpy(clip.body.faces))], dim=-1)
        template = torch.from_numpy(clip.template.vertices.astype(np.float32))
        normals = vertex_normals(template[None], torch.from_numpy(clip.template.faces))[0]
        fixed = torch.cat([template, normals], dim=-1).expand(len(posed), -1, -1)
        near = told[:, self.nearest]
        moved = torch.cat([near[..., :3] - template, near[..., 3:]], dim=-1)
        return torch.cat([fixed, moved], dim=-1), told[:, self.points]


class GraphNetwork(PointNet):
    """Each vertex with its neighbours, layer by layer, and with a code of the body."""

    name: ClassVar[str] = "gcn"
    Config = GraphNetworkConfig

    def _made(self) -> VertexNetwork:
        config = self._settings()
        assert isinstance(config, GraphNetworkConfig)
        laplacian = graph_laplacian(self.faces, len(self.nearest))
        return VertexNetwork(config.features, config.blocks, laplacian)


def _offsets(clip: Clip) -> Tensor:
    """The garment of all frames from its template, (T, N, 3) float32, metres, canonical frame."""
    assert clip.garment is not None  # same_garment saw to it
    canonical = root_frames(clip, "root").to_canonical(clip.garment.vertices)
    return torch.from_numpy(canonical - clip.template.vertices.astype(np.float32))
