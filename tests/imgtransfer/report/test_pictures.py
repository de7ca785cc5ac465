"""Pictures and the page that holds them."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from imgtransfer.data.clip import Clip
from imgtransfer.evaluation.metrics import METRICS
from imgtransfer.report.html import Picture, Section, write_report
from imgtransfer.report.logs import read_curves
from imgtransfer.report.pictures import (
    CLOTH,
    SKIN,
    ShadedMesh,
    curve_picture,
    error_picture,
    mesh_picture,
    mesh_pictures,
    picture_camera,
)
from render import InputError
from render.pictures import heat_colours

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])


def hue(colour: np.ndarray) -> np.ndarray:
    return colour / np.linalg.norm(colour)


def test_a_square_facing_the_viewer_keeps_its_colour_and_the_rest_is_white() -> None:
    camera = picture_camera(SQUARE, turn_degrees=0, size=(60, 40))
    picture = mesh_picture([ShadedMesh(SQUARE, SQUARE_FACES, (0.8, 0.2, 0.1))], camera, backend="numpy")
    assert picture.shape == (60, 40, 3)
    assert picture.dtype == np.uint8
    assert (picture[0, 0] == 255).all()
    assert hue(picture[30, 20].astype(float)) == pytest.approx(hue(np.array([0.8, 0.2, 0.1])), abs=0.05)


def test_the_nearer_surface_hides_the_other() -> None:
    near = ShadedMesh(SQUARE * 0.5 + [0, 0, 1], SQUARE_FACES, (0.1, 0.9, 0.1))
    far = ShadedMesh(SQUARE, SQUARE_FACES, (0.9, 0.1, 0.1))
    for view, seen in (("front", 1), ("back", 0)):
        camera = picture_camera(np.concatenate([near.vertices, far.vertices]), view=view, size=(60, 60))
        picture = mesh_picture([far, near], camera, backend="numpy")
        assert picture[30, 30].argmax() == seen


def test_turning_shows_the_other_side_of_a_corner() -> None:
    points = np.array([[0.0, -1, 0], [0, 1, 0], [0, 1, -1], [0, -1, -1], [0, -1, 1], [0, 1, 1]])
    wall = ShadedMesh(points, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 1], [4, 1, 0]]), (0.9, 0.1, 0.1))
    edge_on, turned = (
        mesh_picture([wall], picture_camera(points, turn_degrees=turn, size=(60, 60)), backend="numpy")
        for turn in (2.0, 45.0)
    )
    assert (turned < 255).any(axis=-1).sum() > 4 * (edge_on < 255).any(axis=-1).sum()


def test_errors_become_colours_with_a_bar_below() -> None:
    camera = picture_camera(SQUARE, turn_degrees=0, size=(60, 80))
    for distance, level in ((0.0, 0.0), (40.0, 1.0), (90.0, 1.0)):
        picture = error_picture(
            ShadedMesh(SQUARE, SQUARE_FACES),
            np.full(4, distance),
            limit_mm=40,
            camera=camera,
            backend="numpy",
        )
        assert picture.shape == (104, 80, 3)
        wanted = heat_colours(np.array(level)).astype(float)
        assert hue(picture[30, 40].astype(float)) == pytest.approx(hue(wanted), abs=0.08)


def test_a_clip_in_a_picture(tube_clip: Clip) -> None:
    body = ShadedMesh(tube_clip.body.vertices[3], tube_clip.body.faces, SKIN)
    garment = ShadedMesh(tube_clip.garment.vertices[3], tube_clip.template.faces)
    picture = mesh_picture([body, garment])
    bluer = picture[..., 2].astype(int) - picture[..., 0]
    assert CLOTH[2] > CLOTH[0]
    assert SKIN[0] > SKIN[2]
    assert (bluer > 20).mean() > 0.03  # cloth is seen
    assert (bluer < -10).mean() > 0.01  # and skin above and below it


@pytest.mark.parametrize("backend", ["egl", pytest.param("osmesa", marks=pytest.mark.osmesa)])
def test_opengl_draws_what_numpy_draws(tube_clip: Clip, backend: str) -> None:
    camera = picture_camera(tube_clip.body.vertices, size=(120, 80))
    scenes = [
        [
            ShadedMesh(tube_clip.body.vertices[t], tube_clip.body.faces, SKIN),
            ShadedMesh(tube_clip.garment.vertices[t], tube_clip.template.faces),
        ]
        for t in (0, 3)
    ]
    drawn, wanted = (mesh_pictures(scenes, camera, backend=one) for one in (backend, "numpy"))
    for picture, reference in zip(drawn, wanted, strict=True):
        difference = np.abs(picture.astype(int) - reference).max(-1)
        assert difference.mean() < 0.1
        assert (difference > 3).mean() < 0.002  # pixels that an edge runs through
    assert (drawn[0] != drawn[1]).any()


def test_what_lies_far_behind_is_not_cut_off() -> None:
    camera = picture_camera(SQUARE, turn_degrees=0, size=(60, 40))
    behind = ShadedMesh(SQUARE - [0, 0, 60], SQUARE_FACES, (0.1, 0.9, 0.1))
    for backend in ("auto", "numpy"):
        assert mesh_picture([behind], camera, backend=backend)[30, 20].argmax() == 1


def test_curves(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text('{"step": 0, "mm": 9.0}\n{"step": 1, "loss": 2.0}\n{"step": 2, "loss": 4.0, "mm": 3.0}\n')
    curves = read_curves(log, {"loss": "Loss", "mm": "Error", "absent": "Absent"})
    assert curves == {"Loss": ([1.0, 2.0], [2.0, 4.0]), "Error": ([0.0, 2.0], [9.0, 3.0])}
    assert read_curves(log, {"loss": "Loss"}, points=1) == {"Loss": ([1.5], [3.0])}
    picture = curve_picture(curves, title="Training", size=(200, 300))
    assert picture.shape == (200, 300, 3)
    assert (picture < 100).any()
    assert (curve_picture({}, size=(200, 300)) == 255).any()


def test_a_log_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "log.jsonl").write_text('{"loss": 1}\n')
    with pytest.raises(InputError, match="not a training log"):
        read_curves(tmp_path / "log.jsonl", {})
    with pytest.raises(InputError, match="no such file"):
        read_curves(tmp_path / "absent.jsonl", {})


def test_the_page_holds_all_and_loads_nothing(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 255, (5, 7, 3), dtype=np.uint8)
    good, bad = dict.fromkeys(METRICS, 1.0), dict.fromkeys(METRICS, 2.0)
    path = write_report(
        tmp_path / "out",
        "A & B",
        {"lbs": bad, "fused": good},
        [Section("Maps", "One.\n\nTwo <b>.", [Picture(image)])],
    )
    page = path.read_text(encoding="utf-8")
    assert path == tmp_path / "out/report.html"
    assert "<h1>A &amp; B</h1>" in page
    assert "<p>One.</p><p>Two &lt;b&gt;.</p>" in page
    assert page.count('<td class="best">') == len(METRICS)
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert len(sources) == 1
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "http" not in page
    png = np.frombuffer(base64.b64decode(sources[0].partition(",")[2]), np.uint8)
    np.testing.assert_array_equal(cv2.imdecode(png, cv2.IMREAD_COLOR)[..., ::-1], image)


def test_a_page_without_metrics_has_no_table(tmp_path: Path) -> None:
    assert "<table" not in write_report(tmp_path, "T", {}, []).read_text()
