"""What a ray meets, and pixels and points of the garment that belong to each other."""

from __future__ import annotations

import numpy as np
import pytest

from imgtransfer.data.clip import Clip
from imgtransfer.viewing.picking import Mark, Pixels, Ray, first_hit, on_picture
from render import Mesh, TemplateImager

# Two squares of two triangles each, at z = 0 and z = -1.
VERTICES = np.array([[x, y, z] for z in (0.0, -1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
FACES = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])


def ray(origin: list[float], direction: list[float]) -> Ray:
    return Ray(np.array(origin), np.array(direction))


def test_a_ray_meets_the_nearer_of_two_surfaces() -> None:
    hit = first_hit(ray([0.75, 0.25, 5.0], [0.0, 0.0, -2.0]), VERTICES, FACES)
    assert hit is not None
    distance, mark = hit
    assert distance == pytest.approx(2.5)
    assert mark.face == 0
    assert mark.weights == pytest.approx((0.25, 0.5, 0.25))
    assert mark.place(VERTICES, FACES) == pytest.approx([0.75, 0.25, 0.0])


def test_a_ray_from_behind_meets_the_other() -> None:
    hit = first_hit(ray([0.25, 0.75, -5.0], [0.0, 0.0, 1.0]), VERTICES, FACES)
    assert hit is not None
    assert hit[1].face == 3


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ([2.0, 0.5, 5.0], [0.0, 0.0, -1.0]),  # beside it
        ([0.5, 0.5, 5.0], [0.0, 0.0, 1.0]),  # behind the eye
        ([0.5, 0.5, 5.0], [1.0, 0.0, 0.0]),  # along it
    ],
)
def test_a_ray_that_passes_by_meets_nothing(origin: list[float], direction: list[float]) -> None:
    assert first_hit(ray(origin, direction), VERTICES, FACES) is None


def test_faces_without_an_area_are_not_met() -> None:
    assert first_hit(ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]), np.zeros((3, 3)), np.array([[0, 1, 2]])) is None


def test_where_a_picture_is_met() -> None:
    centre = np.array([1.0, 2.0, 0.0])
    upper_left = ray([0.11, 2.39, 3.0], [0.0, 0.0, -1.0])
    assert on_picture(upper_left, centre, 2.0, 1.0, (10, 20)) == (3.0, (1, 1))
    assert on_picture(ray([2.1, 2.0, 3.0], [0.0, 0.0, -1.0]), centre, 2.0, 1.0, (10, 20)) is None
    assert on_picture(ray([1.0, 2.0, 3.0], [1.0, 0.0, 0.0]), centre, 2.0, 1.0, (10, 20)) is None


def test_the_pixel_of_a_pixels_point_is_that_pixel(tube_clip: Clip) -> None:
    template = Mesh(tube_clip.template.vertices.astype(np.float64), tube_clip.template.faces)
    pixels = Pixels(TemplateImager.build(template, size=(48, 40), backend="numpy"))
    mark = pixels.mark(0, 20, 18)
    assert mark is not None
    assert pixels.pixel(0, mark) == (20, 18)
    assert pixels.pixel(1, mark) is None  # the back does not see the front
    assert pixels.mark(0, 0, 0) is None


def test_a_mark_stays_on_the_cloth(tube_clip: Clip) -> None:
    assert tube_clip.garment is not None
    faces, vertices = tube_clip.template.faces, tube_clip.garment.vertices[4]
    mark = Mark(7, (1.0, 0.0, 0.0))
    assert mark.place(vertices, faces) == pytest.approx(vertices[faces[7, 0]])
