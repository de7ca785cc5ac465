"""Alembic and USD files through the commands that read meshes in motion: metres, y up, by the file's own word."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imgtransfer.cli.fuse_files import given_files
from imgtransfer.cli.main import build_parser, main
from imgtransfer.data.store import DataSet
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.checks.motion import check_motion
from imgtransfer.importers.formats.meshes import job_of, jobs
from imgtransfer.importers.job import ImportOptions
from imgtransfer.importers.mesh_files import Source
from imgtransfer.importers.sequences import open_in_metres
from imgtransfer.pipeline.scene import mesh_scene
from imgtransfer.simulation.body_motion.body_sequence import find_sequence
from imgtransfer.simulation.motion_config import SequenceFiles
from imgtransfer.simulation.planning.sources import sorted_sources
from render import InputError, Mesh, Option
from render.mesh.file_axes import FileAxes
from tests.helpers.import_examples import standing_body, vest, write_obj
from tests.helpers.scenes import Written, write_abc, write_usd

BODY = standing_body()
VEST = vest(BODY)
STEP = np.array([0, 0, 0.01])  # metres a frame
FRAMES = 4
SECONDS = np.arange(FRAMES) / 25
CM_Z_UP = Axes("z", "-y", 0.01)


def moving(mesh: Mesh) -> np.ndarray:
    return mesh.vertices + np.arange(FRAMES)[:, None, None] * STEP


def written(mesh: Mesh, axes: Axes) -> Written:
    frames = moving(mesh) @ axes.rotation / axes.scale
    return Written(frames, SECONDS, [3] * len(mesh.faces), mesh.faces.reshape(-1).tolist())


@pytest.fixture(scope="module")
def usd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One stage with both meshes, in centimetres, z up."""
    path = tmp_path_factory.mktemp("usd") / "walk.usdc"
    meshes = {"/world/Vest/shape": written(VEST, CM_Z_UP), "/world/Avatar": written(BODY, CM_Z_UP)}
    write_usd(path, meshes, metres=0.01, up="Z", rate=25)
    return path


def test_one_usd_file_with_garment_and_body_is_a_clip(
    usd: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = ["import", "meshes", str(usd), "--to", str(tmp_path / "set"), "--split", "train"]
    assert main(base) == 2
    assert f"{usd}: 2 meshes (/world/Vest/shape, /world/Avatar); choose one with --garment-object" in (
        capsys.readouterr().err
    )
    assert main([*base, "--garment-object", "Vest", "--body-object=/world/Avatar"]) == 0
    clip = DataSet.open(tmp_path / "set").read("garment/walk")
    assert clip.garment is not None
    np.testing.assert_allclose(clip.garment.vertices, moving(VEST), rtol=0, atol=1e-6)
    np.testing.assert_allclose(clip.body.vertices, moving(BODY), rtol=0, atol=1e-6)
    assert clip.fps == 25
    assert clip.template.faces.tolist() == VEST.faces.tolist()


def test_alembic_files_in_a_clip_s_folder_lie_as_the_flags_say(tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    folder.mkdir()
    for name, mesh in (("garment", VEST), ("body", BODY)):
        write_abc(folder / f"{name}.abc", {f"/{name}": written(mesh, CM_Z_UP)})
    argv = ["import", "meshes", folder, "--to", tmp_path / "set", "--split", "train", "--up=z", "--unit=cm"]
    assert main([str(word) for word in argv]) == 0
    clip = DataSet.open(tmp_path / "set").read("garment/walk")
    np.testing.assert_allclose(clip.body.vertices, moving(BODY), rtol=0, atol=1e-6)


def test_what_is_given_comes_before_what_the_file_says() -> None:
    said = FileAxes("z", 0.01)
    assert (Axes().of_file(said).up, Axes().of_file(said).facing, Axes().of_file(said).scale) == (
        *("z", "-y"),
        0.01,
    )
    given = Axes("y", "z", 0.001, frozenset({"scale"})).of_file(said)
    assert (given.up, given.facing, given.scale) == ("z", "-y", 0.001)
    given = Axes("y", "x", 1.0, frozenset({"up", "facing"})).of_file(said)
    assert (given.up, given.facing, given.scale) == ("y", "x", 0.01)
    assert Axes("z", "-y", 2.0).of_file(None) == Axes("z", "-y", 2.0)


def test_render_simulate_and_fuse_read_the_same(usd: Path) -> None:
    scene = mesh_scene(
        *(usd, usd),
        body_template=usd,
        body=usd,
        garment_object="Vest",
        body_object="Avatar",
    )
    np.testing.assert_allclose(scene.meshes["garment"].vertices(), moving(VEST), rtol=0, atol=1e-6)
    assert sorted_sources([usd]) == ([], [usd])
    body = find_sequence(usd, SequenceFiles(body_object="Avatar"), 25.0)
    assert body.name == "walk"
    np.testing.assert_allclose(body.read().sequence.vertices(), moving(BODY), rtol=0, atol=1e-6)
    argv = ["fuse", "--maps", "m.npz", "--out", "o", "--body", str(usd), "--initial", str(usd)]
    chosen = ["--body-object=Avatar", "--garment-object=Vest"]
    given = given_files(build_parser().parse_args([*argv, *chosen]))
    assert given.body is not None
    assert given.initial is not None
    np.testing.assert_allclose(given.body.vertices(), moving(BODY), rtol=0, atol=1e-6)
    np.testing.assert_allclose(given.initial.vertices(), moving(VEST), rtol=0, atol=1e-6)


def test_an_object_of_a_file_without_names_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x\.obj: body_object='a' does nothing here"):
        open_in_metres(tmp_path / "x.obj", "body", Axes(), which=Option("body_object", "a"))


@pytest.mark.parametrize("command", ["import", "simulate"])
def test_the_summary_says_what_the_file_says_of_itself(
    usd: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = ["--garment-object=Vest", "--body-object=Avatar", "--dry-run"]
    argv = {
        "import": ["import", "meshes", str(usd), "--to", str(tmp_path / "set"), "--split", "train"],
        "simulate": ["simulate", str(usd), "--template", str(usd), "--out", str(tmp_path / "set")],
    }[command]
    assert main([*argv, *chosen]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["units", "cm,", "from", "the", "file"] in lines
    assert ["axes", "z", "up,", "facing", "-y,", "from", "the", "file"] in lines
    assert not [line for line in lines if line[1:2] == ["in"]]


def test_hints_go_from_what_the_file_says(tmp_path: Path) -> None:
    def refused(**said: Any) -> str:
        write_usd(
            tmp_path / "walk.usda", {"/Vest": written(VEST, CM_Z_UP), "/Body": written(BODY, CM_Z_UP)}, **said
        )
        options = ImportOptions(split="train", garment_object="Vest", body_object="Body")
        with pytest.raises(InputError) as caught:
            jobs([tmp_path / "walk.usda"], options)
        (tmp_path / "walk.usda").unlink()
        return str(caught.value)

    assert "its file seems to be in cm: add unit='cm'" in refused(metres=1.0, up="Z")
    assert "stands along z and faces -y, not y and z; add up='z' facing='-y'" in refused(metres=0.01, up="Y")
    write_usd(tmp_path / "vest.usda", {"/Vest": written(VEST, Axes("z", "-y"))}, metres=0.01, up="Z")
    write_usd(tmp_path / "body.usda", {"/Body": written(BODY, CM_Z_UP)}, metres=0.01, up="Z")
    source = Source(tmp_path / "vest.usda", tmp_path / "body.usda", None, None)
    with pytest.raises(InputError, match="in other units than the body's: add garment_unit='m'"):
        job_of("walk", source, ImportOptions(split="train"))


def test_frames_beside_a_rest_mesh_are_told_by_their_own_file_s_word(tmp_path: Path) -> None:
    write_usd(tmp_path / "body.usda", {"/Body": written(BODY, CM_Z_UP)}, metres=0.01, up="Y")
    write_obj(tmp_path / "body_rest.obj", BODY.vertices, BODY.faces)
    opened = open_in_metres(tmp_path / "body.usda", "body", Axes(), tmp_path / "body_rest.obj")
    assert (opened.axes, opened.frames) == (Axes(), Axes("y", "z", 0.01))
    (fault,) = check_motion([opened])
    assert fault.text.endswith("its frames all lie, with z up: add motion_up='z'")


def test_a_unit_that_is_given_makes_another_clip_of_a_file_that_says_its_own(usd: Path) -> None:
    options = ImportOptions(split="train", garment_object="Vest", body_object="Avatar")
    (job,) = jobs([usd], options)
    given = replace(options, axes=Axes(given=frozenset({"scale"})), anyway=True)
    assert job.fingerprint(options) != job.fingerprint(replace(given, anyway=False))
    other = replace(job, files=(Path("walk.obj"),))
    assert other.fingerprint(options) == other.fingerprint(replace(given, anyway=False))


def test_scenes_are_rendered_with_a_template(usd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", str(usd), "--out", "nowhere"]) == 2
    assert "meshes are rendered with --template FILE" in capsys.readouterr().err
