"""A T-shirt made from a body's rest mesh: a smoothed offset surface, cut at neck, sleeves and hem."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.sparse import coo_matrix

from fusion import BodySdf
from imgtransfer.bodies.anny import AnnyBody
from imgtransfer.bodies.smpl import INDEX
from imgtransfer.garments.cutting import border_edges, border_loops, cut_at_zero, largest_component
from render import InputError
from render.mesh import Mesh

CELL = 0.01  # metres, of the distance grid
NECK_RADIUS = 0.092  # metres; the neck cut reaches no farther from the neck's axis
SLEEVE_RADIUS = 0.115  # metres, from the upper arm's axis
RELAXATIONS = 8
Cut = Callable[[np.ndarray], np.ndarray]  # (N, 3) points -> (N,), positive where cloth is removed


class TShirtConfig(BaseModel):
    """Shape of the T-shirt; lengths in metres."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    edge_length: float = Field(0.0192, gt=0.005, lt=0.1)  # about 2,000 vertices on the Anny body
    ease: float = Field(0.022, gt=0.005, lt=0.1)  # distance to the (smoothed) body
    flare: float = Field(0.04, ge=0.0, lt=0.5)  # ease gained per metre below the armpit
    smoothing: float = Field(0.025, gt=0.0, lt=0.1)  # how far hollows of the body are bridged
    sleeve: float = Field(0.55, gt=0.2, lt=0.9)  # share of the upper arm that is covered
    hem: float = Field(0.05, gt=-0.3, lt=0.06)  # below the hip joints; farther down the legs would part it


def make_tshirt(body: AnnyBody, config: TShirtConfig | None = None) -> Mesh:
    """The T-shirt around the body's rest pose: one component, manifold, four border loops, outside the body.

    Returns:
        A mesh in the body's rest frame, metres, counter-clockwise from outside.

    Raises:
        InputError: the sizes leave no surface that is one piece with four openings.
    """
    import gpytoolbox  # noqa: PLC0415 (needs the extra `simulate`)

    config = config or TShirtConfig()
    field = _Field(body, config)
    vertices, faces = field.surface()
    vertices, faces = gpytoolbox.remesh_botsch(vertices, faces.astype(np.int32), 10, config.edge_length, True)
    mesh = Mesh(vertices, faces, "T-shirt")
    for cut in _cuts(body.joints_rest, config):
        mesh = largest_component(cut_at_zero(mesh, cut(mesh.vertices)))
    mesh = Mesh(_relaxed(mesh, field), mesh.faces, "T-shirt")
    openings = len(border_loops(mesh.faces))
    if openings != 4 or len(mesh.vertices) - len(mesh.edges) + len(mesh.faces) != -2:
        raise InputError(
            f"T-shirt: sizes {config.model_dump()} give a surface with {openings} openings, where neck, hem and two "
            "sleeves are wanted; use a smaller edge_length, or a sleeve and hem nearer to the defaults"
        )
    return mesh


class _Field:
    """Negative within the garment's surface: distance to the smoothed body less the ease, on a grid."""

    def __init__(self, body: AnnyBody, config: TShirtConfig) -> None:
        joints = body.joints_rest
        reach = np.abs(joints[INDEX["left_elbow"], 0]) + 0.05
        self.low = np.array(
            [-reach, joints[INDEX["left_hip"], 1] - config.hem - 0.08, body.rest[:, 2].min() - 0.1]
        )
        high = np.array([reach, joints[INDEX["head"], 1], joints[INDEX["spine1"], 2] + 0.30])
        axes = [np.arange(a, b, CELL) for a, b in zip(self.low, high, strict=True)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        sdf = BodySdf(body.faces, len(body.rest), sign="normal")
        sdf.update(body.rest)
        distance = sdf.distance(torch.from_numpy(grid.reshape(-1, 3))).numpy().reshape(grid.shape[:3])
        below = np.clip(joints[INDEX["left_shoulder"], 1] - 0.1 - grid[..., 1], 0, None)
        smooth = gaussian_filter(distance, config.smoothing / CELL)
        # Smoothing may cut through the body where it bulges: never nearer than half the ease.
        self.values = np.minimum(smooth - config.ease - config.flare * below, distance - config.ease / 2)

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """The zero level: vertices (N, 3), faces (F, 3); open where the grid ends."""
        from skimage.measure import marching_cubes  # noqa: PLC0415

        vertices, faces, _, _ = marching_cubes(self.values, 0.0, spacing=(CELL,) * 3)
        whole = largest_component(Mesh(vertices + self.low, faces.astype(np.int64)))
        return whole.vertices, whole.faces

    def project(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) points moved onto the zero level along the gradient."""
        at = ((points - self.low) / CELL).T
        value = map_coordinates(self.values, at, order=1, mode="nearest")
        slope = np.stack(
            [
                map_coordinates(self.values, at + step[:, None], order=1, mode="nearest")
                - map_coordinates(self.values, at - step[:, None], order=1, mode="nearest")
                for step in np.eye(3)
            ],
            axis=-1,
        ) / (2 * CELL)
        return points - (value / np.maximum((slope**2).sum(-1), 0.1))[:, None] * slope


def _cuts(joints: np.ndarray, config: TShirtConfig) -> list[Cut]:
    """Fields that are positive where cloth is removed: hem, neck, sleeves."""
    hem = joints[INDEX["left_hip"], 1] - config.hem
    neck = joints[INDEX["neck"]]
    tilt = np.array([0.0, 0.93, 0.37])  # the neckline is lower in front

    def neck_cut(points: np.ndarray) -> np.ndarray:
        offset = points - (neck + np.array([0.0, -0.035, 0.0]))
        return np.minimum(offset @ tilt, NECK_RADIUS - np.hypot(offset[:, 0], offset[:, 2]))

    def sleeve_cut(side: str) -> Cut:
        shoulder, elbow = joints[INDEX[f"{side}_shoulder"]], joints[INDEX[f"{side}_elbow"]]
        along = (elbow - shoulder) / np.linalg.norm(elbow - shoulder)

        def cut(points: np.ndarray) -> np.ndarray:
            offset = points - shoulder
            height = offset @ along
            radius = np.linalg.norm(offset - height[:, None] * along, axis=1)
            return np.minimum(
                height - config.sleeve * np.linalg.norm(elbow - shoulder), SLEEVE_RADIUS - radius
            )

        return cut

    return [neck_cut, sleeve_cut("left"), sleeve_cut("right"), lambda points: hem - points[:, 1]]


def _relaxed(mesh: Mesh, field: _Field) -> np.ndarray:
    """Vertices evened out: the inner ones over the surface, those of a border along it."""
    n = len(mesh.vertices)
    border = border_edges(mesh.faces)
    on_border = np.zeros(n, bool)
    on_border[border] = True
    inner = mesh.edges[~on_border[mesh.edges].all(axis=1)]
    pairs = np.concatenate([inner, inner[:, ::-1]])
    pairs = np.concatenate([pairs[~on_border[pairs[:, 0]]], border, border[:, ::-1]])
    mean = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(n, n)).tocsr()
    mean = mean.multiply(1 / np.maximum(mean.sum(axis=1), 1)).tocsr()
    vertices = mesh.vertices
    for _ in range(RELAXATIONS):
        vertices = field.project(vertices + 0.5 * (mean @ vertices - vertices))
    return vertices
