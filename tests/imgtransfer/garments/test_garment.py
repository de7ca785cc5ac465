"""All four garments on bodies of several shapes, in A- and T-pose."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
import trimesh
from pydantic import TypeAdapter, ValidationError

from fusion import BodySdf
from imgtransfer.bodies.anny import load_body
from imgtransfer.bodies.shape import AnnyShape, random_shape
from imgtransfer.garments.checks import mesh_quality
from imgtransfer.garments.config import DressConfig, GarmentConfig, SkirtConfig, TrousersConfig, TShirtConfig
from imgtransfer.garments.figure import Figure
from imgtransfer.garments.garment import OPENINGS, make_garment
from imgtransfer.garments.lower import lower_garment
from imgtransfer.garments.upper import upper_garment
from render import InputError

SHAPES = {
    "default": None,
    "heavy": AnnyShape(gender=1, age=0.8, weight=0.9, height=0.3),
    "tall": AnnyShape(gender=0, age=0.7, weight=0.2, height=0.45),
}
KINDS = {"tshirt": TShirtConfig, "dress": DressConfig, "trousers": TrousersConfig, "skirt": SkirtConfig}
WORN = [*((kind, "default") for kind in KINDS), ("tshirt", "heavy"), ("trousers", "heavy")]
BOTH_SORTS = ("tshirt", "trousers")  # one that hangs from the shoulders, one from the waist


@cache
def made(kind, shape="default", **changes):
    return make_garment(load_body(SHAPES[shape]), KINDS[kind](detail="small", **changes))


def saved(path, vertices, faces):
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


def distances(vertices, faces, points):
    sdf = BodySdf(faces, len(vertices))
    sdf.update(vertices.astype(np.float32))
    return sdf.distance(torch.from_numpy(points.astype(np.float32))).numpy()


@pytest.mark.parametrize(("kind", "shape"), WORN)
def test_it_is_a_clean_even_surface_outside_the_body(kind, shape):
    garment, body = made(kind, shape), load_body(SHAPES[shape])
    quality = mesh_quality(garment.mesh)
    assert (quality.components, quality.handles, quality.non_manifold) == (1, 0, 0)
    assert quality.openings == len(OPENINGS[kind])
    assert (quality.duplicates, quality.intersecting) == (0, 0)
    assert quality.angle_min > 12
    assert quality.angle_p1 > 28
    assert quality.edge_spread < 0.2
    config = KINDS[kind](detail="small")
    assert quality.edge_median == pytest.approx(config.target_edge, rel=0.05)
    assert 1400 < quality.vertices < 2600
    clearance = distances(body.rest, body.faces, garment.mesh.vertices)
    assert clearance.min() > 0.004
    if kind in ("tshirt", "trousers"):  # the others hang from the widest place
        assert np.median(clearance) == pytest.approx(config.ease, abs=0.011)


@pytest.mark.parametrize(("kind", "shape"), WORN)
def test_its_openings_lie_where_their_names_say(kind, shape):
    garment = made(kind, shape)
    centres = {name: garment.mesh.vertices[loop].mean(axis=0) for name, loop in garment.openings.items()}
    assert tuple(centres) == OPENINGS[kind]
    top, *others = centres
    assert all(centres[top][1] > centres[other][1] for other in others)
    left = [centre for name, centre in centres.items() if name.startswith("left")]
    right = [centre for name, centre in centres.items() if name.startswith("right")]
    for a, b in zip(left, right, strict=True):
        assert a[0] > 0.08
        np.testing.assert_allclose(a * [-1, 1, 1], b, atol=0.02)  # the body is symmetric
    assert len(garment.pinned) == (len(garment.openings["waist"]) if "waist" in garment.openings else 0)
    corners = garment.mesh.vertices[garment.mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = corners.mean(axis=1) + 0.005 * normals / np.linalg.norm(normals, axis=1, keepdims=True)
    body = load_body(SHAPES[shape])
    farther = distances(body.rest, body.faces, outward) > distances(
        body.rest, body.faces, corners.mean(axis=1)
    )
    assert farther.mean() > 0.97  # between the legs the outside of one is near the other


def test_sizes_of_a_shirt_act():
    plain = made("tshirt").mesh.vertices
    other = made("tshirt", edge_length=0.03, length=-0.1, sleeve=0.2, neck=0.06, ease=0.035).mesh.vertices
    body = load_body()
    assert len(other) < 0.6 * len(plain)
    assert other[:, 1].min() == pytest.approx(Figure.of(body).leg_height(-0.1), abs=0.01)
    assert other[:, 0].max() < plain[:, 0].max() - 0.005  # though with more ease
    assert np.median(distances(body.rest, body.faces, other)) > 0.031

    def neckline(vertices):  # its lowest point, in the middle of the front
        front = vertices[(np.abs(vertices[:, 0]) < 0.02) & (vertices[:, 2] > 0.03)]
        return front[:, 1].max()

    assert neckline(other) < neckline(plain) - 0.02


def test_sizes_of_a_skirt_act():
    plain, other = made("skirt"), made("skirt", length=0.3, flare=0.4, waist=-0.05)
    hem, waist = (other.mesh.vertices[other.openings[name]] for name in ("hem", "waist"))
    figure = Figure.of(load_body())
    assert hem[:, 1].mean() == pytest.approx(figure.leg_height(0.3), abs=0.003)
    assert waist[:, 1].mean() == pytest.approx(figure.waist - 0.05, abs=0.003)
    plain_hem = plain.mesh.vertices[plain.openings["hem"]]
    assert np.ptp(hem[:, 0]) > np.ptp(plain_hem[:, 0])  # though it is shorter


def test_sleeves_may_be_long_and_trousers_short():
    long = make_garment(load_body(), TShirtConfig(edge_length=0.03, sleeve=0.9))
    wrist = Figure.of(load_body()).sleeve_end("left", 0.9)[0]
    sleeve = long.mesh.vertices[long.openings["left sleeve"]].mean(axis=0)
    np.testing.assert_allclose(sleeve, wrist, atol=0.02)
    short = make_garment(load_body(), TrousersConfig(edge_length=0.03, length=0.3))
    assert short.mesh.vertices[:, 1].min() == pytest.approx(Figure.of(load_body()).leg_height(0.3), abs=0.01)


@pytest.mark.parametrize("kind", BOTH_SORTS)
def test_a_body_in_t_pose_is_dressed_too(kind):
    body = load_body()
    posed = body.pose(np.zeros((1, 22, 3)), np.zeros((1, 3)))
    figure = Figure(posed.vertices[0].astype(np.float64), body.faces, posed.joints[0])
    build = upper_garment if kind in ("tshirt", "dress") else lower_garment
    mesh = build(figure, KINDS[kind](edge_length=0.03))
    quality = mesh_quality(mesh)
    assert (quality.openings, quality.handles, quality.intersecting) == (len(OPENINGS[kind]), 0, 0)
    assert distances(figure.vertices, figure.faces, mesh.vertices).min() > 0.004


def test_a_figure_measures_the_body():
    figure = Figure.of(load_body())
    assert figure.leg_height(0.0) < figure.waist < figure.joint("left_shoulder")[1]
    assert -0.1 < figure.crotch < figure.leg_height(0.0)
    centre, half_width = figure.neck
    assert figure.joint("left_shoulder")[1] < centre[1] < figure.joint("head")[1]
    assert 0.04 < half_width < 0.07
    end, along = figure.sleeve_end("left", 1.0)
    np.testing.assert_allclose(end, figure.joint("left_wrist"), atol=1e-12)
    assert np.linalg.norm(along) == pytest.approx(1)
    short = figure.shortened_arms(0.3)
    assert short[:, 0].max() < figure.sleeve_end("left", 0.3)[0][0] + 0.06
    kept = np.abs(figure.vertices[:, 0]) < 0.15
    assert np.array_equal(short[kept], figure.vertices[kept])


@pytest.mark.parametrize(("config", "wanted"), [
    (TShirtConfig(edge_length=0.04, flare=0.8, ease=0.09), r"tshirt: .*'flare': 0.8.* give .* 2 openings"),
    (TrousersConfig(edge_length=0.06, length=0.2), "waist, left hem, right hem is wanted on this body; use a smaller"),
])  # fmt: skip
def test_sizes_that_leave_no_garment_are_refused(config, wanted):
    with pytest.raises(InputError, match=wanted):
        make_garment(load_body(), config)


@pytest.mark.parametrize(("given", "wanted"), [
    ({"sleeve": 0.02}, "sleeve"),
    ({"kind": "skirt", "sleeve": 0.3}, "sleeve"),
    ({"kind": "trousers", "ease": 2.2}, "ease"),
    ({"kind": "cape"}, "cape"),
    ({"detail": "tiny"}, "detail"),
    ({"kind": "template"}, "path"),
])  # fmt: skip
def test_mistaken_sizes_are_named(given, wanted):
    with pytest.raises(ValidationError, match=wanted):
        TypeAdapter(GarmentConfig).validate_python(given)


def test_a_garment_without_a_kind_is_a_tshirt():
    assert TypeAdapter(GarmentConfig).validate_python({"ease": 0.03}) == TShirtConfig(ease=0.03)


def test_a_template_is_taken_as_it_is(tmp_path):
    mesh = made("skirt").mesh
    path = saved(tmp_path / "kilt.obj", mesh.vertices, mesh.faces)
    garment = make_garment(load_body(), TypeAdapter(GarmentConfig).validate_python(
        {"kind": "template", "path": str(path), "pinned": True}
    ))  # fmt: skip
    assert garment.name == "kilt"
    np.testing.assert_allclose(garment.mesh.vertices, mesh.vertices, atol=1e-6)
    assert np.array_equal(garment.pinned, made("skirt").pinned)
    assert len(garment.openings) == 2


def test_a_template_that_starts_inside_the_body_is_refused(tmp_path):
    mesh = made("skirt").mesh
    path = saved(tmp_path / "kilt.obj", mesh.vertices * 0.8, mesh.faces)
    with pytest.raises(InputError, match="start inside the body"):
        make_garment(
            load_body(), TypeAdapter(GarmentConfig).validate_python({"kind": "template", "path": path})
        )


@pytest.mark.parametrize("kind", BOTH_SORTS)
def test_a_garment_refitted_to_another_shape_keeps_its_faces_and_fits(kind):
    body, config = load_body(SHAPES["tall"]), KINDS[kind](edge_length=0.035)
    plain = make_garment(load_body(), config)
    garment = make_garment(body, config, like=load_body())  # raises unless it is clean
    assert np.array_equal(garment.mesh.faces, plain.mesh.faces)
    assert all(np.array_equal(garment.openings[name], loop) for name, loop in plain.openings.items())
    quality = mesh_quality(garment.mesh)
    assert quality.angle_min > 12
    assert quality.edge_spread < 0.2
    figure = Figure.of(body)
    for name, loop in garment.openings.items():
        border = garment.mesh.vertices[loop]
        if name.endswith("hem"):
            np.testing.assert_allclose(border[:, 1], figure.leg_height(config.length), atol=1e-9)
        if name == "waist":
            np.testing.assert_allclose(border[:, 1], figure.waist, atol=1e-9)
        if name.endswith("sleeve"):
            end = figure.sleeve_end(name.split()[0], config.sleeve)[0]
            np.testing.assert_allclose(border.mean(axis=0), end, atol=0.03)


def test_a_garment_refitted_to_its_own_body_stays():
    mesh, again = (
        made("skirt").mesh,
        make_garment(load_body(), SkirtConfig(detail="small"), like=load_body()).mesh,
    )
    assert np.linalg.norm(again.vertices - mesh.vertices, axis=1).max() < 0.006  # evened out once more


def test_only_shapes_of_one_body_share_a_garment():
    body = load_body()
    other = replace(body, faces=body.faces[::-1].copy())
    with pytest.raises(InputError, match="shapes of one body"):
        make_garment(other, SkirtConfig(edge_length=0.05), like=body)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_every_garment_fits_random_shapes_at_full_size(seed):
    for config in KINDS.values():  # raises unless the surface is clean
        make_garment(load_body(random_shape(seed)), config())
        make_garment(load_body(random_shape(seed)), config(), like=load_body())
