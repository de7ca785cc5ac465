"""Small stand-ins for what importers read: a SMPL-like model, a standing body, and files in each format."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import torch

from imgtransfer.bodies import anny
from imgtransfer.importers.smpl import SmplModel
from render import Mesh, vertex_normals
from render.mesh.surface import Surface
from tests.helpers import synthetic

CHAIN = np.arange(-1, 23)  # parents of 24 joints, one above the other


def tube_model(*, offset: float = 0.0) -> dict[str, np.ndarray]:
    """The arrays of a SMPL-like model: a closed tube, 1 m high, of 24 joints; `offset` lifts it, as SMPL is lifted."""
    rng = np.random.default_rng(0)
    body, faces = synthetic.tube(0.12, 1.0, 13, 10, closed=True)
    body = body.astype(np.float64) + np.array([0, offset, 0])
    heights = np.linspace(0.05, 0.95, 24) + offset
    distance = np.abs(body[:, 1:2] - heights)
    weights = np.exp(-((distance / 0.06) ** 2))
    weights /= weights.sum(1, keepdims=True)
    regressor = np.zeros((24, len(body)))
    for joint, height in enumerate(heights):  # between the two nearest rings, so that joints lie on the axis
        rings = np.unique(body[:-2, 1])
        above = np.clip(np.searchsorted(rings, height), 1, len(rings) - 1)
        share = (height - rings[above - 1]) / (rings[above] - rings[above - 1])
        for ring, part in ((rings[above - 1], 1 - share), (rings[above], share)):
            members = np.flatnonzero(np.isclose(body[:-2, 1], ring))
            regressor[joint, members] += part / len(members)
    table = np.stack([CHAIN, np.arange(24)]).astype(np.int64)
    table[0, 0] = 2**32 - 1
    return {
        "v_template": body,
        "f": faces.astype(np.uint32),
        "shapedirs": rng.normal(size=(len(body), 3, 10)) * 0.001,
        "posedirs": rng.normal(size=(len(body), 3, 207)) * 0.0001,
        "J_regressor": regressor,
        "weights": weights,
        "kintree_table": table,
    }


def write_model(path: Path, *, offset: float = 0.0) -> Path:
    """The model as an npz."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **tube_model(offset=offset))
    return path


def motion(frames: int, *, seed: int = 0) -> np.ndarray:
    """(T, 72) small bends of every joint of the tube, and a turn of the root."""
    rng = np.random.default_rng(seed)
    poses = rng.normal(size=(1, 72)) * 0.02 * np.linspace(0, 1, frames)[:, None]
    poses[:, 1] += np.linspace(0, 0.8, frames)
    return poses


def worn(model: SmplModel, betas: np.ndarray, poses: np.ndarray) -> tuple[Mesh, np.ndarray]:
    """A tube of cloth round the model's middle: rest mesh, and (T, N, 3) moved rigidly with joint 12, without trans."""
    cloth, faces = synthetic.tube(0.17, 0.4, 7, 12, closed=False)
    rest = Mesh(cloth + model.joints(betas)[0] + [0, 0.25, 0], faces, source="cloth")
    bones = model.transforms(betas, poses)[:, 12]
    return rest, np.einsum("tab,nb->tna", bones[..., :3], rest.vertices) + bones[:, None, :, 3]


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """A plain OBJ."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in vertices]
    path.write_text("".join(lines + [f"f {a} {b} {c}\n" for a, b, c in faces + 1]))
    return path


def write_pc2(path: Path, vertices: np.ndarray, *, half: bool = False) -> Path:
    """A PC2 or PC16 cache of (T, N, 3)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, vertices.shape[1], 0.0, 1.0, len(vertices))
    path.write_bytes(head + vertices.astype("<f2" if half else "<f4").tobytes())
    return path


def write_mdd(path: Path, vertices: np.ndarray, fps: float) -> Path:
    """An MDD cache of (T, N, 3)."""
    head = struct.pack(">ii", *vertices.shape[:2]) + (np.arange(len(vertices)) / fps).astype(">f4").tobytes()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(head + vertices.astype(">f4").tobytes())
    return path


def standing_body() -> Mesh:
    """The project's own body in its rest pose: y up, facing +z."""
    with np.load(Path(anny.__file__).with_name("anny_body.npz"), allow_pickle=False) as stored:
        return Mesh(stored["rest"], stored["faces"].astype(np.int64), source="body.obj")


def vest(body: Mesh, *, gap: float = 0.015) -> Mesh:
    """A garment cut from the body's trunk and lifted off it by `gap` metres."""
    low, high = body.vertices[:, 1].min(), body.vertices[:, 1].max()
    share = (body.vertices[:, 1] - low) / (high - low)
    inside = (share > 0.56) & (share < 0.76) & (np.abs(body.vertices[:, 0]) < 0.16)
    faces = body.faces[inside[body.faces].all(1)]
    used = np.unique(faces)
    normals = vertex_normals(torch.from_numpy(body.vertices), torch.from_numpy(body.faces)).numpy()
    number = np.full(len(body.vertices), -1)
    number[used] = np.arange(len(used))
    return Mesh((body.vertices + gap * normals)[used], number[faces], source="vest.obj")


def split(mesh: Mesh) -> Mesh:
    """The garment as a modelling program writes it: two materials, cut apart where they meet, each with its own UVs."""
    right = mesh.vertices[mesh.faces, 0].mean(1) < 0
    corner = mesh.faces + np.where(right, len(mesh.vertices), 0)[:, None]
    used, faces = np.unique(corner, return_inverse=True)
    faces = faces.reshape(-1, 3)
    vertices = mesh.vertices[used % len(mesh.vertices)]
    uvs = (vertices[:, :2] + np.where(used >= len(mesh.vertices), 0.5, 0.0)[:, None]).astype(np.float32)
    materials = "newmtl front\nKd 0.8 0.1 0.1\nnewmtl side panel\nKd 0.1 0.1 0.8\nd 0.5\n"
    surface = Surface(
        faces,
        np.arange(len(vertices)),
        uvs=uvs,
        uv_faces=faces,
        face_materials=right.astype(np.int64),
        materials=("front", "side panel"),
        mtl=materials,
    )
    order = np.argsort(right, kind="stable")  # an OBJ has its materials one after the other
    surface = Surface(
        faces[order], surface.vertices, uvs=uvs, uv_faces=faces[order],
        face_materials=right[order].astype(np.int64), materials=surface.materials, mtl=materials,
    )  # fmt: skip
    return Mesh(vertices, faces[order], source="split.obj", surface=surface)
