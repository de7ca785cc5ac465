"""The public sets, in files that these tests write in their formats; and the SMPL body behind them."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import torch
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation
from smplx.lbs import lbs

from imgtransfer.cli.main import main
from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.store import DataSet
from imgtransfer.importers.smpl import SmplModel, find_smpl, skinned, smpl_body
from render import InputError
from tests.helpers.import_examples import CHAIN, motion, tube_model, worn, write_model, write_obj, write_pc2
from tests.helpers.public_sets import (
    BETAS,
    FRAMES,
    TRANS,
    vto_content,
    write_cloth3d,
    write_virtualbones,
)


@pytest.fixture
def model(tmp_path: Path) -> SmplModel:
    return smpl_body(write_model(tmp_path / "smpl/SMPL_FEMALE.npz", offset=-0.4))


def run(capsys: pytest.CaptureFixture[str], *argv: object) -> str:
    """A command that must work: its output."""
    capsys.readouterr()
    status = main([str(arg) for arg in argv])
    out, err = capsys.readouterr()
    assert status == 0, err
    return out


def error(capsys: pytest.CaptureFixture[str], *argv: object) -> str:
    """A command that must fail with one line."""
    capsys.readouterr()
    assert main([str(arg) for arg in argv]) == 2
    err = capsys.readouterr().err
    lines = [line for line in err.splitlines() if line.startswith("imgtransfer: error")]
    assert len(lines) == 1
    return lines[0]


# the body


def test_posing_equals_the_plain_loop(model: SmplModel) -> None:
    poses = motion(3)
    found = model.posed(BETAS, poses, TRANS[:3])
    for frame, pose in enumerate(poses):
        turns = Rotation.from_rotvec(pose.reshape(24, 3)).as_matrix()
        shaped = model.template + (model.shapedirs * BETAS).sum(-1)
        joints = model.regressor @ shaped
        corrected = shaped + (model.posedirs * (turns[1:] - np.eye(3)).ravel()).sum(-1)
        world: list[np.ndarray] = []
        for joint, parent in enumerate(CHAIN):
            local = np.eye(4)
            local[:3, :3] = turns[joint]
            local[:3, 3] = joints[joint] - (joints[parent] if joint else 0)
            world.append(world[parent] @ local if joint else local)
        for vertex, place in enumerate(corrected):
            moved = sum(
                weight * (matrix @ np.append(place - joint, 1))[:3]
                for weight, matrix, joint in zip(model.weights[vertex], world, joints, strict=True)
            )
            np.testing.assert_allclose(found[frame, vertex], moved + TRANS[frame], atol=1e-6)


def test_posing_equals_smplx(model: SmplModel) -> None:
    poses = motion(4)
    tensors = [
        torch.from_numpy(np.asarray(values, np.float64))
        for values in (
            model.template,
            model.shapedirs,
            model.posedirs.reshape(-1, 207).T,
            model.regressor,
            model.weights,
        )
    ]
    template, shapedirs, posedirs, regressor, weights = tensors
    betas, theta = torch.from_numpy(BETAS).expand(4, -1), torch.from_numpy(poses)
    wanted, _ = lbs(
        betas, theta, template[None], shapedirs, posedirs, regressor, torch.from_numpy(CHAIN), weights
    )
    np.testing.assert_allclose(model.posed(BETAS, poses, np.zeros((4, 3))), wanted.numpy(), atol=1e-6)


def test_model_files_are_found_by_gender(tmp_path: Path) -> None:
    for name in ("SMPL_MALE.npz", "deep/models/basicModel_f_lbs_10_207_0_v1.0.0.pkl"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    assert find_smpl(tmp_path, "male", needed_by="x").name == "SMPL_MALE.npz"
    assert find_smpl(tmp_path / "deep", "female", needed_by="x").suffix == ".pkl"
    assert (
        find_smpl(tmp_path / "SMPL_MALE.npz", "female", needed_by="x").name == "SMPL_MALE.npz"
    )  # the user's own choice
    with pytest.raises(
        InputError, match=r"no SMPL model of a neutral body.*register at https://smpl\.is\.tue\.mpg\.de"
    ):
        find_smpl(tmp_path, "neutral", needed_by="x")


def test_a_published_pickle_gives_the_same_body(tmp_path: Path, model: SmplModel) -> None:
    arrays: dict[str, Any] = tube_model(offset=-0.4)
    arrays["J_regressor"] = csc_matrix(arrays["J_regressor"])
    (tmp_path / "model.pkl").write_bytes(pickle.dumps(arrays | {"bs_type": "lrotmin"}, protocol=2))
    found = smpl_body(tmp_path / "model.pkl")
    poses = motion(2)
    np.testing.assert_array_equal(found.posed(BETAS, poses, TRANS[:2]), model.posed(BETAS, poses, TRANS[:2]))


def test_model_files_without_sense_are_named(tmp_path: Path) -> None:
    arrays = tube_model()
    np.savez(tmp_path / "a.npz", **{key: value for key, value in arrays.items() if key != "weights"})
    with pytest.raises(InputError, match=r"a\.npz: lacks weights"):
        smpl_body(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", **arrays | {"posedirs": arrays["posedirs"][:, :, :9]})
    with pytest.raises(InputError, match=r"posedirs must be numbers of shape \(132, 3, 207\)"):
        smpl_body(tmp_path / "b.npz")
    (tmp_path / "c.pkl").write_bytes(pickle.dumps([1, 2]))
    with pytest.raises(InputError, match="not a SMPL model"):
        smpl_body(tmp_path / "c.pkl")


# VTO


@pytest.fixture
def vto(tmp_path: Path, model: SmplModel) -> Path:
    """The folder simulations of VTO with a test and a training sequence, and the template beside."""
    poses = motion(FRAMES)
    rest, _ = worn(model, BETAS, poses)
    write_obj(tmp_path / "rest/tshirt.obj", rest.vertices, rest.faces)
    folder = tmp_path / "tshirt/simulations"
    folder.mkdir(parents=True)
    content = vto_content(model, poses)
    (folder / "tshirt_shape00_01_01.pkl").write_bytes(pickle.dumps(content, protocol=2))
    old = {
        "shape": content["shapes"],
        "pose": content["poses"][:, :72],
        "translation": content["poses"][:, 72:],
    }
    kept = {key: content[key] for key in ("vertices", "faces")}
    (folder / "tshirt_shape00_07_02.pkl").write_bytes(pickle.dumps(old | kept))
    return folder


def vto_argv(vto: Path, tmp_path: Path) -> list[object]:
    return [
        "import",
        "vto",
        vto,
        "--to",
        tmp_path / "set",
        "--smpl",
        tmp_path / "smpl",
        "--template",
        tmp_path / "rest",
    ]


def test_vto(tmp_path: Path, vto: Path, model: SmplModel, capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, *vto_argv(vto, tmp_path))
    data = DataSet.open(tmp_path / "set")
    assert data.names("test") == ["tshirt/shape00_01_01"]  # the paper's split
    assert data.names("train") == ["tshirt/shape00_07_02"]
    assert out.splitlines()[-2] == f"done     2 clips in {tmp_path / 'set'}"
    assert out.splitlines()[-1].startswith("next     imgtransfer inspect")
    new, old = (data.read(name) for name in ("tshirt/shape00_01_01", "tshirt/shape00_07_02"))
    poses = motion(FRAMES)
    np.testing.assert_allclose(new.body.vertices, model.posed(BETAS, poses, TRANS), atol=1e-5)
    np.testing.assert_allclose(new.garment.vertices, vto_content(model, poses)["vertices"], atol=1e-5)
    np.testing.assert_allclose(new.body.rest, model.rest(BETAS), atol=1e-6)
    assert new.fps == 30
    np.testing.assert_allclose(old.body.vertices, new.body.vertices, atol=1e-5)  # both spellings of the keys
    stays_in_its_frame(new)


def stays_in_its_frame(clip: Clip) -> None:
    """In the canonical frame the garment is where its template is: poses, trans and the rest pose belong together."""
    local = root_frames(clip, "root").to_canonical(clip.garment.vertices)
    assert np.linalg.norm(local - clip.template.vertices, axis=-1).max() < 0.1


def test_vto_finds_the_order_of_pose_and_translation(
    tmp_path: Path, vto: Path, model: SmplModel, capsys: pytest.CaptureFixture[str]
) -> None:
    path = vto / "tshirt_shape00_01_01.pkl"
    content = pickle.loads(path.read_bytes())
    content["poses"] = np.roll(content["poses"], 3, axis=1)  # the translation first
    path.write_bytes(pickle.dumps(content))
    run(capsys, *vto_argv(vto, tmp_path))
    clip = DataSet.open(tmp_path / "set").read("tshirt/shape00_01_01")
    np.testing.assert_allclose(clip.body.vertices, model.posed(BETAS, motion(FRAMES), TRANS), atol=1e-5)


def test_vto_goes_on_where_it_stopped(
    tmp_path: Path, vto: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    argv = vto_argv(vto, tmp_path)
    run(capsys, *argv, "--clip", "*07_02")
    assert DataSet.open(tmp_path / "set").names() == ["tshirt/shape00_07_02"]
    written: list[str] = []
    write = DataSet.write
    monkeypatch.setattr(
        DataSet,
        "write",
        lambda self, name, clip, **k: (written.append(name), write(self, name, clip, **k))[1],
    )
    assert "(1 there already)" in run(capsys, *argv)
    assert written == ["tshirt/shape00_01_01"]
    assert "(2 there already)" in run(capsys, *argv)
    run(capsys, *argv, "--fps", 60)  # another import
    assert len(written) == 3
    assert DataSet.open(tmp_path / "set").read("tshirt/shape00_07_02").fps == 60


def test_a_stop_leaves_no_half_of_a_clip(
    tmp_path: Path, vto: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write = DataSet.write

    def stop_at_the_second(self: DataSet, name: str, clip: Clip, *, split: str) -> None:
        if name.endswith("07_02"):
            raise KeyboardInterrupt
        write(self, name, clip, split=split)

    monkeypatch.setattr(DataSet, "write", stop_at_the_second)
    assert main([str(arg) for arg in vto_argv(vto, tmp_path)]) == 130
    monkeypatch.undo()
    assert DataSet.open(tmp_path / "set").names() == ["tshirt/shape00_01_01"]
    run(capsys, *vto_argv(vto, tmp_path))
    assert len(DataSet.open(tmp_path / "set").names()) == 2


def test_vto_without_what_only_the_user_can_get(
    tmp_path: Path, vto: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = ["import", "vto", vto, "--to", tmp_path / "set"]
    message = error(capsys, *base, "--template", tmp_path / "rest")
    assert "holds SMPL motion but no bodies; register at https://smpl.is.tue.mpg.de" in message
    assert "--smpl FOLDER" in message
    message = error(capsys, *base, "--smpl", tmp_path / "smpl")
    assert "the data set has no rest shapes; give the garment's rest shape by --template" in message
    assert "vto-garment-collisions" in message
    assert not (tmp_path / "set").exists()


def vto_without(content: dict[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in content.items() if name != key}


BAD_VTO: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "no poses": (lambda c: vto_without(c, "poses"), "lacks poses"),
    "a list": (lambda c: [c], "a dict is wanted"),
    "poses of 72": (lambda c: c | {"poses": c["poses"][:, :72]}, r"poses must be numbers of shape (5, 75)"),
    "another length": (lambda c: c | {"poses": c["poses"][:3]}, "(5, 75), found float64 (3, 75)"),
    "another sequence": (
        lambda c: c | {"sequence": "55_27"},
        "mislabelled, the file says that it is sequence 55_27",
    ),
    "another garment": (lambda c: c | {"vertices": c["vertices"][:, 1:]}, "83 vertices, but the template"),
    "other triangles": (lambda c: c | {"faces": c["faces"][:, ::-1]}, "other triangles than"),
    "a shape that changes": (
        lambda c: c | {"shapes": c["shapes"] * np.arange(5)[:, None]},
        "must be the same shape in each of 5 frames",
    ),
    "not finite": (lambda c: c | {"vertices": c["vertices"] * np.nan}, "not finite"),
    "poses not finite": (lambda c: c | {"poses": c["poses"] * np.nan}, "not finite"),
    "beside the body": (
        lambda c: c | {"vertices": c["vertices"] + np.float32(2)},
        "not on the body in frame 0",
    ),
    "text": (lambda c: c | {"vertices": "none"}, "vertices must be numbers"),
}


@pytest.mark.parametrize("case", BAD_VTO)
def test_bad_vto_files_are_named_and_the_others_imported(
    tmp_path: Path, vto: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    change, message = BAD_VTO[case]
    path = vto / "tshirt_shape00_01_01.pkl"
    path.write_bytes(pickle.dumps(change(pickle.loads(path.read_bytes()))))
    found = error(capsys, *vto_argv(vto, tmp_path))
    assert message in found
    assert "1 of 2 clips were not imported" in found
    assert DataSet.open(tmp_path / "set").names() == ["tshirt/shape00_07_02"]


def test_a_truncated_vto_file(tmp_path: Path, vto: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = vto / "tshirt_shape00_01_01.pkl"
    path.write_bytes(path.read_bytes()[:-100])
    argv = vto_argv(vto, tmp_path)
    argv[2] = path
    assert "not a whole pickle file" in error(capsys, *argv)
    assert DataSet.open(tmp_path / "set").names() == []


# TailorNet


@pytest.fixture
def tailornet(tmp_path: Path) -> Path:
    """The root of a TailorNet data set with pants and a skirt on the tube; sequences 004 and 005, 006 failed."""
    root = tmp_path / "tailornet"
    arrays = tube_model()
    write_model(root / "smpl/smpl_female.npz")
    write_model(root / "smpl/smpl_hres_female.npz")
    middle = np.flatnonzero((arrays["v_template"][:, 1] > 0.3) & (arrays["v_template"][:, 1] < 0.7))
    number = np.full(len(arrays["v_template"]), -1)
    number[middle] = np.arange(len(middle))
    faces = arrays["f"].astype(np.int64)
    faces = number[faces[np.isin(faces, middle).all(1)]]
    info = {kind: {"f": faces.astype(np.uint32), "vert_indices": middle} for kind in ("pant", "skirt")}
    (root / "garment_class_info.pkl").write_bytes(pickle.dumps(info, protocol=2))
    np.savez(root / "skirt_weight.npz", w=np.eye(len(arrays["v_template"]))[middle])
    outward = arrays["v_template"][middle] * [0.3, 0, 0.3]
    for kind in ("pant_female", "skirt_female"):
        (root / kind / "pose/000_001").mkdir(parents=True)
        for folder in ("shape", "style_shape"):
            (root / kind / folder).mkdir()
        np.save(root / kind / "shape/beta_000.npy", BETAS)
        np.save(root / kind / "style_shape/beta000_gamma001.npy", outward)
        for sequence in ("004", "005", "006"):
            poses = motion(FRAMES, seed=int(sequence))
            np.savez(
                root / kind / f"pose/000_001/poses_{sequence}.npz", thetas=poses, pose_order=np.arange(FRAMES)
            )
            if sequence != "006":
                np.save(
                    root / kind / f"pose/000_001/unposed_{sequence}.npy", np.repeat(outward[None], FRAMES, 0)
                )
    return root


def test_tailornet(tmp_path: Path, tailornet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(capsys, "import", "tailornet", tailornet, "--to", tmp_path / "set")
    data = DataSet.open(tmp_path / "set")
    assert data.names("train") == ["pant_female/000_001_004", "skirt_female/000_001_004"]
    assert data.names("test") == ["pant_female/000_001_005", "skirt_female/000_001_005"]
    pants, skirt = (data.read(f"{kind}_female/000_001_005") for kind in ("pant", "skirt"))
    model, poses = smpl_body(tailornet / "smpl/smpl_female.npz"), motion(FRAMES, seed=5)
    np.testing.assert_allclose(
        pants.body.vertices, model.posed(BETAS, poses, np.zeros((FRAMES, 3))), atol=1e-5
    )
    with (tailornet / "garment_class_info.pkl").open("rb") as file:
        at = pickle.load(file)["pant"]["vert_indices"]
    outward = model.template[at] * [0.3, 0, 0.3]
    unskinned = model.unskinned(BETAS, poses)[:, at] + outward
    wanted = skinned(unskinned, model.weights[at], model.transforms(BETAS, poses))
    np.testing.assert_allclose(pants.garment.vertices, wanted, atol=1e-5)
    np.testing.assert_allclose(pants.template.vertices, model.rest(BETAS)[at] + outward, atol=1e-5)
    np.testing.assert_allclose(
        skirt.garment.vertices, pants.garment.vertices, atol=1e-5
    )  # its weights pick vertices
    assert "nominal" in pants.info["note"]
    stays_in_its_frame(pants)


def test_tailornet_without_a_rest_shape_takes_the_middle_of_the_frames(
    tmp_path: Path, tailornet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tailornet / "pant_female"
    (folder / "style_shape/beta000_gamma001.npy").unlink()
    run(capsys, "import", "tailornet", folder, "--to", tmp_path / "set", "--clip", "*_005")
    assert DataSet.open(tmp_path / "set").names() == ["pant_female/000_001_005"]


def test_bad_tailornet_folders(tmp_path: Path, tailornet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    argv = ["import", "tailornet", tailornet / "pant_female", "--to", tmp_path / "set"]
    poses = tailornet / "pant_female/pose/000_001/poses_004.npz"
    content = poses.read_bytes()
    poses.write_bytes(content[: len(content) // 2])
    assert "poses_004.npz: not a readable npz" in error(capsys, *argv)
    np.savez(poses, thetas=motion(FRAMES - 1))
    assert "displacements must be numbers of shape (4," in error(capsys, *argv)
    np.savez(poses, theta=motion(FRAMES))
    assert "lacks thetas; it has theta" in error(capsys, *argv)
    assert DataSet.open(tmp_path / "set").names() == ["pant_female/000_001_005"]
    (tailornet / "smpl/smpl_hres_female.npz").unlink()
    assert "convert_smpl_models.py" in error(capsys, *argv)
    assert "no folder of the TailorNet data set" in error(
        capsys, "import", "tailornet", tmp_path, "--to", tmp_path / "set"
    )
    (tailornet / "pant_female").rename(tailornet / "pants")
    assert "<class>_<gender>" in error(
        capsys, "import", "tailornet", tailornet / "pants", "--to", tmp_path / "set"
    )


def test_a_tailornet_class_that_is_not_described(
    tmp_path: Path, tailornet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_model(tailornet / "smpl/smpl_hres_female.npz")
    (tailornet / "garment_class_info.pkl").write_bytes(pickle.dumps({"shirt": {}}))
    argv = ["import", "tailornet", tailornet / "pant_female", "--to", tmp_path / "set"]
    assert "does not describe 'pant'; it has shirt" in error(capsys, *argv)


# CLOTH3D


@pytest.mark.parametrize("rest_turned", [True, False])
def test_cloth3d(
    tmp_path: Path, model: SmplModel, capsys: pytest.CaptureFixture[str], rest_turned: bool
) -> None:
    moved, rest = write_cloth3d(tmp_path / "samples/01_01_s0", model, rest_turned=rest_turned)
    out = run(
        capsys,
        "import",
        "cloth3d",
        tmp_path / "samples",
        "--to",
        tmp_path / "set",
        "--smpl",
        tmp_path / "smpl",
    )
    assert "Tshirt_01_01_s0/01_01_s0  5 frames  train" in out
    clip = DataSet.open(tmp_path / "set").read("Tshirt_01_01_s0/01_01_s0")
    np.testing.assert_allclose(clip.garment.vertices, moved, atol=1e-3)  # 16-bit floats
    np.testing.assert_allclose(clip.body.vertices, model.posed(BETAS, motion(FRAMES), TRANS), atol=1e-5)
    np.testing.assert_allclose(clip.template.vertices, rest.vertices, atol=1e-5)
    assert clip.skeleton.joints_rest is not None
    np.testing.assert_allclose(clip.skeleton.joints_rest, model.joints(BETAS)[:1], atol=1e-6)
    stays_in_its_frame(clip)


def test_bad_cloth3d_samples(tmp_path: Path, model: SmplModel, capsys: pytest.CaptureFixture[str]) -> None:
    sample = tmp_path / "01_01_s0"
    moved, rest = write_cloth3d(sample, model, rest_turned=True)
    argv = ["import", "cloth3d", sample, "--to", tmp_path / "set", "--smpl", tmp_path / "smpl"]
    cache, info = (sample / name for name in ("Tshirt.pc16", "info.mat"))
    content, stored = cache.read_bytes(), info.read_bytes()
    cache.write_bytes(content[:-10])
    assert "Tshirt.pc16: truncated" in error(capsys, *argv)
    write_pc2(cache, moved[:3], half=True)
    assert "3 frames, but info.mat has 5 poses" in error(capsys, *argv)
    write_pc2(cache, moved[:, 1:], half=True)
    assert f"{len(rest.vertices) - 1} points a frame, but Tshirt.obj has {len(rest.vertices)}" in error(
        capsys, *argv
    )
    write_pc2(cache, moved)
    assert "mislabelled, it holds PC2" in error(capsys, *argv)
    cache.write_bytes(content)
    info.write_bytes(stored[:200])
    assert "info.mat: not a readable MAT file" in error(capsys, *argv)
    scipy.io.savemat(
        info,
        {"poses": np.zeros((72, 5)), "shape": BETAS, "trans": np.zeros((3, 4)), "gender": 0, "zrot": 0.0},
    )
    assert "trans must be numbers of shape (3, 5)" in error(capsys, *argv)
    scipy.io.savemat(info, {"pose": np.zeros((72, 5))})
    assert "lacks poses, shape" in error(capsys, *argv)
    cache.unlink()
    assert "no .pc16 point caches" in error(capsys, *argv)
    info.unlink()
    assert "no sample of CLOTH3D" in error(capsys, *argv)


# VirtualBones


@pytest.mark.parametrize("world", [True, False])
@pytest.mark.parametrize("from_y_up", [True, False])
@pytest.mark.parametrize("unit", [1.0, 0.1, 0.01])
def test_virtualbones_in_every_reading(  # noqa: PLR0917
    tmp_path: Path,
    model: SmplModel,
    capsys: pytest.CaptureFixture[str],
    world: bool,
    from_y_up: bool,
    unit: float,
) -> None:
    placed = write_virtualbones(tmp_path / "dress02", model, world=world, from_y_up=from_y_up, unit=unit)
    run(
        capsys,
        "import",
        "virtualbones",
        tmp_path / "dress02",
        "--to",
        tmp_path / "set",
        "--smpl",
        tmp_path / "smpl",
    )
    clip = DataSet.open(tmp_path / "set").read("dress02/7")
    np.testing.assert_allclose(clip.garment.vertices, placed, atol=1e-4)
    assert "SMPL in the avatar's pose" in clip.info["note"]
    stays_in_its_frame(clip)


def test_bad_virtualbones_folders(
    tmp_path: Path, model: SmplModel, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "dress02"
    write_virtualbones(folder, model, world=True, from_y_up=True, unit=1.0)
    argv = ["import", "virtualbones", folder, "--to", tmp_path / "set", "--smpl", tmp_path / "smpl"]
    with np.load(folder / "7.npz") as stored:
        arrays = dict(stored)
    cases = {
        "lacks sim_res": {"pose": arrays["pose"], "trans": arrays["trans"]},
        "pose must be numbers of shape (5, 52, 3)": arrays | {"pose": arrays["pose"][:, :24]},
        "sim_res must be numbers of shape (any, 84, 3)": arrays | {"sim_res": arrays["sim_res"][:, 1:]},
        "does not have the edges of template.obj": arrays | {"sim_res": arrays["sim_res"] * 4},
        "m from its template in every reading": arrays
        | {"trans": arrays["trans"] + 3, "sim_res": arrays["sim_res"] + 9},
        "not finite": arrays | {"trans": arrays["trans"] * np.nan},
    }
    for message, content in cases.items():
        np.savez(folder / "7.npz", **content)
        assert message in error(capsys, *argv)
    (folder / "7.npz").write_bytes(b"version https://git-lfs.github.com/spec/v1\n")
    assert "git lfs pull" in error(capsys, *argv)
    (folder / "template.obj").unlink()
    assert "no garment of the VirtualBones data set" in error(capsys, *argv)
