"""The user's own garment on the user's own moving body: `imgtransfer simulate FOLDER --template FILE`."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from fusion import BodySdf
from imgtransfer.bodies.anny import load_body
from imgtransfer.cli.main import main
from imgtransfer.data.mesh_output import save_mesh_frames
from imgtransfer.data.store import DataSet
from imgtransfer.garments.config import SkirtConfig, TemplateConfig, TShirtConfig
from imgtransfer.garments.garment import make_garment
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.motions.library import make_motion
from imgtransfer.simulation.body_motion.body_sequence import find_sequence, resampled
from imgtransfer.simulation.body_motion.unskinned import MeshBodyMotion
from imgtransfer.simulation.config import SimulateConfig, SolverConfig
from imgtransfer.simulation.motion_config import SequenceFiles
from imgtransfer.simulation.planning.plan import plan
from imgtransfer.simulation.run import Rejected, simulate_clip
from render import InputError, Mesh, load_mesh
from tests.helpers.import_examples import split, write_mdd, write_obj, write_pc2

BODY = load_body()
MAX = Axes("z", "-y", 0.01)  # centimetres, z up
QUICK = {
    "min_substeps": 3,
    "max_substeps": 4,
    "iterations": 2,
    "settle_seconds": 0.1,
    "warm_up_seconds": 0.15,
}
FRAMES = 6


def theirs(vertices, axes=MAX):
    return vertices @ axes.rotation / axes.scale


def moving(kind, frames=FRAMES):
    """(T, B, 3) the body in a motion, 2 m away and turned."""
    motion = make_motion(kind, seed=1, seconds=1)
    vertices = BODY.pose(motion.poses[:frames], motion.trans[:frames]).vertices
    return vertices @ np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]) + [2, 0, 1]


def write_body(folder, vertices, axes=MAX):
    """A sequence's folder with OBJ frames."""
    for frame, placed in enumerate(vertices):
        write_obj(folder / "body" / f"frame_{frame:03d}.obj", theirs(placed, axes), BODY.faces)
    write_obj(folder / "body_rest.obj", theirs(BODY.rest, axes), BODY.faces)
    return folder


def write_shirt(path, mesh, axes=MAX):
    """The garment as a modelling program writes it: seams split, texture coordinates, two materials."""
    parts = split(mesh)
    lying = Mesh(theirs(parts.vertices, axes), parts.faces, surface=parts.surface)
    save_mesh_frames(path.parent / ".shirt", lying.vertices[None], lying, "obj")
    path.parent.mkdir(exist_ok=True)
    (path.parent / ".shirt" / "frame_0000.obj").rename(path)
    shutil.move(path.parent / ".shirt" / "materials.mtl", path.parent / "materials.mtl")
    return path


@pytest.fixture(scope="module")
def shirt():
    return make_garment(BODY, TShirtConfig(edge_length=0.05)).mesh


@pytest.fixture(scope="module")
def files(tmp_path_factory, shirt):
    """Two sequences, a garment and a configuration: read only."""
    folder = tmp_path_factory.mktemp("own")
    write_body(folder / "bodies/walk", moving("walk"))
    write_body(folder / "bodies/reach 2", moving("reach"))
    write_shirt(folder / "my shirt.obj", shirt)
    (folder / "quick.yaml").write_text(json.dumps({"solver": QUICK}))  # JSON is YAML
    return folder


@pytest.fixture
def own(files, tmp_path):
    """A copy of `files` that a test may spoil."""
    return shutil.copytree(files, tmp_path / "own")


FLAGS = ("--unit=cm", "--up=z", "--weld")


def command(folder, *sources, out="set.zarr", flags=FLAGS, template="my shirt.obj"):
    given = ["--template", str(folder / template)] if template else []
    paths = [str(folder / source) for source in ("quick.yaml", *sources)]
    return ["simulate", *paths, *given, *flags, "--out", str(folder / out)]


def error(capsys, argv):
    """The one line of a command that must fail before any work."""
    capsys.readouterr()
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert out == ""
    lines = [line for line in err.splitlines() if not line.startswith(("note:", "left out"))]
    assert len(lines) == 1
    return err


@pytest.fixture(scope="module")
def made(files, tmp_path_factory):
    """Both sequences, simulated by the command."""
    folder = shutil.copytree(files, tmp_path_factory.mktemp("made") / "own")
    assert main(command(folder, "bodies")) == 0
    return folder


def test_a_garment_hangs_on_a_body_of_which_only_meshes_are_known(made):
    data = DataSet.open(made / "set.zarr")
    assert data.names() == ["my-shirt/reach-2", "my-shirt/walk"]
    clip = data.read("my-shirt/walk")
    np.testing.assert_allclose(clip.body.vertices, moving("walk"), atol=2e-5)
    np.testing.assert_allclose(clip.body.rest, BODY.rest, atol=2e-5)
    assert clip.skeleton.poses is None and clip.skeleton.trans is None and clip.skeleton.blend_weights is None  # noqa: PT018
    assert clip.fps == 30
    for frame in (0, clip.n_frames - 1):
        sdf = BodySdf(clip.body.faces, len(clip.body.rest))
        sdf.update(clip.body.vertices[frame])
        distance = sdf.distance(torch.from_numpy(clip.garment.vertices[frame]))
        assert 0 < distance.min() < distance.max() < 0.3
    start, end = clip.template_mesh.edges.T
    ratio = np.linalg.norm(clip.garment.vertices[:, end] - clip.garment.vertices[:, start], axis=-1)
    ratio /= np.linalg.norm(clip.template.vertices[end] - clip.template.vertices[start], axis=-1)
    assert 0.8 < np.percentile(ratio, 1) < np.percentile(ratio, 99) < 1.3
    assert "mesh sequence walk" in clip.info["source"]
    assert str(made) not in json.dumps(clip.info)


def test_its_seams_uvs_and_materials_survive(made, files, shirt):
    clip = DataSet.open(made / "set.zarr").read("my-shirt/walk")
    given = load_mesh(files / "my shirt.obj")
    assert len(clip.template.vertices) == len(shirt.vertices) < len(given.vertices)
    surface = clip.template.surface
    np.testing.assert_array_equal(surface.faces, given.faces)
    np.testing.assert_array_equal(surface.uvs, given.surface.uvs)
    assert surface.materials == ("front", "side panel")
    assert "newmtl side panel" in surface.mtl


def test_a_second_run_keeps_what_stands_and_names_what_was_made_otherwise(made, capsys):
    files = [made / "set.zarr" / "my-shirt" / name / "zarr.json" for name in ("walk", "reach-2")]
    before = [file.stat().st_mtime_ns for file in files]
    assert main(command(made, "bodies")) == 0
    out, err = capsys.readouterr()
    assert "2 of 2 clips stand" in out
    assert "note" not in err
    shirt = made / "my shirt.obj"
    text = shirt.read_text()
    shirt.write_text(text + "# another author\n")
    assert main(command(made, "bodies")) == 0
    assert "2 clips stand that were made with other settings or files" in capsys.readouterr().err
    shirt.write_text(text)
    assert [file.stat().st_mtime_ns for file in files] == before


@pytest.mark.long  # as test_simulation_run.py has it for bodies that a skeleton moves
def test_two_workers_make_the_same(made):
    assert main([*command(made, "bodies", out="two.zarr"), "--workers", "2"]) == 0
    one, two = (DataSet.open(made / name) for name in ("set.zarr", "two.zarr"))
    assert one.names() == two.names()
    for name in one.names():
        assert np.array_equal(one.read(name).garment.vertices, two.read(name).garment.vertices)


def test_where_the_body_stands_and_faces_changes_nothing(tmp_path, shirt):
    turn = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])
    path = write_obj(tmp_path / "shirt.obj", shirt.vertices, shirt.faces)
    config = SimulateConfig(garment=TemplateConfig(path=path), solver=SolverConfig(**QUICK))
    clips = []
    for name, vertices in (("here", moving("walk")), ("there", moving("walk") @ turn.T + [5, 1, 3])):
        folder = write_body(tmp_path / name, vertices, Axes())
        clips.append(simulate_clip(find_sequence(folder, SequenceFiles(), 30.0), config)[0])
    here, there = (clip.garment.vertices for clip in clips)
    difference = np.linalg.norm(here @ turn.T + [5, 1, 3] - there, axis=-1)
    assert np.median(difference) < 2e-4  # contact multiplies rounding
    assert difference.max() < 0.02


def test_a_waistband_stays_on_the_skin_below(tmp_path):
    skirt = make_garment(BODY, SkirtConfig(edge_length=0.05))
    path = write_obj(tmp_path / "kilt.obj", skirt.mesh.vertices, skirt.mesh.faces)
    folder = write_body(tmp_path / "squat", moving("squat", 12), Axes())
    garment = TemplateConfig(path=path, pinned=True)
    body_motion = MeshBodyMotion(
        find_sequence(folder, SequenceFiles(), 30.0), SimulateConfig(garment=garment, solver=QUICK)
    )
    np.testing.assert_array_equal(body_motion.dressed.garment.pinned, skirt.pinned)
    band = skirt.mesh.vertices[skirt.pinned]
    around = np.linalg.norm(np.diff(band, axis=0), axis=1)
    for number in (1, body_motion.start, len(body_motion.skin) - 1):
        skin, pinned = body_motion.between(number, 2)
        assert skin.shape == (2, len(BODY.rest), 3)
        for body, points in zip(skin, pinned, strict=True):
            sdf = BodySdf(BODY.faces, len(body))
            sdf.update(body)
            away = sdf.distance(torch.from_numpy(points)).numpy()
            assert 0.004 < away.min() < away.max() < 0.03
        # Neighbours keep their distance but for what the waist stretches.
        moved = np.linalg.norm(np.diff(pinned[-1], axis=0), axis=1)
        assert np.percentile(np.abs(moved - around), 90) < 0.012


def test_frames_are_resampled_by_time():
    vertices = np.arange(7, dtype=np.float32)[:, None, None] * np.ones((1, 2, 3), np.float32)
    assert resampled(vertices, 30.0, 30.0) is vertices
    np.testing.assert_allclose(resampled(vertices, 60.0, 30.0)[:, 0, 0], [0, 2, 4, 6])
    np.testing.assert_allclose(resampled(vertices, 24.0, 30.0)[:, 0, 0], np.arange(8) * 0.8, atol=1e-6)
    np.testing.assert_allclose(resampled(vertices[:2], 30.0, 60.0)[:, 0, 0], [0, 0.5, 1])


def test_the_frame_rate_is_the_files_or_the_users(tmp_path):
    write_body(tmp_path / "walk", moving("walk", 13), Axes())
    read = find_sequence(tmp_path / "walk", SequenceFiles(fps=60), 30.0).read()
    assert read.sequence.n_frames == 7
    shutil.rmtree(tmp_path / "walk/body")
    write_mdd(tmp_path / "walk/body.mdd", moving("walk", 13), 60.0)
    assert find_sequence(tmp_path / "walk", SequenceFiles(), 30.0).read().sequence.n_frames == 7
    with pytest.raises(InputError, match="13 frames at 500 a second are too short"):
        find_sequence(tmp_path / "walk", SequenceFiles(fps=500), 30.0).read()


def test_rejected_clips_are_tried_again_when_a_file_changes_and_not_when_it_moves(own, capsys):
    (own / "quick.yaml").write_text(json.dumps({"solver": QUICK, "gates": {"p99_stretch": 0.5}}))
    argv = command(own, "bodies/walk")
    assert "every clip was rejected" in error_after_work(capsys, argv)
    mark = DataSet.open(own / "set.zarr").rejected()["my-shirt/walk"]["made"]
    (own / "elsewhere").mkdir()
    shutil.move(own / "my shirt.obj", own / "elsewhere/my shirt.obj")
    assert made_of(own, "elsewhere/my shirt.obj") == mark
    with (own / "bodies/walk/body/frame_003.obj").open("a") as file:
        file.write("# touched\n")
    assert made_of(own, "elsewhere/my shirt.obj") != mark


def error_after_work(capsys, argv):
    capsys.readouterr()
    assert main(argv) == 2
    return capsys.readouterr().err


def made_of(folder, template):
    """The mark under which a rejected clip is listed."""
    shutil.rmtree(folder / "set.zarr")
    assert main(command(folder, "bodies/walk", template=template)) == 2
    return DataSet.open(folder / "set.zarr").rejected()["my-shirt/walk"]["made"]


# what is said before any work


def lone_vertex(mesh):
    return np.concatenate([mesh.vertices, mesh.vertices[:1] + np.array([0, 0, 0.01])]), mesh.faces


def flat_triangle(mesh):
    return mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:1, [0, 0, 1]]])


UPRIGHT = ("--unit=cm", "--up=z", "--garment-up=y", "--garment-unit=m")


def test_a_mesh_that_cannot_be_cloth_is_refused(own, shirt, capsys):
    write_obj(own / "odd.obj", *flat_triangle(shirt))
    said = error(capsys, command(own, "bodies/walk", flags=UPRIGHT, template="odd.obj"))
    assert "1 triangles have no area" in said


def test_a_vertex_that_no_triangle_uses_is_noted(own, shirt, capsys):
    write_obj(own / "odd.obj", *lone_vertex(shirt))
    assert main([*command(own, "bodies/walk", flags=UPRIGHT, template="odd.obj"), "--dry-run"]) == 0
    assert "note: " in (said := capsys.readouterr().err)
    assert "odd.obj: 1 vertices belong to no triangle" in said


def test_a_garment_of_ones_own_is_needed(files, capsys):
    said = error(capsys, command(files, "bodies/walk", template=None, flags=()))
    assert "a tshirt cannot be cut for a body mesh sequence, which has no skeleton" in said
    assert "--template FILE" in said
    assert not (files / "set.zarr").exists()


@pytest.mark.parametrize(("flags", "wanted"), [
    ((), "add --unit=cm"),
    (("--unit=cm",), "add --up=z --facing=-y"),
    (("--unit=cm", "--up=z"), "seams were split (by texture coordinates or panels); cloth would come apart there: "
     "add --weld (--anyway goes on all the same)"),
    (("--unit=cm", "--garment-unit=m", "--up=z", "--weld"), "add --garment-unit=cm"),
    (("--unit=cm", "--up=z", "--garment-up=y", "--weld"), "add --garment-up=z --garment-facing=-y"),
    (("--unit=furlong",), "--unit furlong: one of m, cm"),
    (("--unit=cm", "--scale=0.01"), "--unit and --scale say the same"),
    (("--up=z", "--facing=z"), "must be different axes"),
    ((*FLAGS, "--fps=0"), "--fps 0.0"),
    ((*FLAGS, "--frames=1"), "--frames 1: at least 2 are wanted"),
    ((*FLAGS, "--garment", "a/b"), "--garment a/b: a name of letters"),
    ((*FLAGS, "--body-rest", "none.obj"), "--body-rest none.obj: no such file"),
])  # fmt: skip
def test_what_is_wrong_with_the_files_is_said_with_the_flag_that_mends_it(files, capsys, flags, wanted):
    assert wanted in error(capsys, command(files, "bodies/walk", flags=flags))
    assert not (files / "set.zarr").exists()


def test_a_configuration_s_template_is_mended_by_its_keys(own, capsys):
    garment = {"kind": "template", "path": str(own / "my shirt.obj"), "unit": "cm", "up": "z"}
    (own / "quick.yaml").write_text(json.dumps({"garment": garment, "solver": QUICK}))
    flags = ("--unit=cm", "--up=z")
    said = error(capsys, command(own, "bodies/walk", template=None, flags=flags))
    assert "add `garment.weld: true` (`garment.anyway: true` goes on all the same)" in said
    assert "--weld" not in said


@pytest.mark.parametrize(("flag", "wanted"), [
    ("--pinned", "--pinned goes with --template FILE"),
    ("--garment=tee", "--garment goes with --template FILE"),
    ("--garment-up=z", "--garment-up goes with --template FILE"),
    ("--fps=60", "--fps goes with body mesh sequences"),
    ("--unit=cm", "--unit goes with --template FILE or body mesh sequences"),
    ("--weld", "--weld goes with --template FILE or body mesh sequences"),
])  # fmt: skip
def test_flags_that_would_do_nothing_are_refused(files, capsys, flag, wanted):
    (files / "walks.yaml").write_text("clips: [{motion: walk}]")
    argv = ["simulate", str(files / "walks.yaml"), flag, "--out", str(files / "set.zarr")]
    assert wanted in error(capsys, argv)


def test_a_template_is_worn_by_the_configuration_s_body_too(own, capsys):
    (own / "quick.yaml").write_text(json.dumps({"clips": [{"motion": "walk"}], "solver": QUICK}))
    flags = ("--unit=mm", "--up=z", "--weld")
    assert "its file is in other units than the body's: add --garment-unit=cm" in error(
        capsys, command(own, flags=flags)
    )
    assert main([*command(own, flags=("--garment-unit=cm", "--garment-up=z", "--weld")), "--frames=3"]) == 0
    clip = DataSet.open(own / "set.zarr").read("my-shirt/walk_s0")
    assert clip.n_frames == 3
    assert clip.skeleton.poses is not None
    assert clip.template.surface.materials == ("front", "side panel")


def spoil_count(folder):
    body = load_mesh(folder / "frame_003.obj")
    write_obj(folder / "frame_003.obj", body.vertices[:-1], np.minimum(body.faces, len(body.vertices) - 2))


def spoil_value(folder):
    file = folder / "frame_002.obj"
    lines = file.read_text().splitlines()
    lines[5] = "v nan 0 0"
    file.write_text("\n".join(lines))


def spoil_order(folder):
    order = np.random.default_rng(0).permutation(len(BODY.rest))
    for file in folder.iterdir():
        write_obj(file, load_mesh(file).vertices[order], BODY.faces)


def spoil_size(folder):
    for file in folder.iterdir():
        write_obj(file, load_mesh(file).vertices / 100, BODY.faces)


@pytest.mark.parametrize(("spoil", "wanted"), [
    (spoil_count, "frame_003.obj: 2814 vertices, but the first frame has 2815; the vertex count must not change"),
    (spoil_value, "frame_002.obj"),
    (spoil_order, "the frames' vertices are not in the order of"),
    (spoil_size, "in other units: add --motion-unit=m "),
    (lambda folder: (folder / "frame_003.obj").unlink(), "frames are missing"),
    (lambda folder: (folder / "frame_002.obj").write_bytes(b"\x00\xff\x00garbage"), "frame_002.obj"),
    (lambda folder: [(folder / f"frame_00{n}.obj").unlink() for n in range(1, FRAMES)], "needs two frames or more"),
])  # fmt: skip
def test_faulty_frames_are_named(own, capsys, spoil, wanted):
    wanted = wanted.replace("2815", str(len(BODY.rest))).replace("2814", str(len(BODY.rest) - 1))
    spoil(own / "bodies/walk/body")
    assert wanted in error(capsys, command(own, "bodies/walk"))
    assert not (own / "set.zarr").exists()


def test_a_body_that_jumps_is_left_out_with_its_frame(own, capsys):
    for frame in (3, 4, 5):
        path = own / f"bodies/walk/body/frame_{frame:03d}.obj"
        write_obj(path, load_mesh(path).vertices + np.array([300, 0, 0]), BODY.faces)
    said = error(capsys, command(own, "bodies/walk"))
    assert "left out" in said
    assert "m/s into frame_003.obj, at most 30 are allowed" in said
    assert "nothing to simulate" in said
    config = SimulateConfig(
        garment=TemplateConfig(path=own / "my shirt.obj", up="z", unit="cm", weld=True),
        sequences=SequenceFiles(up="z", unit="cm", speed=200),
    )
    assert [task.name for task in plan(config, [own / "bodies/walk"])] == ["my-shirt/walk"]


def test_without_body_rest_the_first_frame_is_the_rest_pose_and_that_is_said(own, capsys):
    (own / "bodies/walk/body_rest.obj").unlink()
    capsys.readouterr()
    said = error(capsys, command(own, "bodies/walk"))
    assert "no body_rest beside it, so its first frame is taken as the rest pose" in said
    assert "frame_000.obj: the body stands along z and faces x, not z and -y" in said


def test_a_point_cache_needs_its_mesh_and_all_its_bytes(own, capsys):
    walk = own / "bodies/walk"
    shutil.rmtree(walk / "body")
    cache = write_pc2(walk / "body.pc2", theirs(moving("walk")))
    assert len(plan(SimulateConfig(
        garment=TemplateConfig(path=own / "my shirt.obj", up="z", unit="cm", weld=True),
        sequences=SequenceFiles(up="z", unit="cm"),
    ), [walk])) == 1  # fmt: skip
    cache.write_bytes(cache.read_bytes()[:-100])
    assert "truncated" in error(capsys, command(own, "bodies/walk"))
    (walk / "body_rest.obj").unlink()
    assert "put the mesh that it moves beside it as body_rest.obj" in error(
        capsys, command(own, "bodies/walk")
    )


def test_motions_and_sequences_are_told_apart(own, capsys):
    shutil.copytree(own / "bodies/walk", own / "mixed/walk")
    np.savez(own / "mixed/hop.npz", poses=np.zeros((20, 66)), trans=np.zeros((20, 3)), mocap_framerate=30.0)
    said = error(capsys, command(own, "mixed"))
    assert "1 motion files (hop.npz) and 1 body mesh sequences (walk) in one folder" in said
    said = error(capsys, command(own, "bodies/walk/body"))
    assert "no motion file in this folder, and no body mesh sequence" in said
    assert "found .obj files: 6 (frame_000.obj, ...)" in said
    (own / "empty").mkdir()
    assert "found nothing" in error(capsys, command(own, "empty"))
    assert "is given by the folder that holds it" in error(capsys, command(own, "bodies/walk/body_rest.obj"))
    assert "no such file or folder" in error(capsys, command(own, "nowhere"))
    # A folder "body" of motions is no sequence, and garment frames beside the body do not matter.
    (own / "motions/body").mkdir(parents=True)
    shutil.copy(own / "mixed/hop.npz", own / "motions/body/hop.npz")
    shutil.copy(own / "mixed/hop.npz", own / "motions/skip.npz")
    assert [task.motion.name for task in plan(SimulateConfig(), [own / "motions"])] == ["skip", "body_hop"]


def test_both_kinds_make_one_data_set_and_splits_go_by_name(own):
    np.savez(own / "hop.npz", poses=np.zeros((20, 66)), trans=np.zeros((20, 3)), mocap_framerate=30.0)
    config = SimulateConfig(
        garment=TemplateConfig(
            path=own / "my shirt.obj", up="z", unit="cm", weld=True, name="tee", anyway=True
        ),
        sequences=SequenceFiles(up="z", unit="cm"),
        files={"test": ("reach*",)},
        bodies=({}, {"seed": 3}),
        every_body=True,
    )
    strict = config.model_copy(update={"garment": config.garment.model_copy(update={"anyway": False})})
    with pytest.raises(InputError, match=r"on the body anny3: .* start inside the body"):
        plan(strict, [own / "hop.npz"])
    tasks = plan(config, [own / "bodies/walk", own / "hop.npz", own / "bodies/reach 2"])
    assert {task.name: task.split for task in tasks} == {
        "tee/hop": "train", "tee/hop_anny3": "train", "tee/walk": "train", "tee/reach-2": "test",
    }  # fmt: skip


def test_missing_models_and_templates_are_reported_once_while_planning(tmp_path):
    clips = ({"motion": "walk", "last_seed": 5},)
    with pytest.raises(InputError, match=r"nowhere"):
        plan(SimulateConfig(body={"kind": "smpl", "path": tmp_path / "nowhere"}, clips=clips))
    with pytest.raises(InputError, match=r"none.obj: no such file"):
        plan(SimulateConfig(garment={"kind": "template", "path": tmp_path / "none.obj"}, clips=clips))


def test_a_clip_that_fails_its_gates_is_rejected(files):
    config = SimulateConfig(
        garment=TemplateConfig(path=files / "my shirt.obj", up="z", unit="cm", weld=True),
        gates={"median_stretch": 0.0},
        solver=QUICK,
    )
    sequence = find_sequence(files / "bodies/walk", SequenceFiles(up="z", unit="cm"), 30.0)
    with pytest.raises(Rejected, match="walk: rejected after two attempts: median_stretch"):
        simulate_clip(replace(sequence, frames=2), config)
