import numpy as np
import pytest

from render import InputError, Mesh
from render.mesh.mesh import check_finite
from tests.helpers.example_meshes import two_triangles

SQUARE = two_triangles()


def test_edges_by_hand():
    assert SQUARE.edges.tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE.vertices, np.zeros((0, 3), int), "no faces"),
        (SQUARE.vertices, [[0, 1, 4]], r"face 0 uses vertices \[0, 1, 4\]"),
        (SQUARE.vertices, [[0, 1, 2], [0, 1, -1]], "face 1 uses"),
        (SQUARE.vertices, [[0.0, 1.0, 2.0]], "integers"),
        (SQUARE.vertices, [[0, 1, 2, 3]], r"\(F, 3\)"),
        (SQUARE.vertices[:, :2], [[0, 1, 2]], r"\(N, 3\)"),
        ([[0, 0, 0], [1, 0, np.inf], [0, 1, 0]], [[0, 1, 2]], "vertex 1 is .* not finite"),
    ],
)
def test_unusable_meshes_are_refused(vertices, faces, message):
    with pytest.raises(InputError, match=message) as caught:
        Mesh(np.array(vertices), np.array(faces), source="shirt.obj")
    assert str(caught.value).startswith("shirt.obj: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "wrong"), [(np.nan, "not finite"), (-np.inf, "not finite"), (1e30, "beyond ±10000 m")]
)
def test_a_vertex_that_cannot_be_meant_is_named_with_its_frame(value, wrong):
    moved = np.zeros((3, 4, 3), np.float32)
    check_finite(moved, "shirt")
    moved[1, 2, 0] = value
    with pytest.raises(InputError, match=rf"shirt: frame 41, vertex 2 is .* {wrong} \(1 such vertices\)"):
        check_finite(moved, "shirt", first=40)
