"""Which face is nearest: by a plain loop, and the way without sorting against the one with it."""

from __future__ import annotations

import numpy as np
import pytest

from render import frame_cameras
from render.raster.peeling import NearestLayers
from render.raster.screen import ScreenFaces, screen_faces
from tests.helpers.example_meshes import sphere


def pairs(faces: ScreenFaces, size: tuple[int, int]) -> list[tuple[int, int]]:
    """Some faces at some pixels, wherever their planes are: (pixel, face), each pair once."""
    generator = np.random.default_rng(3)
    found = {
        (int(p), int(f))
        for p, f in zip(
            generator.integers(0, size[0] * size[1], 400),
            generator.integers(0, len(faces.ids), 400),
            strict=True,
        )
    }
    return sorted(found)


@pytest.mark.parametrize("layers", [1, 2])
def test_the_nearest_faces_stay_however_they_come(layers: int) -> None:
    size = (12, 10)
    (camera,) = frame_cameras(sphere(), views=("front",), size=size)
    faces = screen_faces(sphere(), camera)
    given = pairs(faces, size)
    together = NearestLayers(faces, size, layers)
    together.add(*(np.array(column) for column in zip(*given, strict=True)))  # pixels repeat
    one_by_one = NearestLayers(faces, size, layers)
    for pixel, index in reversed(given):
        one_by_one.add(np.array([pixel]), np.array([index]))  # pixels differ
    np.testing.assert_array_equal(one_by_one.face_id, together.face_id)

    depth = {}
    for pixel, index in given:
        centre = np.array([[pixel % size[1], pixel // size[1]]]) + 0.5
        depth.setdefault(pixel, []).append(
            (-float(faces.reciprocal_depth(np.array([index]), centre)[0]), index)
        )
    for pixel, found in depth.items():
        wanted = [int(faces.ids[index]) for _, index in sorted(found)[:layers]]
        nearest = together.face_id.reshape(layers, -1)[:, pixel]
        assert nearest[nearest >= 0].tolist() == wanted
