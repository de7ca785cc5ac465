"""One reader for every command: whatever the files, the same frames in the same order, in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imgtransfer.cli.fuse_files import given_files
from imgtransfer.cli.main import build_parser
from imgtransfer.data.clip import save_clip
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.formats.meshes import jobs
from imgtransfer.importers.job import ImportOptions
from imgtransfer.importers.sequences import open_in_metres, weld_sequence
from imgtransfer.pipeline.scene import mesh_scene
from imgtransfer.simulation.body_motion.body_sequence import find_sequence
from imgtransfer.simulation.config import SequenceFiles
from render import InputError, Mesh, MeshSequence, load_mesh
from tests.helpers import synthetic
from tests.helpers.import_examples import write_mdd, write_obj, write_pc2
from tests.helpers.synthetic import tube_clip

TUBE, FACES = synthetic.tube(0.2, 1.0, 5, 6, closed=False)
BODY = np.round(TUBE * 64) / 64  # numbers that text and float32 hold exactly
SHIRT = np.round(TUBE * [1.2, 0.5, 1.2] * 64) / 64
METRES = Axes()
STEP = np.array([0.0, 0, 1 / 64])  # metres a frame


def write_frames(folder: Path, name: str, rest: np.ndarray, numbers: list[int]) -> Path:
    for number in numbers:
        write_obj(folder / f"{name}_{number}.obj", rest + number * STEP, FACES)
    return folder


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Garment and body in frames 1 to 12, whose names sort otherwise as text, and both at rest."""
    for name, rest in (("garment", SHIRT), ("body", BODY)):
        write_frames(tmp_path / f"walk/{name}", name, rest, list(range(1, 13)))
    write_obj(tmp_path / "walk/template.obj", SHIRT, FACES)
    write_obj(tmp_path / "walk/body_rest.obj", BODY, FACES)
    return tmp_path / "walk"


def fuse_arguments(*words: object) -> object:
    return build_parser().parse_args(
        ["fuse", "--maps", "maps.npz", "--out", "out", *(str(word) for word in words)]
    )


def test_every_command_reads_a_folder_in_the_same_order(frames: Path) -> None:
    wanted = np.float32(BODY + np.arange(1, 13)[:, None, None] * STEP)
    given = given_files(fuse_arguments("--body", frames / "body"))  # type: ignore[arg-type]
    scene = mesh_scene(
        frames / "template.obj",
        frames / "garment",
        body_template=frames / "body_rest.obj",
        body=frames / "body",
    )
    (job,) = jobs([frames], ImportOptions(split="train", anyway=True))
    simulated = find_sequence(frames, SequenceFiles(), 30.0).read().sequence
    assert given.body is not None
    for found in (
        given.body.vertices(),
        scene.meshes["body"].vertices(),
        job.read().body.vertices,
        simulated.vertices(),
    ):
        np.testing.assert_array_equal(found, wanted)


def test_every_command_names_the_first_frame_that_is_missing(frames: Path) -> None:
    for kind in ("garment", "body"):
        (frames / kind / f"{kind}_10.obj").unlink()
    message = r"frames are missing between \w+_1\.obj and \w+_12\.obj: 10 \(11 files found\)"
    for read in (
        lambda: given_files(fuse_arguments("--body", frames / "body")),  # type: ignore[arg-type]
        lambda: given_files(fuse_arguments("--initial", frames / "garment")),  # type: ignore[arg-type]
        lambda: given_files(fuse_arguments("--inner", frames / "garment")),  # type: ignore[arg-type]
        lambda: mesh_scene(frames / "template.obj", frames / "garment"),
        lambda: jobs([frames], ImportOptions(split="train")),
        lambda: find_sequence(frames, SequenceFiles(), 30.0),
    ):
        with pytest.raises(InputError, match=message):
            read()


@pytest.mark.parametrize("kind", ["body", "garment"])
def test_whatever_the_files_the_frames_are_the_same(frames: Path, tmp_path: Path, kind: str) -> None:
    rest = BODY if kind == "body" else SHIRT
    wanted = np.float32(rest + np.arange(1, 13)[:, None, None] * STEP)
    np.savez(tmp_path / "arrays.npz", **{f"{kind}_faces": FACES, f"{kind}_vertices": wanted})
    write_pc2(frames / "cache.pc2", wanted)
    write_obj(frames / "cache.obj", rest, FACES)
    beside = write_mdd(frames / f"{kind}.mdd", wanted, 30.0)  # whose mesh is called as the rest pose is
    for path in (
        frames / kind,
        frames / kind / f"{kind}_*.obj",
        frames / kind / f"{kind}_*[0-9].obj",
        frames / "cache.pc2",
        beside,
        tmp_path / "arrays.npz",
    ):
        found = open_in_metres(path, kind, METRES).sequence  # type: ignore[arg-type]
        np.testing.assert_array_equal(found.vertices(), wanted)
        np.testing.assert_array_equal(found.faces, FACES)
    one = open_in_metres(frames / kind / f"{kind}_3.obj", kind, METRES).sequence  # type: ignore[arg-type]
    np.testing.assert_array_equal(one.vertices(), wanted[2:3])


def test_every_sequence_option_of_fuse_takes_patterns_and_caches(frames: Path) -> None:
    write_pc2(frames / "inner.pc2", np.float32(SHIRT)[None])
    given = given_files(  # type: ignore[arg-type]
        fuse_arguments(
            "--body",
            frames / "body/body_?.obj",
            "--initial",
            frames / "garment/*.obj",
            "--inner",
            frames / "inner.pc2",
        )
    )
    assert given.body is not None
    assert given.initial is not None
    assert given.inner is not None
    assert (given.body.n_frames, given.initial.n_frames, given.inner.n_frames) == (9, 12, 1)
    assert given.clip is None
    np.testing.assert_array_equal(given.inner.faces, FACES)


def test_clips_are_sequences_of_both_their_meshes(tmp_path: Path) -> None:
    clip = tube_clip(5)
    save_clip(tmp_path / "clip.npz", clip)
    given = given_files(  # type: ignore[arg-type]
        fuse_arguments("--body", tmp_path / "clip.npz", "--initial", tmp_path / "clip.npz")
    )
    assert given.body is not None
    assert given.initial is not None
    assert given.clip is not None
    assert given.clip.n_frames == 5
    np.testing.assert_array_equal(given.body.vertices(), clip.body.vertices)
    np.testing.assert_array_equal(np.concatenate(list(given.initial.parts(2))), clip.garment.vertices)
    np.testing.assert_array_equal(given.body.mesh.vertices, clip.body.rest)
    assert clip.garment is not None
    scene = mesh_scene(
        write_obj(tmp_path / "t.obj", clip.template.vertices, clip.template.faces), tmp_path / "clip.npz"
    )
    np.testing.assert_array_equal(scene.meshes["garment"].vertices(), clip.garment.vertices)


def test_arrays_that_are_missing_are_named(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    with pytest.raises(
        InputError, match="no such file; an npz with body_faces and body_vertices, or mesh files"
    ):
        open_in_metres(path, "body", METRES)
    np.savez(path, body_faces=FACES, body_vertices=BODY)
    with pytest.raises(
        InputError, match=r"body_vertices must have shape \(frames, vertices, 3\), found \(30, 3\)"
    ):
        open_in_metres(path, "body", METRES)
    with pytest.raises(
        InputError, match="lacks garment_faces and garment_vertices; a mesh in motion needs both"
    ):
        open_in_metres(path, "garment", METRES)
    clip = tube_clip(2)
    arrays = {"garment_faces": clip.template.faces, "template_vertices": clip.template.vertices}
    arrays |= {
        "body_rest": clip.body.rest,
        "body_faces": clip.body.faces,
        "body_vertices": clip.body.vertices,
    }
    np.savez(path, **arrays, fps=30.0)
    with pytest.raises(InputError, match="this clip has no garment_vertices, only a body"):
        open_in_metres(path, "garment", METRES)


def test_axes_and_units_are_those_of_mesh_files_only(frames: Path, tmp_path: Path) -> None:
    axes = Axes("z", "-y", 0.01)
    found = open_in_metres(frames / "body", "body", axes, frames / "body_rest.obj").sequence
    plain = open_in_metres(frames / "body", "body", METRES).sequence.vertices()
    np.testing.assert_array_equal(found.vertices(), axes.apply(plain))
    np.testing.assert_array_equal(np.concatenate(list(found.parts(5))), axes.apply(plain))
    np.testing.assert_array_equal(
        found.mesh.vertices, axes.apply(load_mesh(frames / "body_rest.obj").vertices)
    )
    np.savez(tmp_path / "m.npz", body_faces=FACES, body_vertices=plain)
    np.testing.assert_array_equal(open_in_metres(tmp_path / "m.npz", "body", axes).sequence.vertices(), plain)


def test_a_vertex_far_away_is_named_with_its_frame(frames: Path) -> None:
    write_obj(frames / "body/body_11.obj", BODY + np.array([3e4, 0, 0]), FACES)
    found = open_in_metres(frames / "body", "body", METRES).sequence
    with pytest.raises(InputError, match=r"body: frame 10, vertex 0 is .* beyond ±10000 m"):
        list(found.parts(3))


def test_a_rest_pose_of_another_mesh_is_refused(frames: Path, tmp_path: Path) -> None:
    other = write_obj(tmp_path / "other.obj", BODY, FACES[::-1])
    with pytest.raises(InputError, match=r"but the template .*other\.obj has 30 .* the body's own mesh"):
        open_in_metres(frames / "body", "body", METRES, other)


def test_a_cache_without_its_mesh_says_where_to_put_it(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for kind, name in (("body", "body_rest"), ("garment", "template")):
        path = write_pc2(tmp_path / f"in/{kind}.pc2", np.float32(BODY)[None])
        with pytest.raises(
            InputError, match=rf"{kind}\.pc2: a point cache has no triangles; put .* as {name}\.obj"
        ):
            open_in_metres(path, kind, METRES)  # type: ignore[arg-type]


def test_welded_parts_make_up_the_welded_whole() -> None:
    soup = Mesh(BODY[FACES].reshape(-1, 3), np.arange(3 * len(FACES)).reshape(-1, 3))
    moved = np.float32(soup.vertices + np.arange(4)[:, None, None] * STEP)
    welded = weld_sequence(MeshSequence.of_array(soup, moved, source="soup"))
    assert len(welded.mesh.vertices) == 30
    np.testing.assert_array_equal(np.concatenate(list(welded.parts(3))), welded.vertices())
    moved[3, 0] += 1
    with pytest.raises(InputError, match=r"soup: vertices .* in frame 3; this is no seam"):
        list(welded.parts(2))


def test_the_mesh_of_a_cache_counts_among_the_files_of_a_clip(frames: Path) -> None:
    (frames / "body_rest.obj").unlink()
    wanted = np.float32(BODY + np.arange(1, 13)[:, None, None] * STEP)
    write_pc2(frames / "body.pc2", wanted)
    for file in (frames / "body").iterdir():
        file.unlink()
    (frames / "body").rmdir()
    beside = write_obj(frames / "body.obj", BODY, FACES)
    sequence = find_sequence(frames, SequenceFiles(), 30.0)
    assert sequence.rest == beside
    (job,) = jobs([frames], ImportOptions(split="train", anyway=True))
    assert beside in job.files
    np.testing.assert_array_equal(job.read().body.vertices, wanted)
    write_obj(beside, BODY * 1.25, FACES)
    assert find_sequence(frames, SequenceFiles(), 30.0).content != sequence.content


def test_a_start_for_the_fusion_in_a_cache_moves_the_template(frames: Path, tmp_path: Path) -> None:
    write_pc2(tmp_path / "start.pc2", np.float32(SHIRT)[None])
    given = given_files(
        fuse_arguments("--initial", tmp_path / "start.pc2", "--template", frames / "template.obj")  # type: ignore[arg-type]
    )
    assert given.initial is not None
    np.testing.assert_array_equal(given.initial.faces, FACES)


def test_frames_named_in_capitals_are_found_in_a_clips_folder(frames: Path) -> None:
    for file in sorted((frames / "body").iterdir()):
        file.rename(frames / file.name.upper().replace("BODY", "body"))
    (frames / "body").rmdir()
    sequence = find_sequence(frames, SequenceFiles(), 30.0)
    np.testing.assert_array_equal(sequence.read().sequence.vertices()[9], np.float32(BODY + 10 * STEP))


@pytest.mark.parametrize("name", ["rest.obj", "body_rest.obj", "REST_POSE.obj"])
def test_a_rest_pose_among_the_frames_is_the_rest_pose(frames: Path, name: str) -> None:
    (frames / "body_rest.obj").unlink()
    rest = write_obj(frames / "body" / name, BODY * 1.25, FACES)
    sequence = find_sequence(frames, SequenceFiles(), 30.0)
    assert sequence.rest == rest
    opened = sequence.open().sequence
    assert opened.n_frames == 12
    np.testing.assert_array_equal(opened.mesh.vertices, BODY * 1.25)
    (job,) = jobs([frames], ImportOptions(split="train", anyway=True))
    np.testing.assert_array_equal(job.read().body.rest, np.float32(BODY * 1.25))
    write_obj(frames / "body/template.obj", BODY, FACES)
    with pytest.raises(InputError, match="are both called as a rest pose; keep one"):
        find_sequence(frames, SequenceFiles(), 30.0)


@pytest.mark.parametrize(
    "name", ["body ({}).obj", "body[{}].obj", "body_{}.Obj", "body_-{}.obj", "body{}_v2.OBJ"]
)
def test_frames_beside_each_other_in_a_clips_folder_however_they_are_named(frames: Path, name: str) -> None:
    for file in (frames / "body").iterdir():
        file.rename(frames / name.format(file.stem.partition("_")[2]))
    (frames / "body").rmdir()
    found = find_sequence(frames, SequenceFiles(), 30.0).read().sequence.vertices()
    order = np.arange(12, 0, -1) if "-" in name else np.arange(1, 13)
    np.testing.assert_array_equal(found, np.float32(BODY + order[:, None, None] * STEP))


def test_one_frame_is_read_without_those_before_it(frames: Path) -> None:
    wanted = np.float32(BODY + np.arange(1, 13)[:, None, None] * STEP)
    write_pc2(frames / "cache.pc2", wanted)
    write_obj(frames / "cache.obj", BODY, FACES)
    axes = Axes("z", "-y", 0.5)
    (frames / "body/body_2.obj").write_text("broken")
    for path in (frames / "body", frames / "cache.pc2"):
        found = open_in_metres(path, "body", axes).sequence
        for number in (0, 7, 11):
            np.testing.assert_array_equal(found.frame(number), axes.apply(wanted[number]))
            np.testing.assert_array_equal(weld_sequence(found).frame(number), axes.apply(wanted[number]))
    np.savez(frames / "m.npz", body_faces=FACES, body_vertices=wanted)  # which is read from its start
    np.testing.assert_array_equal(open_in_metres(frames / "m.npz", "body", axes).sequence.frame(7), wanted[7])
