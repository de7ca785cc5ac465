"""The VirtualBones data set (Pan et al. 2022): loose dresses on a body that is not part of it.

Facts from the README of github.com/sig22virtualbones/VirtualBonesDataset: a folder a garment with
`template.obj`, and an npz a clip with `pose` (T, 52, 3) rotation vectors, `trans` (T, 3) and `sim_res` (T, N,
3). `dress02/template.obj` itself lies z up, faces −y and is in decimetres (its neck at 14.1).
`run_motionnet.py` of github.com/non-void/VirtualBones turns its garments by `pose[0]` and moves them by `trans`
+ (0, −2.15, 90.48) cm, the place of the root joint in the rest pose.

Neither the frame and unit of `sim_res` nor the avatar are documented. Edge lengths, which cloth keeps, give the
unit. The frame (the root joint's, or the world's) and the meaning of `pose[0]` (from z up to z up, or from y up
to z up) are those by which the garment stays nearest to its template. The body is the user's SMPL in the same
pose, as the first 22 of 52 joints are SMPL's: an approximation of the avatar. No split is documented.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Skeleton, Template
from imgtransfer.data.schema import valid_clip_name
from imgtransfer.importers.checks.worn import check_worn
from imgtransfer.importers.files import check_shape, load_arrays
from imgtransfer.importers.job import ImportOptions, Job
from imgtransfer.importers.smpl import SmplModel, find_smpl, smpl_body
from render import InputError, Mesh, load_mesh
from render.files.naming import natural_sort
from render.mesh.measures import edge_lengths

FPS = 30.0
ROOT = np.array(
    [0.0, -0.021519510746002397, 0.904766845703125]
)  # metres, z up: the root joint of the rest pose
_SOURCE = "VirtualBones data set, Pan et al. 2022, github.com/sig22virtualbones/VirtualBonesDataset"
_NOTE = "the body is SMPL in the avatar's pose, not the avatar that the garment was simulated on"
_UP = Rotation.from_euler("x", -90, degrees=True)  # z up to y up
_TEMPLATE_UNITS = (1.0, 0.1, 0.01, 0.001)
_SPREAD = 0.25  # metres, how far the garment may be from its template on average in the right frame


def jobs(paths: list[Path], options: ImportOptions) -> list[Job]:
    """One job a clip of the garments' folders in `paths`, each with template.obj; or of a folder of such folders.

    Raises:
        InputError: no such folder, or one without clips.
    """
    model = cache(
        lambda: smpl_body(find_smpl(options.smpl, options.gender or "female", needed_by="virtualbones"))
    )
    import_jobs = []
    for path in paths:
        folders = (
            [path]
            if (path / "template.obj").is_file()
            else natural_sort(p.parent for p in path.glob("*/template.obj"))
        )
        if not folders:
            raise InputError(
                f"{path}: no garment of the VirtualBones data set in it; one has template.obj and N.npz"
            )
        for folder in folders:
            files = natural_sort(folder.glob("*.npz"))
            if not files:
                raise InputError(f"{folder}: no clips (.npz) beside template.obj")
            template = _template(folder / "template.obj")
            for file in files:

                def read(file: Path = file, template: Mesh = template) -> Clip:
                    return _clip(file, template, model(), options)

                name = valid_clip_name(options.garment or folder.resolve().name, file.stem)
                import_jobs.append(Job(name, options.split or "train", (file, folder / "template.obj"), read))
    model()
    return import_jobs


def _template(path: Path) -> Mesh:
    """The template seen from the root joint, metres, y up."""
    mesh = load_mesh(path)
    height = float(np.ptp(mesh.vertices[:, 2]))
    unit = next((unit for unit in _TEMPLATE_UNITS if 0.2 <= unit * height <= 2), None)
    if unit is None:
        raise InputError(f"{path}: the template is {height:.3g} high; no unit makes a garment of that")
    return Mesh(_UP.apply(mesh.vertices * unit - ROOT), mesh.faces, source=str(path), surface=mesh.surface)


def _clip(path: Path, template: Mesh, model: SmplModel, options: ImportOptions) -> Clip:
    stored = load_arrays(path, ["pose", "trans", "sim_res"])
    moved = check_shape(str(path), "sim_res", stored["sim_res"], (None, len(template.vertices), 3)).astype(
        np.float64
    )
    pose = check_shape(str(path), "pose", stored["pose"], (len(moved), 52, 3)).astype(np.float64)
    trans = check_shape(str(path), "trans", stored["trans"], (len(moved), 3)).astype(np.float64)
    moved *= _unit(path, moved, template)
    turns, local = _root_frame(path, moved, pose, trans, template)
    poses = np.zeros((len(moved), 24, 3))
    poses[:, 1:22] = (
        pose[:, 1:22] if turns.from_y_up else _UP.apply(pose[:, 1:22].reshape(-1, 3)).reshape(-1, 21, 3)
    )
    poses[:, 0] = turns.rotation.as_rotvec()
    betas = np.zeros(10)
    root = model.joints(betas)[0]
    places = _UP.apply(trans + ROOT)
    body = model.posed(betas, poses.reshape(-1, 72), places - root)
    clip = Clip(
        template=Template(vertices=(template.vertices + root).astype(np.float32), faces=template.faces),
        garment=Garment(_turned(turns.rotation, local, places)),
        body=Body(rest=model.rest(betas).astype(np.float32), faces=model.faces, vertices=body),
        fps=options.fps or FPS,
        skeleton=Skeleton(
            poses=poses.astype(np.float32),
            trans=(places - root).astype(np.float32),
            joints_rest=model.joints(betas).astype(np.float32),
            parents=model.parents,
            blend_weights=model.weights.astype(np.float32),
        ),
        info={"source": _SOURCE, "units": "m", "note": _NOTE},
        name=path.stem,
    ).with_surface(template.surface)
    check_worn(clip, str(path), hint="is it the right template.obj?")
    return clip


def _unit(path: Path, moved: np.ndarray, template: Mesh) -> float:
    """Metres a unit of the simulated vertices, a power of ten, by the lengths of the edges."""
    rest = np.median(edge_lengths(template.vertices, template.edges))
    typical = np.median(edge_lengths(moved[0], template.edges))
    ratio = float(rest / typical) if typical > 1e-9 else 0.0
    unit = 10.0 ** round(np.log10(ratio)) if ratio > 0 else 0.0
    if not 0.7 < ratio / max(unit, 1e-9) < 1.4:
        raise InputError(
            f"{path}: sim_res does not have the edges of template.obj; is it another garment's clip?"
        )
    return unit


class _Turns:
    """The root joint's rotations in our axes, under one reading of `pose[0]`."""

    def __init__(self, root: np.ndarray, from_y_up: bool) -> None:
        read = Rotation.from_rotvec(root)
        self.from_y_up = from_y_up
        self.rotation = _UP * read if from_y_up else _UP * read * _UP.inv()


def _root_frame(
    path: Path, moved: np.ndarray, pose: np.ndarray, trans: np.ndarray, template: Mesh
) -> tuple[_Turns, np.ndarray]:
    """The reading that keeps the garment nearest to its template, and its vertices (T, N, 3) in the root's frame."""
    readings: list[tuple[float, int, _Turns, np.ndarray]] = []
    ours = _UP.apply(moved.reshape(-1, 3)).reshape(moved.shape)
    for from_y_up, world in product((False, True), (True, False)):
        turns = _Turns(pose[:, 0], from_y_up)
        if world:
            away = ours - _UP.apply(trans + ROOT)[:, None]
            local = np.einsum("tba,tnb->tna", turns.rotation.as_matrix(), away)
        else:
            local = moved if from_y_up else ours
        distance = float(np.linalg.norm(local - template.vertices, axis=-1).mean())
        readings.append((distance, len(readings), turns, local))
    distance, _, turns, local = min(readings, key=lambda reading: reading[:2])
    if distance > _SPREAD:
        raise InputError(
            f"{path}: sim_res is {distance:.2f} m from its template in every reading of pose and trans; "
            "they do not belong together"
        )
    return turns, local


def _turned(rotation: Rotation, local: np.ndarray, places: np.ndarray) -> np.ndarray:
    return (np.einsum("tab,tnb->tna", rotation.as_matrix(), local) + places[:, None]).astype(np.float32)
