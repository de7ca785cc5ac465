"""Alembic and USD files written by the formats' own libraries, with values worked out by hand."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

import numpy as np
import pytest

import render.extras
from render import InputError, MeshSequence, Option
from render.files.scenes.objects import face_sets, matching
from render.files.scenes.polygons import Polygons
from render.files.scenes.times import frame_times
from render.files.sequence import open_sequence
from render.mesh.file_axes import FileAxes
from tests.helpers.scenes import (
    SQUARE,
    Abc,
    AbcGeom,
    Gf,
    UsdGeom,
    UsdSkel,
    Vt,
    Written,
    imath,
    write_abc,
    write_usd,
)

WRITERS = {".abc": write_abc, ".usdc": write_usd}
SUFFIXES = tuple(WRITERS)
LIFT = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 2, 0, 1]], float)  # 2 up
TURN = np.array([[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], float)  # x to y, y to -x, about z
MIRROR = np.diag([-1.0, 1, 1, 1])
UVS = np.array([[0, 0], [1, 0], [1, 1], [0.25, 0.5]])


def opened(path: Path, name: str | None = None) -> MeshSequence:
    return open_sequence(path, which=Option("garment_object", name))


def written(suffix: str, folder: Path, meshes: dict[str, Written], *more: object) -> Path:
    path = folder / f"scene{suffix}"
    WRITERS[suffix](path, meshes, *more)  # type: ignore[operator]
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_all_parents_place_a_mesh_in_every_frame(suffix: str, tmp_path: Path) -> None:
    # /still lifts by 2; /still/moving turns by a quarter in the second frame; the points move by 1 along z themselves.
    moving = [(0, np.eye(4)), (1 / 24, TURN), (2 / 24, TURN)]
    seconds = [time for time, _ in moving]
    frames = SQUARE + np.array([[[0, 0, 0]], [[0, 0, 1]], [[0, 0, 2]]])
    mesh = Written(frames, seconds, uvs=UVS, uv_corners=(3, 2, 1, 0), sets=(("red", (0,)),))
    path = written(
        suffix, tmp_path, {"/still/moving/shirt": mesh}, {"/still": [(0, LIFT)], "/still/moving": moving}
    )
    sequence = opened(path)
    turned = np.array([[0, 2, 0], [0, 3, 0], [-1, 3, 0], [-1, 2, 0]])
    want = np.stack([SQUARE, turned, turned]) + np.array([[[0, 2, 0]], [[0, 0, 1]], [[0, 0, 2]]])
    np.testing.assert_allclose(sequence.vertices(), want, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.concatenate(list(sequence.parts(2))), want, rtol=0, atol=1e-6)
    assert (sequence.n_frames, sequence.fps) == (3, 24.0)
    assert sequence.faces.tolist() == [[0, 1, 2], [0, 2, 3]]  # counter-clockwise about +z, a fan
    surface = sequence.mesh.surface
    assert surface is not None
    assert surface.uvs is not None
    assert surface.uv_faces is not None
    assert surface.uvs[surface.uv_faces].tolist() == UVS[[[3, 2, 1], [3, 1, 0]]].tolist()
    assert surface.materials == ("red",)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_mirroring_transform_turns_the_triangles_round(suffix: str, tmp_path: Path) -> None:
    path = written(suffix, tmp_path, {"/flip/shirt": Written(SQUARE[None])}, {"/flip": [(0, MIRROR)]})
    mesh = opened(path).mesh
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    assert mesh.vertices[1].tolist() == [-1, 0, 0]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_several_meshes_are_listed_and_chosen_by_name_or_path(suffix: str, tmp_path: Path) -> None:
    square, far = Written(SQUARE[None]), Written(SQUARE[None] + 5)
    path = written(suffix, tmp_path, {"/a/shirt": square, "/b/shirt/shape": far, "/b/body": far})
    with pytest.raises(
        InputError, match=r"3 meshes \(/a/shirt, /b/shirt/shape, /b/body\); choose one with garm"
    ):
        opened(path)
    assert opened(path, "body").mesh.source == f"{path}: /b/body"
    assert opened(path, "/b/shirt").mesh.vertices[0].tolist() == [5, 5, 5]
    with pytest.raises(InputError, match="no such object; it has /a/shirt, /b/shirt/shape, /b/body"):
        opened(path, "shirts")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_some_frames_are_those_of_all(suffix: str, tmp_path: Path) -> None:
    frames = SQUARE + np.arange(7)[:, None, None] * np.array([0, 0, 1.0])
    sequence = opened(written(suffix, tmp_path, {"/shirt": Written(frames, np.arange(7) / 24)}))
    np.testing.assert_array_equal(sequence.frames([1, 4, 6]), sequence.vertices()[[1, 4, 6]])
    np.testing.assert_array_equal(sequence.frame(5), frames[5])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_one_file_a_frame(suffix: str, tmp_path: Path) -> None:
    frames = SQUARE + np.arange(3)[:, None, None] * np.array([0, 0, 1.0])
    for number, frame in enumerate(frames):
        WRITERS[suffix](tmp_path / f"shirt_{number + 8}{suffix}", {"/shirt": Written(frame[None])})
    (tmp_path / "notes.txt").touch()
    for source in (tmp_path, tmp_path / f"shirt_*{suffix}"):
        sequence = opened(source)
        np.testing.assert_array_equal(sequence.vertices(), frames)
        np.testing.assert_array_equal(sequence.frames([1, 2]), frames[1:])
    assert opened(tmp_path, "shirt").frame_names == [f"shirt_{number}{suffix}" for number in (8, 9, 10)]
    WRITERS[suffix](tmp_path / f"shirt_11{suffix}", {"/shirt": Written(frames, (0, 1, 2))})
    with pytest.raises(InputError, match=f"shirt_11{suffix}: 3 frames in a file of several"):
        opened(tmp_path).vertices()
    (tmp_path / "one").mkdir()
    shutil.move(tmp_path / f"shirt_11{suffix}", tmp_path / "one")
    assert opened(tmp_path / "one").n_frames == 3
    if suffix == ".usdc":
        write_usd(tmp_path / "shirt_11.usdc", {"/shirt": Written(frames[:1])}, metres=0.01)
        with pytest.raises(InputError, match=r"shirt_11\.usdc: another unit or axis upwards than in"):
            opened(tmp_path).vertices()
    else:
        np.savetxt(
            tmp_path / "shirt_1.obj",
            [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
            "v %g %g %g",
            footer="f 1 2 3",
            comments="",
        )
        assert opened(tmp_path).frame_names == ["shirt_1.obj"]  # scenes may lie beside their frames


def test_a_name_means_itself_before_what_lies_in_it() -> None:
    names = ["/a/shirt", "/b/shirt/shape", "/shirts"]
    assert matching(names, "shirt") == ["/a/shirt"]
    assert matching(names, "b/shirt") == ["/b/shirt/shape"]
    assert matching(names, "/b") == ["/b/shirt/shape"]
    assert matching(names, "/shirts") == ["/shirts"]
    assert matching(names, "irt") == []


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_uneven_samples_are_resampled_on_straight_lines(
    suffix: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    seconds = (0, 1 / 24, 2 / 24, 4 / 24)
    frames = np.stack([SQUARE + np.array([0, 0, height]) for height in (0, 1, 2, 6)])
    path = written(suffix, tmp_path, {"/shirt": Written(frames, seconds)})
    with caplog.at_level(logging.INFO):
        sequence = opened(path)
    assert (sequence.n_frames, sequence.fps) == (5, 24.0)
    np.testing.assert_allclose(sequence.vertices()[:, 0, 2], [0, 1, 2, 4, 6], rtol=0, atol=1e-6)
    assert "4 samples at uneven times, resampled" in caplog.text


def test_times_rounded_to_milliseconds_are_even() -> None:
    times = frame_times(np.round(np.arange(100) / 30, 3), None, "x")
    assert (len(times.seconds), times.note) == (100, "")
    assert times.fps == pytest.approx(30, rel=1e-3)


def test_times_that_no_clip_has_are_refused() -> None:
    with pytest.raises(InputError, match="x: 1e\\+12 seconds at 24 frames a second"):
        frame_times(np.array([0, 1, 1e12]), 24.0, "x")
    with pytest.raises(InputError, match="not finite"):
        frame_times(np.array([0, np.nan]), 24.0, "x")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_mesh_that_changes_is_refused_with_its_frame(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scene{suffix}"
    frames = np.stack([SQUARE] * 3)
    if suffix == ".abc":
        archive = Abc.OArchive(str(path))
        schema = AbcGeom.OPolyMesh(archive.getTop(), "shirt").getSchema()
        for counts, corners in (([4], [3, 2, 1, 0]), ([4], [3, 2, 1, 0]), ([3], [2, 1, 0])):
            ints = [imath.IntArrayFromBuffer(np.array(values, np.int32)) for values in (corners, counts)]
            points = imath.V3fArrayFromBuffer(SQUARE.astype(np.float32))
            schema.set(AbcGeom.OPolyMeshSchemaSample(points, *ints))
        del schema, archive
    else:
        stage = write_usd(path, {"/shirt": Written(frames, (0, 1 / 24, 2 / 24))})
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/shirt"))
        for time, counts in ((0, [4]), (2, [3])):
            mesh.GetFaceVertexCountsAttr().Set(counts, time)
            mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3][: counts[0]], time)
        stage.Save()
    sequence = opened(path)
    with pytest.raises(InputError, match="/shirt: other polygons in frame 2 than in the first"):
        sequence.vertices()
    np.testing.assert_array_equal(sequence.frames([0, 1]), [SQUARE, SQUARE])  # reads no further
    with pytest.raises(InputError, match="/shirt: other polygons in frame 2 than in the first"):
        sequence.frames([0, 2])


def test_usd_says_its_unit_its_axis_and_its_winding(tmp_path: Path) -> None:
    stage = write_usd(tmp_path / "scene.usda", {"/shirt": Written(SQUARE[None])}, metres=0.01, up="Z")
    UsdGeom.Mesh(stage.GetPrimAtPath("/shirt")).CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    stage.Save()
    mesh = opened(tmp_path / "scene.usda").mesh
    assert mesh.axes == FileAxes("z", 0.01)
    assert mesh.faces.tolist() == [[3, 2, 1], [3, 1, 0]]


def test_usd_shows_instances_and_passes_over_guides_and_what_is_scattered(tmp_path: Path) -> None:
    path = tmp_path / "scene.usda"
    square = Written(SQUARE[None])
    stage = write_usd(path, {"/guide": square, "/scatter/proto/leaf": square, "/hidden": square})
    UsdGeom.Mesh(stage.GetPrimAtPath("/guide")).CreatePurposeAttr(UsdGeom.Tokens.guide)
    UsdGeom.Mesh(stage.GetPrimAtPath("/hidden")).MakeInvisible()
    UsdGeom.PointInstancer.Define(stage, "/scatter")
    write_usd(tmp_path / "model.usda", {"/model/shirt": square})
    placed = UsdGeom.Xform.Define(stage, "/one")
    placed.GetPrim().GetReferences().AddReference(str(tmp_path / "model.usda"), "/model")
    placed.GetPrim().SetInstanceable(True)
    placed.AddTranslateOp().Set((0, 0, 7))
    stage.Save()
    mesh = opened(path).mesh
    assert mesh.source.endswith(": /one/shirt")
    assert mesh.vertices[:, 2].tolist() == [7, 7, 7, 7]
    assert opened(path, "hidden").mesh.vertices[:, 2].tolist() == [0, 0, 0, 0]


def test_usd_skeletons_move_the_points(tmp_path: Path) -> None:
    path = tmp_path / "scene.usda"
    stage = write_usd(path, {"/root/body": Written(SQUARE[None])})
    UsdSkel.Root.Define(stage, "/root")
    skeleton = UsdSkel.Skeleton.Define(stage, "/root/skeleton")
    skeleton.CreateJointsAttr(["hips"])
    skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1)])
    skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1)])
    animation = UsdSkel.Animation.Define(stage, "/root/skeleton/walk")
    animation.CreateJointsAttr(["hips"])
    for time in range(3):
        animation.CreateTranslationsAttr().Set(Vt.Vec3fArray([(0, 0, time)]), time)
    animation.CreateRotationsAttr([Gf.Quatf(1)])
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)]))
    binding = UsdSkel.BindingAPI.Apply(stage.GetPrimAtPath("/root/body"))
    binding.CreateSkeletonRel().SetTargets(["/root/skeleton"])
    binding.CreateJointIndicesPrimvar(True, 1).Set([0])
    binding.CreateJointWeightsPrimvar(True, 1).Set([1.0])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        ["/root/skeleton/walk"]
    )
    stage.Save()
    before = path.read_bytes()
    sequence = opened(path)
    assert sequence.vertices()[:, 0, 2].tolist() == [0, 1, 2]
    assert path.read_bytes() == before


def test_alembic_reads_subdivision_cages_and_hidden_meshes_by_name(tmp_path: Path) -> None:
    path = tmp_path / "scene.abc"
    write_abc(path, {"/shirt": Written(SQUARE[None])}, subdivision=True, hidden=("/shirt",))
    with pytest.raises(InputError, match=r"its meshes are hidden or no final ones \(/shirt\)"):
        opened(path)
    assert opened(path, "shirt").faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_polygons_of_any_size_are_cut_as_fans() -> None:
    polygons = Polygons(np.array([3, 5]), np.array([0, 1, 2, 4, 5, 6, 7, 8]), "x")
    corners, polygon = polygons.triangles(backwards=False)
    assert polygons.vertices[corners].tolist() == [[0, 1, 2], [4, 5, 6], [4, 6, 7], [4, 7, 8]]
    assert polygon.tolist() == [0, 1, 1, 1]
    corners, _ = polygons.triangles(backwards=True)
    assert polygons.vertices[corners].tolist() == [[2, 1, 0], [8, 7, 6], [8, 6, 5], [8, 5, 4]]


def test_polygons_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="x: polygon 1 has 2 corners"):
        Polygons(np.array([3, 2]), np.arange(5), "x")
    with pytest.raises(InputError, match="its polygons count 3 corners, but it has 4"):
        Polygons(np.array([3]), np.arange(4), "x")


def test_materials_are_in_the_order_of_their_first_use() -> None:
    look = face_sets(4, [("blue", np.array([2])), ("red", np.array([0])), ("none", np.array([], int))], "x")
    assert look.materials == ("red", "default", "blue")
    assert look.polygon_materials is not None
    assert look.polygon_materials.tolist() == [0, 1, 2, 1]
    with pytest.raises(InputError, match="face set red names polygons beyond the 4"):
        face_sets(4, [("red", np.array([4]))], "x")


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".usda"])
def test_a_scene_without_meshes_is_refused(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"empty{suffix}"
    (write_abc if suffix == ".abc" else write_usd)(path, {})  # type: ignore[operator]
    with pytest.raises(InputError, match="no mesh in this scene"):
        opened(path)


@pytest.mark.parametrize("suffix", [".abc", ".usd", ".usda", ".usdc", ".usdz"])
def test_other_content_under_the_suffix_is_refused_in_a_line(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"text{suffix}"
    path.write_text("v 0 0 0\n")
    with pytest.raises(InputError, match=r"not an Alembic file|cannot be read, is it damaged\?") as caught:
        opened(path)
    assert "pxrInternal" not in str(caught.value)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_truncated_scene_is_refused_in_a_line(suffix: str, tmp_path: Path) -> None:
    path = written(suffix, tmp_path, {"/shirt": Written(SQUARE[None])})
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(InputError, match="is it damaged"):
        opened(path)


def test_an_alembic_file_that_ends_its_reader_is_refused_in_a_line(tmp_path: Path) -> None:
    """Spoilt words in the headers of its objects: some end the process of alembic3d 1.8.12, none ours."""
    path = written(".abc", tmp_path, {"/shirt": Written(SQUARE[None])})
    content = path.read_bytes()
    said = []
    for start in range(240, 288, 8):
        path.write_bytes(content[:start] + b"\xff" * 8 + content[start + 8 :])
        try:
            opened(path).vertices()
        except InputError as error:
            said.append(str(error))
    assert all(str(path) in message for message in said)
    assert any("The program that reads it ended (SIG" in message for message in said)


def test_an_unfinished_or_old_alembic_file_says_so(tmp_path: Path) -> None:
    path = tmp_path / "scene.abc"
    path.write_bytes(b"Ogawa\x00\x00\x01" + bytes(100))
    with pytest.raises(InputError, match="not written to its end"):
        opened(path)
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(InputError, match="old HDF5 kind; convert it"):
        opened(path)


def test_a_missing_package_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render.extras, "find_spec", lambda package: None)
    for name, extra in (("scene.abc", "alembic"), ("scene.usdz", "usd")):
        (tmp_path / name).write_text("x")
        with pytest.raises(InputError, match=rf"pip install 'imgtransfer\[{extra}\]'"):
            opened(tmp_path / name)
