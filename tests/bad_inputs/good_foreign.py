"""Good input of other programs and sets: meshes, caches, motions, SMPL models, the public data sets."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import trimesh

from imgtransfer.data.clip import Clip
from imgtransfer.importers.smpl import SmplModel, smpl_body
from imgtransfer.motions.library import make_motion
from tests.helpers.amass_files import write_amass
from tests.helpers.bvh_files import NAMINGS, write_bvh
from tests.helpers.import_examples import (
    motion,
    tube_model,
    worn,
    write_mdd,
    write_model,
    write_obj,
    write_pc2,
)
from tests.helpers.public_sets import BETAS, FRAMES, vto_content, write_cloth3d, write_virtualbones
from tests.helpers.scenes import UsdUtils, Written, write_abc, write_usd

MATERIALS = "newmtl cloth\nKd 0.8 0.1 0.1\nmap_Kd weave.png\n"


def write_meshes(clip: Clip) -> None:
    """walk/ with OBJ frames, pc2/ and mdd/ with caches, scenes/, text/ and packed/ with Alembic and USD of every form,
    single meshes of every form.
    """
    assert clip.garment is not None
    parts = {
        "garment": (clip.garment.vertices, clip.template.vertices, clip.template.faces, "template"),
        "body": (clip.body.vertices, clip.body.rest, clip.body.faces, "body_rest"),
    }
    for name, (moving, rest, faces, still) in parts.items():
        for frame, vertices in enumerate(moving):
            write_obj(Path(f"walk/{name}/{name}_{frame:04d}.obj"), vertices, faces)
        write_pc2(Path(f"pc2/{name}.pc2"), moving)
        write_mdd(Path(f"mdd/{name}.mdd"), moving, 30.0)
        for folder in ("walk", "pc2", "mdd"):
            write_obj(Path(f"{folder}/{still}.obj"), rest, faces)
        _write_scenes(name, moving, faces)
        for folder in ("scenes", "text", "packed"):
            write_obj(Path(f"{folder}/{still}.obj"), rest, faces)
    _write_textured(Path("walk/template.obj"), clip)
    _write_textured(Path("template.obj"), clip)
    mesh = trimesh.Trimesh(clip.template.vertices, clip.template.faces, process=False)
    for ending in ("ply", "stl", "glb"):
        mesh.export(f"template.{ending}")
    Path("text.ply").write_bytes(trimesh.exchange.ply.export_ply(mesh, encoding="ascii"))
    embedded = trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh), embed_buffers=True)
    Path("template.gltf").write_bytes(embedded["model.gltf"])
    for frame, vertices in enumerate(clip.garment.vertices):
        write_obj(Path(f"frames/garment_{frame:04d}.obj"), vertices, clip.template.faces)


def _write_scenes(name: str, moving: np.ndarray, faces: np.ndarray) -> None:
    """One mesh in motion in scenes/ (the garment as Alembic, the body as binary USD), text/ and packed/ (USD)."""
    for folder in ("scenes", "text", "packed"):
        Path(folder).mkdir(exist_ok=True)
    seconds = [frame / 30 for frame in range(len(moving))]
    meshes = {f"/root/{name}": Written(moving, seconds, [3] * len(faces), faces.reshape(-1).tolist())}
    if name == "garment":
        write_abc(Path(f"scenes/{name}.abc"), meshes)
    else:
        write_usd(Path(f"scenes/{name}.usdc"), meshes)
    write_usd(Path(f"text/{name}.usda"), meshes)
    UsdUtils.CreateNewUsdzPackage(f"text/{name}.usda", f"packed/{name}.usdz")


def _write_textured(path: Path, clip: Clip) -> None:
    """The template with texture coordinates, a material library and its image."""
    lines = ["mtllib cloth.mtl\n"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in clip.template.vertices]
    lines += [f"vt {x:.6g} {y:.6g}\n" for x, y, _ in clip.template.vertices]
    lines += ["usemtl cloth\n"] + [f"f {a}/{a} {b}/{b} {c}/{c}\n" for a, b, c in clip.template.faces + 1]
    path.write_text("".join(lines))
    path.with_name("cloth.mtl").write_text(MATERIALS)
    path.with_name("weave.png").write_bytes(Path("weave.png").read_bytes())


def write_motions() -> None:
    """motion.npz in the style of AMASS, and motion.bvh."""
    write_amass(Path("motion.npz"))
    walk = make_motion("walk", seed=1, seconds=0.3)
    write_bvh(Path("motion.bvh"), walk, NAMINGS["cmu"])


def write_public_sets() -> None:
    """smpl/, vto/, tailornet/, cloth3d/ and virtualbones/, each with one clip."""
    model = smpl_body(write_model(Path("smpl/SMPL_FEMALE.npz"), offset=-0.4))
    Path("pickled").mkdir()
    Path("pickled/SMPL_FEMALE.pkl").write_bytes(pickle.dumps(tube_model(offset=-0.4), protocol=2))
    _write_vto(model)
    _write_tailornet(Path("tailornet"))
    write_cloth3d(Path("cloth3d/01_01_s0"), model, rest_turned=True)
    write_virtualbones(Path("virtualbones/dress02"), model, world=True, from_y_up=True, unit=1.0)


def _write_vto(model: SmplModel) -> None:
    poses = motion(FRAMES)
    rest, _ = worn(model, BETAS, poses)
    write_obj(Path("vto_rest/tshirt.obj"), rest.vertices, rest.faces)
    folder = Path("vto/tshirt/simulations")
    folder.mkdir(parents=True)
    (folder / "tshirt_shape00_01_01.pkl").write_bytes(pickle.dumps(vto_content(model, poses), protocol=2))


def _write_tailornet(root: Path) -> None:
    arrays = tube_model()
    write_model(root / "smpl/smpl_female.npz")
    write_model(root / "smpl/smpl_hres_female.npz")
    heights = arrays["v_template"][:, 1]
    middle = np.flatnonzero((heights > 0.3) & (heights < 0.7))
    number = np.full(len(heights), -1)
    number[middle] = np.arange(len(middle))
    faces = number[arrays["f"].astype(np.int64)]
    info = {"pant": {"f": faces[(faces >= 0).all(1)].astype(np.uint32), "vert_indices": middle}}
    (root / "garment_class_info.pkl").write_bytes(pickle.dumps(info, protocol=2))
    outward = arrays["v_template"][middle] * [0.3, 0, 0.3]
    clip = root / "pant_female/pose/000_001"
    for folder in (clip, root / "pant_female/shape", root / "pant_female/style_shape"):
        folder.mkdir(parents=True)
    np.save(root / "pant_female/shape/beta_000.npy", BETAS)
    np.save(root / "pant_female/style_shape/beta000_gamma001.npy", outward)
    np.savez(clip / "poses_004.npz", thetas=motion(FRAMES, seed=4), pose_order=np.arange(FRAMES))
    np.save(clip / "unposed_004.npy", np.repeat(outward[None], FRAMES, 0))
