"""The VTO data set (Santesteban et al. 2019, 2021): ARCSim garments on SMPL bodies, a pickle a clip.

Facts from the README of github.com/isantesteban/vto-dataset:
`<garment>/simulations/<garment>_shape<NN>_<sequence>.pkl` with `shapes` (T, 10), `poses` (T, 75), `vertices`
(T, N, 3), `faces` (F, 3), `sequence`, `subject`, `conf`. Code of its authors and users (`src/io.py` of
github.com/isantesteban/vto-garment-collisions, HOOD's converter) reads `shape`, `pose` (T, 72) and `translation` (T, 3)
in their place: both are read here. The order of the 75 numbers is documented nowhere; the one is taken by which the
body is inside the garment. The authors' code works at 30 frames a second, y up, on the female model
(`basicModel_f_lbs_10_207_0_v1.0.0.pkl`); its `assets/meshes` have the garments' rest shapes. The split is that of
section 4.1 of the image transfer paper, which follows VirtualBones.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fusion import BodySdf
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Skeleton, Template
from imgtransfer.data.schema import valid_clip_name
from imgtransfer.importers.checks.worn import check_worn
from imgtransfer.importers.files import as_array, check_shape
from imgtransfer.importers.job import ImportOptions, Job
from imgtransfer.importers.pickles.reading import load_pickle
from imgtransfer.importers.smpl import SmplModel, find_smpl, smpl_body
from render import InputError, Mesh, Option, load_mesh
from render.files.naming import natural_sort

TEST = ("01_01", "111_02", "55_27", "91_36")
FPS = 30.0
_SOURCE = "VTO data set, Santesteban et al. 2019, github.com/isantesteban/vto-dataset"
_TEMPLATES = "https://github.com/isantesteban/vto-garment-collisions"


def jobs(paths: list[Path], options: ImportOptions) -> list[Job]:
    """One job a .pkl file of `paths`, which are files or folders of them (folders in folders too).

    Raises:
        InputError: no .pkl file, no template or no SMPL model.
    """
    files = [file for path in paths for file in (_pickles(path) if path.is_dir() else [path])]
    model = cache(lambda: smpl_body(find_smpl(options.smpl, options.gender or "female", needed_by="vto")))
    template = cache(lambda garment: load_mesh(_template_file(options.template, garment)))
    import_jobs = []
    for file in files:
        garment, _, clip = file.stem.partition("_")
        sequence = "_".join(clip.split("_")[-2:])
        template(garment)
        split = options.split or ("test" if sequence in TEST else "train")

        def read(file: Path = file, garment: str = garment, sequence: str = sequence) -> Clip:
            return _clip(file, template(garment), model(), sequence, options)

        import_jobs.append(
            Job(valid_clip_name(options.garment or garment, clip or garment), split, (file,), read)
        )
    model()
    return import_jobs


def _pickles(folder: Path) -> list[Path]:
    files = natural_sort(folder.rglob("*.pkl"))
    if not files:
        raise InputError(f"{folder}: no .pkl files in it; the simulations of the VTO data set are wanted")
    return files


def _template_file(given: Path | None, garment: str) -> Path:
    if given is None:
        raise InputError(
            f"vto: the data set has no rest shapes; give the garment's rest shape by {Option('template')}: "
            f"assets/meshes/tshirt.obj or dress.obj (or that folder) of {_TEMPLATES}"
        )
    return given / f"{garment}.obj" if given.is_dir() else given


def _clip(path: Path, template: Mesh, model: SmplModel, sequence: str, options: ImportOptions) -> Clip:
    betas, numbers, vertices, faces = _arrays(path, load_pickle(path), sequence)
    if len(template.vertices) != vertices.shape[1]:
        raise InputError(
            f"{path}: {vertices.shape[1]} vertices, but the template {template.source} has {len(template.vertices)}; "
            "it is another garment or another version"
        )
    if not np.array_equal(_sorted(template.faces), _sorted(faces)):
        raise InputError(f"{path}: other triangles than {template.source}, whose vertex order it must have")
    poses, trans = _pose_and_place(model, betas, numbers, vertices)
    clip = Clip(
        template=Template(vertices=template.vertices.astype(np.float32), faces=faces),
        garment=Garment(vertices),
        body=Body(
            rest=model.rest(betas).astype(np.float32),
            faces=model.faces,
            vertices=model.posed(betas, poses, trans),
        ),
        fps=options.fps or FPS,
        skeleton=Skeleton(
            poses=poses.reshape(len(poses), -1, 3),
            trans=trans,
            joints_rest=model.joints(betas).astype(np.float32),
            parents=model.parents,
            blend_weights=model.weights.astype(np.float32),
        ),
        info={"source": _SOURCE, "units": "m"},
        name=path.stem,
    ).with_surface(template.surface)
    check_worn(
        clip, str(path), hint=f"is it the right {Option('gender')} of SMPL, the right {Option('template')}?"
    )
    return clip


def _pose_and_place(
    model: SmplModel, betas: np.ndarray, numbers: np.ndarray, vertices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (T, 72) and translations (T, 3) among the 75 numbers: of both orders the one that wears the garment."""
    frames = np.unique([0, len(numbers) // 2, len(numbers) - 1])
    orders = [(numbers[:, :72], numbers[:, 72:]), (numbers[:, 3:], numbers[:, :3])]
    sdf = BodySdf(model.faces, len(model.template))

    def misfit(order: tuple[np.ndarray, np.ndarray]) -> float:
        sdf.update(model.posed(betas, order[0][frames], order[1][frames]))
        distance = sdf.distance(torch.from_numpy(vertices[frames]))
        return float(distance.abs().mean() + (distance < -0.001).double().mean())

    return orders[0] if misfit(orders[0]) <= misfit(orders[1]) else orders[1]


def _arrays(path: Path, stored: Any, sequence: str) -> tuple[np.ndarray, ...]:
    """Shape (10,), poses and translations (T, 75), vertices (T, N, 3) and faces (F, 3) of one file."""
    if not isinstance(stored, dict):
        raise InputError(
            f"{path}: a dict is wanted, with shapes, poses, vertices and faces; found {type(stored).__name__}"
        )
    stored = {**stored}
    if "poses" not in stored and {"pose", "translation"} <= set(stored):
        joined = [as_array(str(path), key, stored[key]) for key in ("pose", "translation")]
        if any(part.ndim != 2 for part in joined) or len(joined[0]) != len(joined[1]):
            raise InputError(
                f"{path}: pose {joined[0].shape} and translation {joined[1].shape} do not fit each other"
            )
        stored["poses"] = np.concatenate(joined, axis=1)
    stored.setdefault("shapes", stored.get("shape"))
    missing = [key for key in ("shapes", "poses", "vertices", "faces") if stored.get(key) is None]
    if missing:
        has = ", ".join(str(key) for key in stored if stored[key] is not None) or "nothing"
        raise InputError(
            f"{path}: not a file of the VTO data set, it lacks {', '.join(missing)}; it has {has}"
        )
    said = str(stored.get("sequence", sequence))
    if re.fullmatch(r"\d+_\d+", said) and re.fullmatch(r"\d+_\d+", sequence) and said != sequence:
        raise InputError(f"{path}: mislabelled, the file says that it is sequence {said}; rename it")
    vertices = check_shape(str(path), "vertices", stored["vertices"], (None, None, 3))
    frames = len(vertices)
    poses = check_shape(str(path), "poses", stored["poses"], (frames, 75)).astype(np.float32)
    shapes = check_shape(
        str(path), "shapes", np.atleast_2d(as_array(str(path), "shapes", stored["shapes"])), (None, 10)
    ).astype(np.float64)
    if len(shapes) not in (1, frames) or np.ptp(shapes, axis=0).max() > 1e-3:
        raise InputError(f"{path}: shapes {shapes.shape} must be the same shape in each of {frames} frames")
    faces = check_shape(str(path), "faces", stored["faces"], (None, 3)).astype(np.int64)
    return shapes[0], poses, vertices.astype(np.float32), faces


def _sorted(faces: np.ndarray) -> np.ndarray:
    """Triangles that differ only in where they begin, or in their order, become equal."""
    turned = np.stack([np.roll(face, -int(face.argmin())) for face in faces])
    return turned[np.lexsort(turned.T)]
