"""What a reader of the pages has: a clone with short sample data, motions, meshes of a garment and a body."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np

from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.mesh_output import save_obj
from imgtransfer.data.source import clip_refs
from imgtransfer.data.store import DataSet
from imgtransfer.importers.smpl import smpl_body
from imgtransfer.motions.library import make_motion
from render import load_mesh
from tests.helpers import hub
from tests.helpers.amass_files import write_amass
from tests.helpers.bvh_files import NAMINGS, write_bvh
from tests.helpers.import_examples import motion, split, standing_body, vest, worn, write_model, write_obj
from tests.helpers.paths import ROOT
from tests.helpers.public_sets import BETAS, FRAMES, vto_content
from tests.helpers.scenes import Written, write_usd

SAMPLE = ROOT / "configs/sample_data"
_SHORT = 6  # frames of the sample data's clips
_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # ours to a file in which z is up and bodies face -y


def write_clone(folder: Path) -> Path:
    """A clone whose sample data have a few frames a clip; all else are links to the real one."""
    folder.mkdir(parents=True)
    for name in ("scripts", "constraints.txt"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "configs/sample_data").mkdir(parents=True)
    for entry in (ROOT / "configs").iterdir():
        if entry.name != SAMPLE.name:
            (folder / "configs" / entry.name).symlink_to(entry)
    for file in SAMPLE.glob("*.zarr.zip"):
        data = DataSet.create(folder.parent / file.stem)
        for ref in clip_refs(file):
            reader = ref.reader()
            data.write(ref.name, reader.clip(20, 20 + _SHORT), split=ref.split)
        assert main(["export", str(data.path), "--out", str(folder / "configs/sample_data" / file.name)]) == 0
    return folder


def write_motions() -> None:
    """walk.npz and walk.bvh."""
    write_amass(Path("walk.npz"))
    write_bvh(Path("walk.bvh"), make_motion("walk", seed=1, seconds=0.2), NAMINGS["mixamo"])


def write_coat(name: str, *, z_up: bool) -> None:
    """A garment that fits the resting body, with split seams, in centimetres, as another program has it."""
    mesh = split(vest(standing_body()))
    axes = _Z_UP if z_up else np.eye(3)
    save_obj(Path(name), replace(mesh, vertices=100 * mesh.vertices @ axes.T))


def walk(*, frames: int = 3) -> Clip:
    """Some frames of the dress that walks."""
    (ref,) = clip_refs(SAMPLE / "dress.zarr.zip", names=["dress/walk_s104"])
    return ref.reader().clip(20, 20 + frames)


def write_walk(folder: Path, *, in_centimetres: bool = False) -> None:
    """A garment and its body as meshes, one file a frame; in centimetres with z up, as another program has them."""
    save_clip(folder.with_suffix(".clip.npz"), walk())
    assert main(["export", str(folder.with_suffix(".clip.npz")), "--out", str(folder)]) == 0
    if in_centimetres:
        for file in folder.glob("*.obj"):
            mesh = load_mesh(file)
            write_obj(file, 100 * mesh.vertices @ _Z_UP.T, mesh.faces)


def write_walk_scene(file: Path, *, garment: str, body: str) -> None:
    """A USD file with both, under these names."""
    clip = walk()
    assert clip.garment is not None
    meshes = {
        f"/{name}": Written(vertices, np.arange(clip.n_frames) / 30, [3] * len(faces), faces.ravel().tolist())
        for name, vertices, faces in (
            (garment, clip.garment.vertices, clip.template.faces),
            (body, clip.body.vertices, clip.body.faces),
        )
    }
    write_usd(file, meshes)


def write_vto(folder: Path) -> None:
    """Tubes of cloth in the layout of the VTO data set, a model and rest shapes beside them, and a tiny encoder."""
    model = smpl_body(write_model(folder / "SMPL/SMPL_FEMALE.npz", offset=-0.4))
    for garment in ("tshirt", "dress"):
        rest, _ = worn(model, BETAS, motion(1))
        write_obj(folder / f"vto-garment-collisions/assets/meshes/{garment}.obj", rest.vertices, rest.faces)
        simulations = folder / f"vto-dataset/{garment}/simulations"
        simulations.mkdir(parents=True)
        for seed, sequence in enumerate(("01_01", "07_02", "08_04")):
            content = vto_content(model, motion(FRAMES, seed=seed)) | {"sequence": sequence}
            (simulations / f"{garment}_shape00_{sequence}.pkl").write_bytes(pickle.dumps(content))
    hub.checkpoint(folder / "dino-vitb16")
