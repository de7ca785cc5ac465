"""How meshes of glTF files are shaped and placed: nodes, morph targets and skins (glTF 2.0 specification, 3.5 and 3.7).

Everything stands as the file's nodes say: animations are not read.
"""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np

from render.files.gltf_accessors import Accessors


def world_transforms(nodes: list[dict[str, Any]]) -> list[np.ndarray]:
    """(4, 4) of every node, whatever scene it is of.

    Args:
        nodes: of a header; none hangs from two others or from itself.
    """
    below = {int(child) for node in nodes for child in node.get("children", [])}
    placed = [np.eye(4)] * len(nodes)
    waiting = [(number, np.eye(4)) for number in range(len(nodes)) if number not in below]
    while waiting:
        number, above = waiting.pop()
        placed[number] = above @ _transform(nodes[number])
        waiting += [(int(child), placed[number]) for child in nodes[number].get("children", [])]
    return placed


def nodes_of_scene(header: dict[str, Any], scene: int) -> set[int]:
    """The numbers of all nodes of a scene."""
    nodes = header.get("nodes", [])
    reached: set[int] = set()
    waiting = [int(root) for root in header["scenes"][scene].get("nodes", [])]
    while waiting:
        number = waiting.pop()
        reached.add(number)
        waiting += [int(child) for child in nodes[number].get("children", [])]
    return reached


def morphed(accessors: Accessors, primitive: dict[str, Any], weights: list[float]) -> np.ndarray:
    """(N, 3) float64 vertices of a primitive, moved by its morph targets.

    Args:
        weights: of the targets, from the node or the mesh.

    Raises:
        InputError: as `Accessors.table`.
    """
    vertices = accessors.values(primitive["attributes"]["POSITION"], "VEC3")
    for weight, target in zip(weights, primitive.get("targets", []), strict=False):
        if weight and "POSITION" in target:
            vertices += float(weight) * accessors.values(target["POSITION"], "VEC3")
    return vertices


def joint_transforms(accessors: Accessors, skin: dict[str, Any], placed: list[np.ndarray]) -> np.ndarray:
    """(J, 4, 4) from the mesh at bind to the world, of the joints of a skin.

    Args:
        placed: world transforms of all nodes.

    Raises:
        InputError: as `Accessors.table`.
    """
    joints = np.stack([placed[int(joint)] for joint in skin["joints"]])
    if "inverseBindMatrices" not in skin:
        return joints
    stored = accessors.values(skin["inverseBindMatrices"], "MAT4")
    by_columns = stored.reshape(-1, 4, 4)[np.arange(len(joints))]
    return np.asarray(joints @ by_columns.transpose(0, 2, 1))


def skinned(
    accessors: Accessors, attributes: dict[str, int], vertices: np.ndarray, transforms: np.ndarray
) -> np.ndarray:
    """Linear blend skinning, (N, 3) -> (N, 3) world; the mesh's own node does not count.

    Args:
        attributes: of the primitive, with JOINTS_0 and WEIGHTS_0 and as many more as it has.
        vertices: at bind. transforms: (J, 4, 4) as of `joint_transforms`.

    Raises:
        InputError: as `Accessors.table`.
    """
    blended = np.zeros((len(vertices), 3, 4))
    total = np.zeros(len(vertices))
    first = accessors.whole_numbers(attributes["JOINTS_0"], "VEC4", below=len(transforms))[:, 0]
    for number in count():
        if f"JOINTS_{number}" not in attributes:
            break
        joints = accessors.whole_numbers(attributes[f"JOINTS_{number}"], "VEC4", below=len(transforms))
        weights = accessors.values(attributes[f"WEIGHTS_{number}"], "VEC4")
        for joint, weight in zip(joints.T, weights.T, strict=True):
            blended += weight[:, None, None] * transforms[joint, :3]
            total += weight
    free = total <= 0  # of no joint: of its first, as viewers have it
    blended[free], total[free] = transforms[first[free], :3], 1
    blended /= total[:, None, None]
    return np.asarray(np.einsum("nij,nj->ni", blended[:, :, :3], vertices) + blended[:, :, 3])


def _transform(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T  # stored by columns
    x, y, z, w = (float(value) for value in node.get("rotation", (0, 0, 0, 1)))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    placed = np.eye(4)
    placed[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), np.float64)
    placed[:3, 3] = node.get("translation", (0, 0, 0))
    return placed
