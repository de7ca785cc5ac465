"""`imgtransfer fuse --maps` with what other programs may have: other starts, pins, garments beneath, soft outlines."""

import json

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from fusion import FusionConfig
from fusion.stages import edge_weights, normal_weights
from imgtransfer.cli.main import main
from imgtransfer.data.clip import load_clip
from imgtransfer.report.fusion_history import TERMS, fusion_table, history_picture
from render import load_maps, load_mesh, save_maps
from tests.helpers.fusion_examples import leaning, tube, write_example

FRAMES = 2
OBJ_FACES = "".join(f"f {a} {b} {c}\n" for a, b, c in tube().faces + 1)


@pytest.fixture
def folder(tmp_path):
    """What `write_example` writes, and initial.npz: the truth, 4 mm off in a smooth way."""
    clip = write_example(tmp_path, FRAMES)
    wave = 0.004 * np.sin(40 * clip.template.vertices[:, [1, 2, 0]])
    np.savez(
        tmp_path / "initial.npz",
        garment_faces=clip.template.faces,
        garment_vertices=clip.garment.vertices + wave.astype(np.float32),
    )
    return tmp_path


def command(folder, *more, out="out"):
    return main(["fuse", "--maps", str(folder / "maps.npz"), "--out", str(folder / out), *map(str, more)])


def change_maps(folder, **changed):
    """Replace arrays of maps.npz; None takes them out."""
    with np.load(folder / "maps.npz") as stored:
        arrays = {**stored, **changed}
    np.savez(folder / "maps.npz", **{name: value for name, value in arrays.items() if value is not None})


def fused(folder, out="out"):
    with np.load(folder / out / "fused.npz") as found:
        return found["garment_vertices"]


def report(folder, out="out"):
    return json.loads((folder / out / "fusion.json").read_text())


def error_mm(vertices, folder):
    truth = load_clip(folder / "clip.npz").garment.vertices
    return 1000 * np.linalg.norm(vertices - truth[: len(vertices)], axis=-1).mean()


def write_obj(path, vertices):
    path.write_text("".join(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in vertices) + OBJ_FACES)


def test_normals_with_an_initial_mesh_need_no_positions(folder):
    change_maps(folder, position=None)
    assert command(folder, "--initial", folder / "initial.npz") == 0
    assert set(report(folder)["terms"]) == {"normal"}
    with np.load(folder / "initial.npz") as stored:
        start = stored["garment_vertices"]
    assert error_mm(fused(folder), folder) < 0.9 * error_mm(start, folder)
    (folder / "frames").mkdir()
    for number, vertices in enumerate(start):
        write_obj(folder / "frames" / f"cloth_{number}.obj", vertices)
    assert command(folder, "--initial", folder / "frames", out="from_meshes") == 0
    np.testing.assert_allclose(fused(folder, "from_meshes"), fused(folder), atol=2e-5)


def test_initial_meshes_replace_the_position_maps(folder):
    assert command(folder, "--initial", folder / "initial.npz", out="with") == 0
    change_maps(folder, position=None)
    assert command(folder, "--initial", folder / "initial.npz", out="without") == 0
    np.testing.assert_array_equal(fused(folder, "with"), fused(folder, "without"))


def test_a_single_frame_takes_mesh_files_for_garment_and_body(folder):
    with np.load(folder / "maps.npz") as stored:
        names = ("position", "normal", "rotation", "translation")
        first = {name: stored[name][:1] for name in names}
    change_maps(folder, **first)
    clip = load_clip(folder / "clip.npz")
    write_obj(folder / "start.obj", clip.garment.vertices[0])
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in clip.body.faces + 1)
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in clip.body.vertices[0])
    (folder / "body.obj").write_text(vertices + faces)
    assert command(folder, "--body", folder / "body.obj", "--initial", folder / "start.obj") == 0
    assert fused(folder).shape[0] == 1
    assert report(folder)["penetration_percent"]["after"] == 0


def test_both_solvers_are_at_hand(folder):
    (folder / "adam.yaml").write_text("solver: adam\nedge_steps: 4\nnormal_steps: 4\n")
    assert command(folder, "--config", folder / "adam.yaml", out="file") == 0
    assert command(folder, "--config", folder / "adam.yaml", "--solver", "local_global", out="option") == 0
    assert command(folder, out="default") == 0
    assert report(folder, "file")["config"]["solver"] == "adam"
    np.testing.assert_array_equal(fused(folder, "option"), fused(folder, "default"))
    assert np.abs(fused(folder, "file") - fused(folder, "default")).max() > 1e-4


def test_pinned_vertices_stay_where_they_are_put(folder):
    truth = load_clip(folder / "clip.npz").garment.vertices
    pins = np.array([0, 5, 40])
    places = truth[:, pins] + np.float32(0.003)
    np.savez(folder / "pins.npz", indices=pins, positions=places)
    assert command(folder, "--pins", folder / "pins.npz") == 0
    np.testing.assert_allclose(fused(folder)[:, pins], places, atol=1e-5)
    # At the same place in both frames, which move: by text they stay where the maps have them.
    (folder / "pins.txt").write_text("0, 5  # a corner\n40\n")
    assert command(folder, "--pins", folder / "pins.txt", out="text") == 0
    assert np.linalg.norm(fused(folder, "text")[:, pins] - truth[:, pins], axis=-1).max() < 0.01


def test_one_place_for_all_frames_is_in_the_world(folder):
    place = load_clip(folder / "clip.npz").garment.vertices[0, [7]]
    np.savez(folder / "pins.npz", indices=np.array([7]), positions=place)
    assert command(folder, "--pins", folder / "pins.npz") == 0
    np.testing.assert_allclose(fused(folder)[:, 7], np.repeat(place, FRAMES, axis=0), atol=1e-5)


def test_the_garment_stays_outside_of_one_worn_beneath(folder):
    clip = load_clip(folder / "clip.npz")
    wide = clip.template.vertices * np.float32(
        [1.03, 1, 1.03]
    )  # 155 mm; the tube is folded down to about 145
    with np.load(folder / "maps.npz") as stored:
        rotation, translation = stored["rotation"], stored["translation"]
    canonical = leaning(wide, FRAMES)
    world = np.einsum("tab,tnb->tna", rotation, canonical) + translation[:, None]
    np.savez(
        folder / "inner.npz",
        garment_faces=clip.template.faces,
        garment_vertices=world.astype(np.float32),
    )
    assert command(folder, "--inner", folder / "inner.npz") == 0
    found = np.einsum("tba,tnb->tna", rotation, fused(folder) - translation[:, None])
    turns = [np.linalg.lstsq(wide, frame, rcond=None)[0] for frame in canonical]
    upright = np.stack([np.linalg.solve(turn.T, frame.T).T for turn, frame in zip(turns, found, strict=True)])
    inner = np.abs(upright[..., 1]) < 0.15  # at the rims the surface beneath ends
    assert (
        np.hypot(upright[..., 0], upright[..., 2])[inner].min() > 0.153
    )  # its faces are chords of the circle


def test_history_is_reported_and_drawn(folder):
    assert command(folder, "--history", "--body", folder / "body.npz") == 0
    found = report(folder)["history"]
    assert set(found) == {"edge", "normal"}
    for terms in found.values():
        assert len({len(values) for values in terms.values()}) == 1
        assert terms["total"][-1] < terms["total"][0]
    picture = (folder / "out" / "history.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert command(folder) == 0  # the same folder again: no picture of another run stays behind
    assert not (folder / "out" / "history.png").exists()


def test_pixels_blurred_with_the_background_can_be_left_out(folder):
    with np.load(folder / "maps.npz") as stored:
        blurred = {name: gaussian_filter(stored[name], (0, 0, 1, 1, 0)) for name in ("position", "normal")}
    change_maps(folder, **blurred)
    assert command(folder, out="plain") == 0
    assert command(folder, "--erode", 3, out="eroded") == 0
    assert error_mm(fused(folder, "eroded"), folder) < 0.5 * error_mm(fused(folder, "plain"), folder)


def test_confidence_in_the_map_file_is_used(folder):
    with np.load(folder / "maps.npz") as stored:
        position, shape = stored["position"].copy(), stored["position"].shape[:-1]
    confidence = np.ones(shape, np.float32)
    wrong = (slice(None), 0, slice(24, 40), slice(24, 40))
    position[wrong] += 0.3  # of the box
    confidence[wrong] = 0
    change_maps(folder, position=position)
    as_they_are = ("--set", "automatic_confidence=false")
    assert command(folder, *as_they_are, out="plain") == 0
    change_maps(folder, confidence=confidence, format_version=np.array(2))
    assert command(folder, *as_they_are, out="weighted") == 0
    assert error_mm(fused(folder, "weighted"), folder) < 0.2 * error_mm(fused(folder, "plain"), folder)
    assert "left_out_percent" not in report(folder, "plain")


def test_a_region_that_lies_elsewhere_is_brought_back_and_said(folder, capsys):
    with np.load(folder / "maps.npz") as stored:
        position, size = stored["position"].copy(), stored["box_hi"] - stored["box_lo"]
    position[:, 0, 24:40, 24:40] += 0.3  # of the box
    change_maps(folder, position=position)
    assert command(folder, "--set", "automatic_confidence=false", out="plain") == 0
    assert command(folder, out="judged") == 0
    assert error_mm(fused(folder, "judged"), folder) < 0.2 * error_mm(fused(folder, "plain"), folder)
    (fault,) = report(folder, "judged")["faults"]
    assert (fault["kind"], fault["view"], fault["frames"]) == ("offset", "front", [0, 1])
    assert (fault["rows"], fault["columns"]) == ([24, 39], [24, 39])
    np.testing.assert_allclose(fault["offset_mm"], 300 * np.linalg.norm(size), rtol=0.05)
    assert f"fault    {fault['text']}\n" in capsys.readouterr().out


def test_a_folder_of_exr_files_will_do(folder):
    save_maps(folder / "exr", load_maps(folder / "maps.npz"))
    assert command(folder, out="npz") == 0
    assert main(["fuse", "--maps", str(folder / "exr"), "--out", str(folder / "from_exr")]) == 0
    np.testing.assert_allclose(fused(folder, "from_exr"), fused(folder, "npz"), atol=1e-4)


def test_texture_coordinates_of_the_template_come_along(folder):
    lines = (folder / "template.obj").read_text().splitlines()
    n = sum(line.startswith("v ") for line in lines)
    corners = [f"{a}/{a}" for a in range(1, n + 1)]
    faces = [
        "f " + " ".join(corners[int(i) - 1] for i in line.split()[1:])
        for line in lines
        if line.startswith("f ")
    ]
    uvs = [f"vt {i / n:.6f} {1 - i / n:.6f}" for i in range(n)]
    text = [line for line in lines if line.startswith("v ")] + uvs + faces
    (folder / "template.obj").write_text("\n".join(text) + "\n")
    assert command(folder, "--template", folder / "template.obj", "--meshes", "obj") == 0
    written = folder / "out" / "meshes" / "frame_0001.obj"
    assert sum(line.startswith("vt ") for line in written.read_text().splitlines()) == n
    np.testing.assert_allclose(load_mesh(written).vertices, fused(folder)[1], atol=1e-6)


def test_the_report_is_told_in_a_few_lines(folder, capsys):
    assert command(folder, "--body", folder / "body.npz") == 0
    printed = capsys.readouterr().out
    for text in (
        "edge lengths",
        "normals",
        "depth in the obstacle",
        "unseen",
        "% after the clean-up",
        "seconds",
    ):
        assert text in printed
    assert printed.splitlines()[-1].startswith(f"results  {folder / 'out'}: ")
    assert fusion_table(report(folder)) in printed


def test_every_term_has_a_name_to_read():
    config = FusionConfig()
    assert set(TERMS) == set(edge_weights(config)) | set(normal_weights(config))


def test_the_picture_has_a_panel_a_stage():
    terms = {"total": [3.0, 1.0, 0.5], "edge_length_m2": [1e-5, 1e-6, 1e-6]}
    both = history_picture({"edge": terms, "normal": terms}, FusionConfig())
    one = history_picture({"edge": terms}, FusionConfig())
    assert both.dtype == np.uint8
    assert both.shape[1] > 1.9 * one.shape[1]
    assert (one < 128).any()


MISTAKES = {
    "normals alone": (lambda f: change_maps(f, position=None), (), "give initial vertices"),
    "initial of one frame": (
        lambda f: write_obj(f / "one.obj", tube().vertices),
        ("--initial", "one.obj"),
        "--initial: 2 frames are wanted, as the maps have 2; found 1",
    ),
    "initial and nothing else": (
        lambda f: change_maps(f, normal=None),
        ("--initial", "initial.npz"),
        "nothing to fuse",
    ),
    "inner without faces": (
        lambda f: np.savez(f / "u.npz", garment_vertices=np.zeros((2, 3, 3))),
        ("--inner", "u.npz"),
        "u.npz: lacks garment_faces",
    ),
    "pin out of range": (
        lambda f: (f / "p.txt").write_text("544"),
        ("--pins", "p.txt"),
        "p.txt: vertex 544 is wanted, but the garment has 0..543",
    ),
    "erode below 0": (lambda f: None, ("--erode", "-1"), "--erode -1"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line(folder, capsys, monkeypatch, name):
    spoil, arguments, message = MISTAKES[name]
    spoil(folder)
    monkeypatch.chdir(folder)
    assert command(folder, *arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (folder / "out").exists()
