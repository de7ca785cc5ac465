"""`imgtransfer dress`: what it is told, and the file that comes of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.bodies.config import AnnyConfig, SmplConfig
from imgtransfer.cli.dress_settings import body_settings
from imgtransfer.cli.main import main
from imgtransfer.data.clip import load_clip
from imgtransfer.dressing.hanging import hanging_garment
from imgtransfer.garments.config import TShirtConfig
from render import InputError
from render.files.mesh_files import load_mesh
from tests.helpers.amass_files import write_amass
from tests.helpers.import_examples import standing_body, vest, write_obj


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_amass(tmp_path / "walk.npz")
    return tmp_path


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, AnnyConfig()),
        ("seed:7", AnnyConfig(seed=7)),
        ("weight=0.8", AnnyConfig(shape={"weight": 0.8})),
        ("weight=.8, age=1", AnnyConfig(shape={"weight": 0.8, "age": 1.0})),
    ],
)
def test_words_about_the_body(text: str | None, expected: AnnyConfig) -> None:
    assert body_settings(text, None) == expected


def test_words_about_a_smpl_body() -> None:
    models = Path("models")
    assert body_settings(None, models) == SmplConfig(path=models)
    asked = body_settings("gender=female,beta2=-1.5,beta0=2", models)
    assert asked == SmplConfig(path=models, gender="female", betas=(2.0, 0.0, -1.5))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("wieght=0.8", "did you mean weight"),
        ("weight=2", "weight: a number from 0 to 1 is wanted"),
        ("weight=heavy", "heavy is no number"),
        ("weight=", "nothing is no number"),
        ("weight=nan", "nan is no number"),
        ("weight", "names and values"),
        ("weight=1,weight=0", "each name once"),
        ("seed:x", "names and values"),
        ("seed:-1", "names and values"),
        ("", "names and values"),
    ],
)
def test_words_that_no_body_has(text: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(f"--body {text}")) as error:
        body_settings(text, None)
    assert said in str(error.value)


def test_a_motion_and_a_garment_s_name_give_the_dressed_figure(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The body moves as the motion says, the garment hangs on it, outside, and a second run replaces the file."""
    words = ["dress", "walk.npz", "--garment", "tshirt", "--frames", "4:6", "--out", "dressed.npz"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "figure   tshirt/walk: 2 frames at 30 a second" in out
    assert re.search(
        r"crossing \d+\.\d\d % of the garment's edges the body, \d+\.\d\d % the garment itself", out
    )
    assert re.search(r"^written  dressed\.npz, 0\.\d MB$", out, re.MULTILINE)
    clip = load_clip(folder / "dressed.npz")
    assert clip.garment is not None
    assert clip.skeleton.trans is not None
    assert clip.skeleton.joints_rest is not None
    # The pelvis walks 1 m a second along z at a height of 0.9 m, as in the file.
    root = clip.skeleton.trans + clip.skeleton.joints_rest[0]
    assert np.diff(root[:, 2]) == pytest.approx(1 / 30, abs=1e-4)
    assert root[:, 1] == pytest.approx(0.9, abs=0.15)
    # The trunk stands as at rest, and only the arms are raised from there, which draws the shirt up.
    hangs = hanging_garment(TShirtConfig(detail="small"), AnnyConfig()).vertices
    away = clip.garment.vertices[0] - clip.skeleton.trans[0] - hangs
    assert np.median(np.linalg.norm(away, axis=1)) < 0.1
    (folder / "dressed.npz").write_text("an earlier file")
    assert main(words) == 0
    assert load_clip(folder / "dressed.npz").n_frames == 2
    assert sorted(path.name for path in folder.iterdir()) == ["dressed.npz", "walk.npz"]


def test_a_garment_of_the_user_s_keeps_its_vertices(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = vest(standing_body())
    write_obj(folder / "vest.obj", 100 * mesh.vertices, mesh.faces)
    words = ["dress", "walk.npz", "--garment", "vest.obj", "--frames", "0:1", "--out", "meshes"]
    assert main(words) == 2
    assert "--garment-unit=cm" in capsys.readouterr().err
    assert main([*words, "--garment-unit=cm"]) == 0
    files = sorted(path.name for path in (folder / "meshes").iterdir())
    assert files == ["body_0000.obj", "body_rest.obj", "garment_0000.obj", "template.obj"]
    np.testing.assert_array_equal(load_mesh(folder / "meshes/garment_0000.obj").faces, mesh.faces)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "--garment shirt",
            "--garment shirt: no garment of the project's; tshirt, dress, trousers, skirt or",
        ),
        ("--garment none.obj", "--garment none.obj: no such file"),
        ("--garment tshirt --weld", "--weld goes with --garment FILE or a moving body"),
        ("--garment tshirt --garment-unit cm", "--garment-unit goes with --garment FILE"),
        ("--garment tshirt --body-rest a.obj", "--body-rest goes with a moving body"),
        ("--garment tshirt --joints a.yaml", "a.yaml: no such file"),
        ("--garment tshirt --pinned", "--pinned goes with"),
        ("--garment tshirt --fabric silk", "--fabric goes with --simulate"),
        ("--garment tshirt --simulate --model a", "--model goes with networks, not with --simulate"),
        ("--garment tshirt --simulate --self-contact", "--self-contact goes with networks, not with"),
        ("--garment tshirt --fps 0", "--fps 0: "),
        ("--garment tshirt --fps nan", "--fps nan: "),
        ("--garment tshirt --arms-out 99", "--arms-out 99: arms_out"),
        ("--garment tshirt --frames 40:50", "--frames=40:50: walk.npz has the frames 0 to 30"),
        ("--garment tshirt --model none", "none: no such file"),
        ("--garment tshirt --smpl none", "no SMPL model of a neutral body at none"),
        ("--garment tshirt --frames 3 --simulate", "two frames or more are wanted"),
    ],
)
def test_what_does_not_go_together_is_said_in_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], words: str, said: str
) -> None:
    assert main(["dress", "walk.npz", *words.split(), "--out", "x.glb"]) == 2
    error = capsys.readouterr().err.splitlines()
    assert said in error[-1]
    assert error[-1].startswith("imgtransfer: error: ")
    assert not (folder / "x.glb").exists()


@pytest.mark.parametrize(
    ("out", "said"), [("x.fbx", "'.fbx'"), (".", "exists already"), ("x.abc/", "is a folder")]
)
def test_where_nothing_can_be_written_is_said_before_any_work(
    folder: Path, capsys: pytest.CaptureFixture[str], out: str, said: str
) -> None:
    (folder / "x.abc").mkdir()
    assert main(["dress", "none.npz", "--garment", "tshirt", "--out", out]) == 2
    assert said in capsys.readouterr().err


def test_a_moving_body_needs_a_garment_of_its_own(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body = standing_body()
    for frame in range(2):
        write_obj(folder / f"moving/body_{frame:04d}.obj", body.vertices, body.faces)
    for words in ([], ["--simulate"]):
        assert main(["dress", "moving", "--garment", "skirt", *words, "--out", "x.npz"]) == 2
        assert "moving: a skirt cannot be cut for a moving body" in capsys.readouterr().err
    for option in (["--body", "seed:1"], ["--arms-out", "3"]):
        assert main(["dress", "moving", "--garment", "skirt", *option, "--out", "x.npz"]) == 2
        assert f"{option[0]} goes with a motion file" in capsys.readouterr().err
    mesh = vest(body)
    write_obj(folder / "vest.obj", mesh.vertices, mesh.faces)
    assert main(["dress", "moving", "--garment", "vest.obj", "--fps", "24", "--out", "x.npz"]) == 0
    clip = load_clip(folder / "x.npz")
    assert (clip.n_frames, clip.fps, len(clip.template.vertices)) == (2, 24.0, len(mesh.vertices))


@pytest.mark.long
def test_the_simulator_in_place_of_the_network(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The body stands where the network's does, and only the garment differs."""
    words = ["dress", "walk.npz", "--garment", "tshirt", "--frames", "4:6"]
    assert main([*words, "--simulate", "--out", "simulated.npz"]) == 0
    assert "crossing 0." in capsys.readouterr().out
    assert main([*words, "--out", "predicted.npz"]) == 0
    simulated, predicted = load_clip(folder / "simulated.npz"), load_clip(folder / "predicted.npz")
    assert simulated.garment is not None
    assert predicted.garment is not None
    np.testing.assert_allclose(simulated.body.vertices, predicted.body.vertices, atol=2e-5)
    np.testing.assert_array_equal(simulated.template.vertices, predicted.template.vertices)
    away = np.linalg.norm(simulated.garment.vertices - predicted.garment.vertices, axis=-1)
    assert 0 < np.median(away) < 0.05
