"""Small files in the formats of public data sets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from scipy.spatial.transform import Rotation

from imgtransfer.importers.smpl import SmplModel
from render import Mesh
from tests.helpers.import_examples import motion, worn, write_obj, write_pc2

FRAMES = 5

BETAS = np.linspace(-1, 1, 10)

TRANS = np.linspace([0.1, 0.2, -0.3], [1.0, 0.1, 0.5], FRAMES)

UP = Rotation.from_euler("x", -90, degrees=True)  # z up to y up


def vto_content(model: SmplModel, poses: np.ndarray) -> dict[str, Any]:
    rest, moved = worn(model, BETAS, poses)
    return {
        "shapes": np.repeat(BETAS[None], len(poses), axis=0),
        "poses": np.concatenate([poses, TRANS[: len(poses)]], axis=1),
        "vertices": (moved + TRANS[: len(poses), None]).astype(np.float32),
        "faces": rest.faces,
        "sequence": "01_01",
        "subject": "shape00",
        "conf": {"friction": 0.2},
    }


ZROT = 0.7


def write_cloth3d(folder: Path, model: SmplModel, *, rest_turned: bool) -> tuple[np.ndarray, Mesh]:
    """A sample: world positions in our axes (T, N, 3) and the rest mesh on the body; z up in the files."""
    folder.mkdir(parents=True)
    ours = motion(FRAMES)
    rest, moved = worn(model, BETAS, ours)
    root = model.joints(BETAS)[0]
    places = np.asarray(TRANS) + root  # of the root joint, our axes
    turn = Rotation.from_rotvec([0, 0, ZROT])
    back = (UP * turn).inv()  # from our axes to the file's
    poses = ours.copy()
    poses[:, :3] = (back * Rotation.from_rotvec(ours[:, :3])).as_rotvec()
    local = np.stack([back.apply(frame - root) for frame in moved])
    info = {"poses": poses.T, "shape": BETAS, "trans": back.apply(places).T, "gender": 0, "zrot": ZROT}
    scipy.io.savemat(folder / "info.mat", info)
    write_pc2(folder / "Tshirt.pc16", local, half=True)
    shape = UP.inv().apply(rest.vertices - root)
    write_obj(folder / "Tshirt.obj", turn.apply(shape) if rest_turned else shape, rest.faces)
    return moved + TRANS[:, None], rest


ROOT = np.array([0.0, -0.021519510746002397, 0.904766845703125])


def write_virtualbones(
    folder: Path, model: SmplModel, *, world: bool, from_y_up: bool, unit: float
) -> np.ndarray:
    """A garment's folder; returns the garment's world positions in our axes, metres."""
    ours = motion(FRAMES)
    ours[:, 66:] = 0  # SMPL's hands, which the format has otherwise
    betas = np.zeros(10)
    root = model.joints(betas)[0]
    rest, moved = worn(model, betas, ours)
    trans = UP.inv().apply(TRANS)  # the file's, z up, metres
    shift = TRANS + UP.apply(ROOT) - root  # what puts the root joint at its place
    placed = moved + shift[:, None]
    write_obj(
        folder / "template.obj", (UP.inv().apply(rest.vertices - root) + ROOT) * 10, rest.faces
    )  # decimetres
    rotation = Rotation.from_rotvec(ours[:, :3])
    pose = np.zeros((FRAMES, 52, 3))
    pose[:, 1:22] = ours.reshape(FRAMES, 24, 3)[:, 1:22]
    if not from_y_up:
        pose[:, 1:22] = UP.inv().apply(pose[:, 1:22].reshape(-1, 3)).reshape(FRAMES, 21, 3)
    pose[:, 0] = (UP.inv() * rotation * (Rotation.identity() if from_y_up else UP)).as_rotvec()
    if world:
        stored = np.stack([UP.inv().apply(frame) for frame in placed])
    else:
        local = np.stack(
            [turn.inv().apply(frame - root) for turn, frame in zip(rotation, moved, strict=True)]
        )
        stored = local if from_y_up else np.stack([UP.inv().apply(frame) for frame in local])
    np.savez(folder / "7.npz", pose=pose, trans=trans, sim_res=stored / unit)
    return placed
