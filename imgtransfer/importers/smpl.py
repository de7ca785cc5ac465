"""The SMPL body (Loper et al. 2015) from a user's own model files, in NumPy.

Written here because the garments of TailorNet are skinned with the same arithmetic, vertex by vertex, on a finer mesh.
Model files are not ours to ship. Read are npz files of plain arrays and the published pickles, by a reader that
runs nothing of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.importers.files import check_shape, load_arrays
from imgtransfer.importers.pickles.smpl_models import load_model_pickle
from render import InputError, Option
from render.mesh.mesh import check_faces

KEYS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
GENDERS = ("female", "male", "neutral")
JOINTS = 24
_NAMES = {
    "female": (
        "SMPL_FEMALE",
        "basicModel_f_lbs_10_207_0_v1.0.0",
        "basicmodel_f_lbs_10_207_0_v1.1.0",
        "model_f",
    ),
    "male": ("SMPL_MALE", "basicmodel_m_lbs_10_207_0_v1.0.0", "basicmodel_m_lbs_10_207_0_v1.1.0", "model_m"),
    "neutral": ("SMPL_NEUTRAL", "basicmodel_neutral_lbs_10_207_0_v1.1.0", "model_n"),
}
GET = "register at https://smpl.is.tue.mpg.de, download SMPL for Python (version 1.0.0 or 1.1.0), unpack it, and"


@dataclass(frozen=True, eq=False)
class SmplModel:
    """A SMPL model: metres, y up, facing +z.

    Args:
        template: (V, 3) float64. faces: (F, 3) int64.
        shapedirs: (V, 3, K), K of 10 or more are used by `betas`.
        posedirs: (V, 3, 207). regressor: (24, V). weights: (V, 24). parents: (24,) int64, -1 for the root.
    """

    template: np.ndarray
    faces: np.ndarray
    shapedirs: np.ndarray
    posedirs: np.ndarray
    regressor: np.ndarray
    weights: np.ndarray
    parents: np.ndarray

    def rest(self, betas: np.ndarray) -> np.ndarray:
        """(K,) shape -> (V, 3) float64, the body in the zero pose."""
        used = min(len(betas), self.shapedirs.shape[2])
        return self.template + self.shapedirs[:, :, :used] @ np.asarray(betas, np.float64)[:used]

    def joints(self, betas: np.ndarray) -> np.ndarray:
        """(K,) shape -> (24, 3) float64, the joints in the zero pose."""
        return self.regressor @ self.rest(betas)

    def unskinned(self, betas: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """(T, 72) poses -> (T, V, 3) float64: the rest body with the pose's corrections, not yet skinned."""
        rotations = Rotation.from_rotvec(np.asarray(poses, np.float64).reshape(-1, 3)).as_matrix()
        feature = (rotations.reshape(-1, JOINTS, 3, 3)[:, 1:] - np.eye(3)).reshape(len(poses), -1)
        corrections = feature @ self.posedirs.reshape(-1, self.posedirs.shape[2]).T
        return self.rest(betas) + corrections.reshape(len(poses), -1, 3)

    def transforms(self, betas: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """(T, 72) poses -> (T, 24, 3, 4) float64 rest-to-posed transforms of the joints, without `trans`."""
        joints = self.joints(betas)
        rotations = Rotation.from_rotvec(np.asarray(poses, np.float64).reshape(-1, 3)).as_matrix()
        turned = rotations.reshape(len(poses), JOINTS, 3, 3)
        places = np.repeat(joints[None], len(poses), axis=0)
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                turned[:, joint] = turned[:, parent] @ turned[:, joint]
                places[:, joint] = places[:, parent] + turned[:, parent] @ (joints[joint] - joints[parent])
        offset = places - np.einsum("tjab,jb->tja", turned, joints)
        return np.concatenate([turned, offset[..., None]], axis=-1)

    def posed(self, betas: np.ndarray, poses: np.ndarray, trans: np.ndarray) -> np.ndarray:
        """Pose the body.

        Args:
            betas: (K,). poses: (T, 72) axis-angle, radians. trans: (T, 3) metres, added at the end.

        Returns:
            (T, V, 3) float32.
        """
        out = np.empty((len(poses), *self.template.shape), np.float32)
        for start in range(0, len(poses), 64):  # bounds the memory of a long clip
            part = slice(start, start + 64)
            bones = self.transforms(betas, poses[part])
            body = skinned(self.unskinned(betas, poses[part]), self.weights, bones)
            out[part] = body + np.asarray(trans)[part, None]
        return out


def skinned(vertices: np.ndarray, weights: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """Linear blend skinning: (T, V, 3), (V, J) and (T, J, 3, 4) -> (T, V, 3) float64."""
    blended = np.einsum("vj,tjab->tvab", weights, transforms, optimize=True)
    return np.einsum("tvab,tvb->tva", blended[..., :3], vertices) + blended[..., 3]


def smpl_body(model_path: str | Path) -> SmplModel:
    """Read a SMPL model file, .npz or .pkl.

    Raises:
        InputError: no such file, a damaged one, or one without the arrays of SMPL.
    """
    path = Path(model_path)
    if path.suffix.lower() == ".pkl":
        stored = load_model_pickle(path)
        if not isinstance(stored, dict):
            raise InputError(f"{path}: not a SMPL model; a dict with {', '.join(KEYS)} is wanted")
    else:
        stored = load_arrays(path, KEYS)
    missing = [key for key in KEYS if stored.get(key) is None]
    if missing:
        raise InputError(f"{path}: not a SMPL model, it lacks {', '.join(missing)} as arrays")
    source = str(path)
    template = check_shape(source, "v_template", stored["v_template"], (None, 3)).astype(np.float64)
    count = len(template)
    kinship = check_shape(source, "kintree_table", stored["kintree_table"], (None, JOINTS))
    parents = kinship[0].astype(np.int64)
    parents[(parents < 0) | (parents >= JOINTS)] = -1  # the root's parent is stored as 2^32 - 1
    faces = check_shape(source, "f", stored["f"], (None, 3)).astype(np.int64)
    check_faces(faces, count, source)
    return SmplModel(
        template,
        faces,
        check_shape(source, "shapedirs", stored["shapedirs"], (count, 3, None)).astype(np.float64),
        check_shape(source, "posedirs", stored["posedirs"], (count, 3, 9 * (JOINTS - 1))).astype(np.float64),
        check_shape(source, "J_regressor", stored["J_regressor"], (JOINTS, count)).astype(np.float64),
        check_shape(source, "weights", stored["weights"], (count, JOINTS)).astype(np.float64),
        parents,
    )


def find_smpl(place: Path | None, gender: str, *, needed_by: str) -> Path:
    """The model file of a gender in the folder that the user gave (or the file itself).

    Raises:
        InputError: nothing given, or no file of a known name; the message says what to get and where to put it.
    """
    if gender not in GENDERS:
        raise InputError(f"{Option('gender')} {gender}: one of {', '.join(GENDERS)} is wanted")
    to_get = f"{GET} give the folder with its .pkl files by {Option('smpl')} FOLDER"
    if place is None:
        raise InputError(f"{needed_by}: holds SMPL motion but no bodies; {to_get}")
    if place.is_file():
        return place
    names = [f"{name}{suffix}" for name in _NAMES[gender] for suffix in (".npz", ".pkl")]
    names.append(f"smpl_{gender}.npz")
    for folder in (place, place / "smpl", place / "models", place / "smpl/models"):
        for name in names:
            if (folder / name).is_file():
                return folder / name
    raise InputError(
        f"{Option('smpl')} {place}: no SMPL model of a {gender} body in it ({names[0]}, {names[3]} ...); {to_get}"
    )
