"""CLOTH3D (Bertiche et al. 2020): a folder a sample, with its outfit's garments and one motion.

Facts from https://chalearnlap.cvc.uab.cat/dataset/38/description/, the starter kit's `DataReader/read.py` as
public repositories carry it, and `IO.py`, `values.py` and `Preprocessing/rest.py` of
github.com/hbertiche/DeePSD by the same author. A sample holds `info.mat` (`poses` (72, T), `shape` (10,),
`trans` (3, T), `gender` 0 female or 1 male, `zrot` radians) and for each garment `<Garment>.obj` (rest shape,
quads) and `<Garment>.pc16` (T frames relative to the root joint, 16-bit floats, so half a millimetre coarse a
metre from the root). z up; the root joint lies at `trans`; all is turned by `zrot` about z at the end. The rest
pose has the legs 0.15 radians apart. Rest shapes of the released files are turned by `zrot` already, as
`rest.py` says; the reader here takes whichever of the two fits the motion. 30 frames a second. The data set's own
split names samples; it is not known here.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Skeleton, Template
from imgtransfer.data.schema import valid_clip_name
from imgtransfer.importers.checks.worn import check_worn
from imgtransfer.importers.files import check_shape
from imgtransfer.importers.job import ImportOptions, Job
from imgtransfer.importers.smpl import SmplModel, find_smpl, smpl_body
from render import InputError, Option, load_mesh
from render.files.data_file import check_data_file
from render.files.naming import natural_sort
from render.files.point_caches import open_cache

FPS = 30.0
_SOURCE = "CLOTH3D, Bertiche et al. 2020, chalearnlap.cvc.uab.cat/dataset/38"
_UP = Rotation.from_euler("x", -90, degrees=True).as_matrix()  # z up to y up
_KEYS = ("poses", "shape", "trans", "gender", "zrot")
_LEGS_APART = 0.15  # radians, of each hip in the rest pose


def jobs(paths: list[Path], options: ImportOptions) -> list[Job]:
    """One job a garment of each sample below `paths`: samples' folders, or folders of them.

    Garments differ in their mesh from sample to sample, so each is a garment of its own, `<Garment>_<sample>`.

    Raises:
        InputError: no sample, or one without garments.
    """
    model = cache(lambda gender: smpl_body(find_smpl(options.smpl, gender, needed_by="cloth3d")))
    model(options.gender or "female")  # before any work
    import_jobs = []
    for path in paths:
        samples = (
            [path]
            if (path / "info.mat").is_file()
            else natural_sort(p.parent for p in path.glob("*/info.mat"))
        )
        if not samples:
            raise InputError(
                f"{path}: no sample of CLOTH3D in it; one has info.mat, <Garment>.obj and <Garment>.pc16"
            )
        for sample in samples:
            caches = natural_sort(sample.glob("*.pc16"))
            if not caches:
                raise InputError(f"{sample}: no .pc16 point caches beside info.mat")
            for file in caches:

                def read(file: Path = file) -> Clip:
                    return _clip(file, model, options)

                place = sample.resolve().name
                name = valid_clip_name(options.garment or f"{file.stem}_{place}", place)
                import_jobs.append(Job(name, options.split or "train", (file, sample / "info.mat"), read))
    return import_jobs


def _clip(path: Path, model_of: Any, options: ImportOptions) -> Clip:
    info = _Info(path.with_name("info.mat"))
    model: SmplModel = model_of(options.gender or info.gender)
    template = load_mesh(path.with_suffix(".obj"))
    moved = open_cache(path).vertices()
    if moved.shape[1] != len(template.vertices):
        raise InputError(
            f"{path}: {moved.shape[1]} points a frame, but {path.stem}.obj has {len(template.vertices)} vertices"
        )
    if len(moved) != len(info.poses):
        raise InputError(f"{path}: {len(moved)} frames, but info.mat has {len(info.poses)} poses")
    root = model.joints(info.betas)[0]
    turn = _UP @ Rotation.from_rotvec([0, 0, info.zrot]).as_matrix()
    poses = info.poses.astype(np.float64)
    poses[:, :3] = (Rotation.from_matrix(turn) * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    places = info.trans @ turn.T  # of the root joint
    rest_pose = np.zeros((1, 72))
    rest_pose[0, 5], rest_pose[0, 8] = _LEGS_APART, -_LEGS_APART
    body_rest = model.posed(info.betas, rest_pose, np.zeros((1, 3)))[0]
    seen = np.einsum("tba,tnb->tna", Rotation.from_rotvec(poses[:, :3]).as_matrix(), moved @ turn.T)
    clip = Clip(
        template=Template(
            vertices=(_rest(template.vertices, info.zrot, seen) + root).astype(np.float32),
            faces=template.faces,
        ),
        garment=Garment((moved @ turn.T + places[:, None]).astype(np.float32)),
        body=Body(rest=body_rest, faces=model.faces, vertices=model.posed(info.betas, poses, places - root)),
        fps=options.fps or FPS,
        skeleton=Skeleton(
            poses=poses.reshape(len(poses), -1, 3).astype(np.float32),
            trans=(places - root).astype(np.float32),
            joints_rest=root[None].astype(np.float32),
            parents=np.array([-1]),
        ),
        info={"source": _SOURCE, "units": "m", "note": "garment positions were stored as 16-bit floats"},
        name=path.stem,
    ).with_surface(template.surface)
    check_worn(clip, str(path), hint=f"is it the right {Option('smpl')}?")
    return clip


def _rest(vertices: np.ndarray, zrot: float, in_root_frame: np.ndarray) -> np.ndarray:
    """The rest shape (N, 3) seen from the root joint, y up: turned back by `zrot` or not.

    Of the two the one is taken that lies nearer to where the same vertices are in motion, (T, N, 3) in the root
    joint's frame.
    """
    back = Rotation.from_rotvec([0, 0, -zrot]).as_matrix()
    places = [vertices @ (_UP @ turn).T for turn in (back, np.eye(3))]
    middle = in_root_frame.mean(axis=0)
    return min(places, key=lambda place: float(np.linalg.norm(place - middle, axis=-1).mean()))


class _Info:
    """info.mat: poses (T, 72), trans (T, 3), betas (10,), gender and zrot."""

    def __init__(self, path: Path) -> None:
        check_data_file(path, "info.mat of a CLOTH3D sample")
        try:
            stored = loadmat(path, squeeze_me=True, variable_names=_KEYS)
        except Exception as error:  # the reader raises whatever it meets in a damaged file
            raise InputError(f"{path}: not a readable MAT file of version 5 ({error})") from error
        missing = [key for key in _KEYS if key not in stored]
        if missing:
            raise InputError(f"{path}: not the info.mat of a CLOTH3D sample, it lacks {', '.join(missing)}")
        poses, trans = (np.asarray(stored[key]) for key in ("poses", "trans"))
        # A single frame comes without its axis.
        poses, trans = (values[:, None] if values.ndim == 1 else values for values in (poses, trans))
        self.poses = check_shape(str(path), "poses", poses, (72, None)).T
        self.trans = check_shape(str(path), "trans", trans, (3, len(self.poses))).T
        self.betas = check_shape(str(path), "shape", stored["shape"], (10,)).astype(np.float64)
        self.zrot = float(check_shape(str(path), "zrot", stored["zrot"], ()))
        gender = float(check_shape(str(path), "gender", stored["gender"], ()))
        if gender not in (0, 1):
            raise InputError(f"{path}: gender is {gender:g}; 0 (female) or 1 (male) is wanted")
        self.gender = "male" if gender else "female"
