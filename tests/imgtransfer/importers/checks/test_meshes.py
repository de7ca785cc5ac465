"""Axes and units, welded seams and the way back, and what is said of a garment and a body before any work."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.bodies.anny import load_body
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.garments.config import TemplateConfig
from imgtransfer.garments.garment import make_garment
from imgtransfer.importers.checks.axes import AXES, UNITS, Axes, guess_axes, likely_unit
from imgtransfer.importers.checks.findings import refuse
from imgtransfer.importers.checks.meshes import check_template
from imgtransfer.importers.checks.template import load_template
from imgtransfer.importers.checks.topology import check_topology
from imgtransfer.importers.checks.weld import weld, weld_motion
from imgtransfer.importers.checks.worn import check_worn
from render import InputError, Mesh
from render.mesh.surface import Surface
from tests.helpers import synthetic
from tests.helpers.import_examples import standing_body, vest, write_obj

# axes and units


def test_axes_by_hand() -> None:
    # Blender and 3ds Max: z up, the body faces -y. What was up (z) becomes y, what was ahead (-y) becomes z.
    axes = Axes("z", "-y", 0.01)
    np.testing.assert_allclose(
        axes.apply(np.array([[0.0, 0, 100], [0, -100, 0], [100, 0, 0]])), np.eye(3)[[1, 2, 0]]
    )


@pytest.mark.parametrize(("up", "facing"), [(u, f) for u, f in product(AXES, AXES) if u[-1] != f[-1]])
def test_every_orientation_of_a_body_is_recognised(up: str, facing: str) -> None:
    axes = Axes(up, facing)
    assert np.linalg.det(axes.rotation) == pytest.approx(1)
    body = standing_body().vertices
    assert (
        guess_axes(100 * body @ axes.rotation + 3.0) == axes
    )  # the rotation's inverse, other units, elsewhere


def test_shapes_that_do_not_tell_are_not_guessed() -> None:
    tube, _ = synthetic.tube(0.15, 1.0, 9, 14, closed=True)
    assert guess_axes(tube) is None
    assert guess_axes(np.random.default_rng(0).normal(size=(500, 3))) is None
    assert guess_axes(np.zeros((10, 3))) is None


def test_axes_without_sense_are_refused() -> None:
    for arguments, message in (
        (("w", "z"), "one of x, y, z"),
        (("y", "-y"), "different axes"),
        (("y", "z", 0.0), "positive"),
    ):
        with pytest.raises(InputError, match=message):
            Axes(*arguments)


@pytest.mark.parametrize(
    ("size", "unit"), [(1.7, "m"), (170, "cm"), (1700, "mm"), (17, "dm"), (5.6, "ft"), (1e6, None)]
)
def test_units_by_the_size_of_a_person(size: float, unit: str | None) -> None:
    assert likely_unit(size) == unit


# welding


def split_tube() -> Mesh:
    """A tube that is cut open along one line and rolled out in texture space: the line's vertices come twice."""
    vertices, faces = synthetic.tube(0.2, 0.5, 4, 6, closed=False)
    seam = np.arange(0, 24, 6)
    copies = np.full(24, -1)
    copies[seam] = 24 + np.arange(4)
    faces = faces.copy()
    last = (faces % 6 == 5).any(1) & (faces % 6 == 0).any(1)  # the strip that closes the tube uses the copies
    faces[last] = np.where(copies[faces[last]] >= 0, copies[faces[last]], faces[last])
    both = np.concatenate([vertices, vertices[seam]])
    uvs = np.stack([np.r_[np.arange(24) % 6, np.full(4, 6)] / 6, both[:, 1] * 2], -1).astype(np.float32)
    surface = Surface(faces, np.arange(28), uvs=uvs, uv_faces=faces)
    return Mesh(both, faces, source="shirt.obj", surface=surface)


def test_welding_joins_the_seam_and_knows_the_way_back() -> None:
    mesh = split_tube()
    welded = weld(mesh)
    vertices, faces = synthetic.tube(0.2, 0.5, 4, 6, closed=False)
    np.testing.assert_array_equal(welded.mesh.vertices, vertices.astype(np.float64))
    np.testing.assert_array_equal(welded.mesh.faces, faces)
    assert welded.joined == 4
    surface = welded.mesh.surface
    assert surface is not None
    np.testing.assert_array_equal(surface.of_file(welded.mesh.vertices), mesh.vertices)
    np.testing.assert_array_equal(surface.faces, mesh.faces)
    assert mesh.surface is not None
    np.testing.assert_array_equal(surface.uv_faces, mesh.surface.uv_faces)


def test_two_layers_that_touch_are_not_welded() -> None:
    # Inside a piece nothing is open, so vertices of a second layer at the same place stay.
    inner, faces = synthetic.tube(0.2, 0.5, 4, 6, closed=False)
    outer = np.where(
        np.isclose(inner[:, 1:2], [0, 0, 0]) | np.isclose(inner[:, 1:2], [0.5] * 3), inner * 1.1, inner
    )
    mesh = Mesh(np.concatenate([inner, outer]), np.concatenate([faces, faces + 24]))
    assert weld(mesh).joined == 0


def test_welding_triangles_on_their_own() -> None:
    vertices, faces = synthetic.tube(0.2, 0.5, 4, 6, closed=False)
    soup = Mesh(vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))
    welded = weld(soup)
    assert len(welded.mesh.vertices) == 24
    np.testing.assert_array_equal(welded.mesh.vertices[welded.mesh.faces], vertices[faces].astype(np.float64))


def test_a_motion_is_welded_and_an_opening_is_no_seam() -> None:
    mesh = split_tube()
    welded = weld(mesh)
    moved = np.stack([mesh.vertices, mesh.vertices + 0.1]).astype(np.float32)
    found = weld_motion(moved, welded, source="shirt")
    assert found.shape == (2, 24, 3)
    assert welded.mesh.surface is not None
    np.testing.assert_array_equal(welded.mesh.surface.of_file(found), moved)
    moved[1, 26] += 0.02  # the second copy on the seam, of vertex 12
    with pytest.raises(InputError, match=r"vertices 12 and 26 .* part by 35 mm in frame 1"):
        weld_motion(moved, welded, source="shirt")


# what is said of a garment and a body


AHEAD = np.array([0, 0, 1.5])


def kinds(garment: Mesh, body: Mesh, **options: object) -> list[str]:
    return [finding.kind for finding in check_template(garment, body, **options)]  # type: ignore[arg-type]


def moved(mesh: Mesh, vertices: np.ndarray) -> Mesh:
    return replace(mesh, vertices=vertices)


@pytest.fixture(scope="module")
def body() -> Mesh:
    return standing_body()


@pytest.fixture(scope="module")
def shirt(body: Mesh) -> Mesh:
    return vest(body)


def test_a_garment_that_fits_has_no_findings(body: Mesh, shirt: Mesh) -> None:
    assert kinds(shirt, body) == []


@pytest.mark.parametrize("unit", ["cm", "mm", "in"])
def test_other_units_name_the_flag(body: Mesh, shirt: Mesh, unit: str) -> None:
    size = 1 / UNITS[unit]
    (finding,) = check_template(moved(shirt, shirt.vertices * size), moved(body, body.vertices * size))
    assert finding.severe
    assert f"add unit={unit!r}" in finding.text
    assert "body.obj: the body would be" in finding.text


def test_a_garment_in_other_units_than_the_body(body: Mesh, shirt: Mesh) -> None:
    (finding,) = check_template(moved(shirt, shirt.vertices * 100), body)
    assert "vest.obj: the garment would be" in finding.text
    assert "add garment_unit='cm'" in finding.text


def test_other_axes_name_the_flags(body: Mesh, shirt: Mesh) -> None:
    turn = Axes("z", "-y").rotation  # to the file's axes: points @ rotation
    turned = [moved(mesh, mesh.vertices @ turn) for mesh in (shirt, body)]
    (finding,) = check_template(*turned)
    assert "stands along z and faces -y, not y and z; add up='z' facing='-y'" in finding.text
    backwards = [moved(mesh, mesh.vertices * [-1, 1, -1]) for mesh in (shirt, body)]
    (finding,) = check_template(*backwards)
    assert "add up='y' facing='-z'" in finding.text
    given = Axes("x", "z")  # the user said something, and it was wrong
    (finding,) = check_template(
        *[moved(m, given.apply(m.vertices @ turn)) for m in (shirt, body)], given=given
    )
    assert "not x and z; add up='z' facing='-y'" in finding.text


def test_a_garment_beside_the_body(body: Mesh, shirt: Mesh) -> None:
    (finding,) = check_template(moved(shirt, shirt.vertices + AHEAD), body)
    assert finding.kind == "apart"
    assert "not on the body in the rest pose" in finding.text


def test_a_garment_in_other_axes_than_the_body(body: Mesh, shirt: Mesh, tmp_path: Path) -> None:
    lying = moved(shirt, shirt.vertices @ Axes("z", "-y").rotation)  # z up on a body that has y up
    (finding,) = check_template(lying, body)
    assert finding.severe
    assert "its axes are other ones than the body's: add garment_up='z' garment_facing='-y'" in finding.text
    write_obj(tmp_path / "vest.obj", lying.vertices, lying.faces)
    with pytest.raises(
        InputError, match=r"add garment_up='z' garment_facing='-y' \(anyway=True goes on all the same\)$"
    ):
        load_template(tmp_path / "vest.obj", body)
    garment, notes = load_template(tmp_path / "vest.obj", body, axes=Axes("z", "-y"))
    np.testing.assert_allclose(garment.vertices, shirt.vertices, atol=1e-6)
    assert notes == []


def test_a_template_is_welded_on_its_way(tmp_path: Path) -> None:
    body = Mesh(*synthetic.tube(0.15, 1.0, 9, 14, closed=True), source="body")
    mesh = split_tube()
    write_obj(tmp_path / "shirt.obj", mesh.vertices + np.array([0, 0.2, 0]), mesh.faces)
    with pytest.raises(InputError, match="add weld=True"):
        load_template(tmp_path / "shirt.obj", body)
    garment, _ = load_template(tmp_path / "shirt.obj", body, welding=True)
    assert len(garment.vertices) == 24
    assert garment.surface is not None
    np.testing.assert_array_equal(garment.surface.faces, mesh.faces)


def test_a_garment_s_configuration_says_how_its_file_lies(shirt: Mesh, tmp_path: Path) -> None:
    axes = Axes("z", "-y", 0.01)
    write_obj(tmp_path / "vest.obj", shirt.vertices @ axes.rotation / axes.scale, shirt.faces)
    with pytest.raises(InputError, match="its file is in other units than the body's: add garment_unit='cm'"):
        make_garment(load_body(), TemplateConfig(path=tmp_path / "vest.obj"))
    config = TemplateConfig(path=tmp_path / "vest.obj", up="z", facing="-y", unit="cm", weld=True)
    garment = make_garment(load_body(), config)
    np.testing.assert_allclose(garment.mesh.vertices, shirt.vertices, atol=1e-6)
    assert garment.mesh.surface is not None


def test_a_garment_inside_the_body(body: Mesh) -> None:
    (finding,) = check_template(vest(body, gap=-0.008), body)
    assert finding.kind == "inside"
    assert finding.severe
    assert "vertices start inside the body, the deepest 8." in finding.text
    shallow = check_template(vest(body, gap=-0.002), body)
    assert [(f.kind, f.severe) for f in shallow] == [("inside", False)]


@pytest.mark.parametrize("place", ["inside the body", "far away", "at its surface"])
def test_vertices_that_no_triangle_uses_are_no_cloth_wherever_they_lie(
    body: Mesh, shirt: Mesh, place: str
) -> None:
    point = {
        "inside the body": body.vertices.mean(0),
        "far away": [0, 500.0, 0],
        "at its surface": body.vertices[0],
    }
    loose = moved(shirt, np.concatenate([shirt.vertices, [point[place]]]))
    (finding,) = check_template(loose, body)
    assert (finding.kind, finding.severe) == ("unused", False)
    assert "1 vertices belong to no triangle" in finding.text


def test_unused_vertices_of_a_garment_to_simulate_go_with_their_nearest(
    body: Mesh, shirt: Mesh, tmp_path: Path
) -> None:
    loose = [body.vertices.mean(0), shirt.vertices[4] + 0.001, shirt.vertices[7]]
    write_obj(tmp_path / "vest.obj", np.concatenate([loose[:1], shirt.vertices, loose[1:]]), shirt.faces + 1)
    garment, notes = load_template(tmp_path / "vest.obj", body)
    assert [note.split(": ")[1].split(" (")[0] for note in notes] == ["3 vertices belong to no triangle"]
    np.testing.assert_allclose(garment.vertices, shirt.vertices, atol=1e-6)
    np.testing.assert_array_equal(garment.faces, shirt.faces)
    assert garment.surface is not None
    np.testing.assert_array_equal(garment.surface.faces, shirt.faces + 1)
    np.testing.assert_array_equal(garment.surface.vertices[1:], [*range(len(shirt.vertices)), 4, 7])


def test_a_body_s_unused_vertices_are_no_skin(body: Mesh, shirt: Mesh) -> None:
    assert kinds(shirt, moved(body, np.concatenate([body.vertices, [[0, 90.0, 0]]]))) == []


def test_a_clip_s_unused_vertices_do_not_decide_whether_it_is_worn(body: Mesh, shirt: Mesh) -> None:
    inside = np.repeat(body.vertices.mean(0)[None], 2 * len(shirt.vertices), axis=0)
    vertices = np.concatenate([shirt.vertices, inside]).astype(np.float32)
    skin = body.vertices.astype(np.float32)
    clip = Clip(
        Template(vertices, shirt.faces), Garment(vertices[None]), Body(skin, body.faces, skin[None]), fps=30.0
    )
    check_worn(clip, "shirt", hint="")
    everything = replace(clip, template=Template(vertices, np.arange(len(vertices))[:, None] + [0, 0, 0]))
    with pytest.raises(InputError, match=r"in frame 0, \d+ % of it inside"):
        check_worn(everything, "shirt", hint="")


def test_triangles_seen_from_inside(body: Mesh, shirt: Mesh) -> None:
    assert kinds(replace(shirt, faces=shirt.faces[:, ::-1]), body) == ["inside_out"]
    assert kinds(shirt, replace(body, faces=body.faces[:, ::-1])) == ["inside_out"]


def test_split_seams_name_the_flag() -> None:
    (finding,) = check_topology(split_tube())
    assert finding.severe
    assert "4 of 28 vertices lie on others, where seams were split" in finding.text
    assert "add weld=True" in finding.text
    assert check_topology(split_tube(), welding=True) == []


def test_pieces_unused_vertices_and_crowded_edges_are_told_but_no_obstacle() -> None:
    vertices, faces = synthetic.tube(0.2, 0.5, 4, 6, closed=False)
    two = Mesh(np.concatenate([vertices, vertices * 0.5, [[0, 0, 0]]]), np.concatenate([faces, faces + 24]))
    findings = check_topology(two)
    assert [(f.kind, f.severe) for f in findings] == [("pieces", False), ("unused", False)]
    assert "2 separate pieces (24, 24 vertices)" in findings[0].text
    crowded = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]]),
        np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]),
    )
    assert [f.kind for f in check_topology(crowded)] == ["edges"]


def test_severe_findings_stop_the_work_unless_told_otherwise(body: Mesh, shirt: Mesh) -> None:
    findings = check_template(moved(shirt, shirt.vertices + AHEAD), body)
    with pytest.raises(InputError, match=r"not on the body.*\(anyway=True goes on all the same\)"):
        refuse(findings)
    assert refuse(findings, anyway=True) == [finding.text for finding in findings]
    assert refuse([]) == []
