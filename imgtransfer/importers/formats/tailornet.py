"""The TailorNet data set (Patel et al. 2020): displacements of garments on the unposed SMPL body, per shape and
style.

Facts from the README, `visualize_dataset.py`, `smpl_torch.py` and `smpl_lib/convert_smpl_models.py` of
github.com/zycliao/TailorNet_dataset. Its root holds `garment_class_info.pkl` (for each class `f` and
`vert_indices` into the fine SMPL mesh of 27,554 vertices), `skirt_weight.npz` (`w`: skirt × fine mesh),
`smpl/smpl_hres_<gender>.npz` (made from the user's SMPL files by that converter), and folders
`<class>_<gender>` with `pose/<shape>_<style>/poses_<NNN>.npz` (`thetas` (T, 72)), `unposed_<NNN>.npy` (T, N,
3), `shape/beta_<shape>.npy` and `style_shape/beta<shape>_gamma<style>.npy`. A garment is (unskinned fine body
at its vertices + displacement), skinned with the weights of these vertices. y up, metres, no translation. The
poses are no motion in time: frames a second are nominal. Split: section 4.1 of the image transfer paper,
sequences 005 and 010 to test.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Skeleton, Template
from imgtransfer.data.schema import valid_clip_name
from imgtransfer.importers.checks.worn import check_worn
from imgtransfer.importers.files import check_shape, load_array, load_arrays
from imgtransfer.importers.job import ImportOptions, Job
from imgtransfer.importers.pickles.reading import load_pickle
from imgtransfer.importers.smpl import SmplModel, find_smpl, skinned, smpl_body
from render import InputError, Option
from render.files.naming import natural_sort
from render.mesh.mesh import check_faces

TEST = ("005", "010")
FPS = 30.0
_SOURCE = "TailorNet data set, Patel et al. 2020, github.com/zycliao/TailorNet_dataset"
_CONVERTER = "python smpl_lib/convert_smpl_models.py in https://github.com/zycliao/TailorNet_dataset makes it"


def jobs(paths: list[Path], options: ImportOptions) -> list[Job]:
    """One job a sequence below `paths`: folders `<class>_<gender>`, or the data set's root with several of them.

    Sequences whose simulation failed have no displacements in the data set; they are left out.

    Raises:
        InputError: no such folders, or no sequences in them.
    """
    import_jobs = []
    for path in paths:
        folders = [path] if (path / "pose").is_dir() else natural_sort(p.parent for p in path.glob("*/pose"))
        if not folders:
            raise InputError(
                f"{path}: no folder of the TailorNet data set, such as skirt_female with pose/ in it"
            )
        for folder in folders:
            import_jobs += _jobs_of(folder, options)
    return import_jobs


def _jobs_of(folder: Path, options: ImportOptions) -> list[Job]:
    match = re.fullmatch(r"(.+)_(female|male)", folder.resolve().name)
    if match is None:
        raise InputError(f"{folder}: the folder's name must be <class>_<gender>, such as t-shirt_female")
    garment = cache(lambda: _Garment(folder, match[1], match[2], options))
    import_jobs = []
    for poses in natural_sort((folder / "pose").glob("*/poses_*.npz")):
        number, pivot = poses.stem.removeprefix("poses_"), poses.parent.name
        moved = poses.with_name(f"unposed_{number}.npy")
        if not moved.is_file():
            continue

        def read(poses: Path = poses, moved: Path = moved) -> Clip:
            return garment().clip(poses, moved)

        name = valid_clip_name(options.garment or folder.resolve().name, f"{pivot}_{number}")
        split = options.split or ("test" if number in TEST else "train")
        import_jobs.append(Job(name, split, (poses, moved), read))
    if not import_jobs:
        raise InputError(
            f"{folder}: no sequences in it; wanted are pose/*/poses_NNN.npz with unposed_NNN.npy beside"
        )
    garment()
    return import_jobs


class _Garment:
    """What all sequences of one folder share: the garment on the fine body, and the body itself."""

    def __init__(self, folder: Path, kind: str, gender: str, options: ImportOptions) -> None:
        self.folder, self.options = folder, options
        root = folder.resolve().parent
        fine_path = root / f"smpl/smpl_hres_{gender}.npz"
        if not fine_path.is_file():
            raise InputError(
                f"{fine_path}: no such file, the fine SMPL mesh that the garments are given on; {_CONVERTER}"
            )
        self.fine = smpl_body(fine_path)
        self.body = smpl_body(find_smpl(options.smpl or root / "smpl", gender, needed_by="tailornet"))
        info = load_pickle(root / "garment_class_info.pkl")
        if not isinstance(info, dict) or not isinstance(info.get(kind), dict) or "f" not in info[kind]:
            known = ", ".join(str(key) for key in info) if isinstance(info, dict) else "nothing"
            raise InputError(f"{root / 'garment_class_info.pkl'}: does not describe {kind!r}; it has {known}")
        self.faces = check_shape(
            str(root / "garment_class_info.pkl"), "f", info[kind]["f"], (None, 3)
        ).astype(np.int64)
        self.cloth = self._on_fine_body(kind, info[kind], root)
        check_faces(self.faces, len(self.cloth.template), f"{root / 'garment_class_info.pkl'}: {kind}")

    def _on_fine_body(self, kind: str, info: dict, root: Path) -> SmplModel:
        """The fine body seen at the garment's vertices; a skirt's are mixtures of several."""
        fine = self.fine
        if kind == "skirt":
            weight = load_arrays(root / "skirt_weight.npz", ["w"])["w"]
            weight = check_shape(
                str(root / "skirt_weight.npz"), "w", weight, (None, len(fine.template))
            ).astype(float)
        else:
            source = str(root / "garment_class_info.pkl")
            weight = check_shape(source, "vert_indices", info.get("vert_indices"), (None,)).astype(np.int64)
            if len(weight) == 0 or weight.min() < 0 or weight.max() >= len(fine.template):
                raise InputError(f"{source}: vert_indices of {kind} must be vertices of the fine mesh")

        def at(values: np.ndarray) -> np.ndarray:
            return values[weight] if weight.ndim == 1 else np.tensordot(weight, values, axes=1)

        parts = ("template", "shapedirs", "posedirs", "weights")
        return replace(fine, **{part: at(getattr(fine, part)) for part in parts})

    def clip(self, poses_file: Path, moved_file: Path) -> Clip:
        """One sequence, posed."""
        poses = load_arrays(poses_file, ["thetas"])["thetas"]
        poses = check_shape(str(poses_file), "thetas", poses, (None, 72)).astype(np.float32)
        moved = load_array(moved_file)
        moved = check_shape(
            str(moved_file), "displacements", moved, (len(poses), len(self.cloth.template), 3)
        )
        shape, _, style = poses_file.parent.name.partition("_")
        shape_file = self.folder / f"shape/beta_{shape}.npy"
        betas = check_shape(str(shape_file), "betas", load_array(shape_file).reshape(-1), (None,))[:10]
        bones = self.fine.transforms(betas, poses)
        garment = np.empty(moved.shape, np.float32)
        for start in range(0, len(poses), 64):
            part = slice(start, start + 64)
            unskinned = self.cloth.unskinned(betas, poses[part]) + moved[part]
            garment[part] = skinned(unskinned, self.cloth.weights, bones[part])
        trans = np.zeros((len(poses), 3), np.float32)
        clip = Clip(
            template=Template(
                vertices=(self.cloth.rest(betas) + self._rest(shape, style, moved)).astype(np.float32),
                faces=self.faces,
            ),
            garment=Garment(garment),
            body=Body(
                rest=self.body.rest(betas).astype(np.float32),
                faces=self.body.faces,
                vertices=self.body.posed(betas, poses, trans),
            ),
            fps=self.options.fps or FPS,
            skeleton=Skeleton(
                poses=poses.reshape(len(poses), -1, 3),
                trans=trans,
                joints_rest=self.body.joints(betas).astype(np.float32),
                parents=self.body.parents,
                blend_weights=self.body.weights.astype(np.float32),
            ),
            info={"source": _SOURCE, "units": "m", "note": "poses in an order, not in time; fps is nominal"},
            name=poses_file.stem,
        )
        check_worn(clip, str(poses_file), hint=f"is it the right {Option('smpl')}?")
        return clip

    def _rest(self, shape: str, style: str, moved: np.ndarray) -> np.ndarray:
        """(N, 3) displacements of the hanging garment; where the data set has none, the middle of all frames."""
        path = self.folder / f"style_shape/beta{shape}_gamma{style}.npy"
        if not path.is_file():
            return np.median(moved, axis=0)
        return check_shape(str(path), "displacements", load_array(path), moved.shape[1:])
