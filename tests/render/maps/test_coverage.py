"""How much of a template the views see, on shapes by formula and on the public garments where they are at hand."""

import numpy as np
import pytest

from render import Coverage, Mesh, TemplateImager
from tests.helpers.example_meshes import tube, two_quads
from tests.helpers.paths import EXTERNAL


def test_coverage_by_hand():
    # Four of eight vertices in front; the rear square is the first one's second surface.
    coverage = Coverage.of(TemplateImager.build(two_quads(), views="front", size=(64, 64), layers=3))
    assert coverage.images == {"front": 0.5, "front/1": 0.5}  # and a third layer shows nothing: left out
    assert coverage.together == (0.5, 1.0)
    assert str(coverage) == "front 50.0 %, front/1 50.0 %; together 50.00 %, 100.00 % with layer 1"


def sleeved() -> Mesh:
    """A trunk and two sleeves that hang close beside it, as in a T-shirt's rest pose with the arms down."""
    trunk = tube(around=48, along=24)
    sleeve = trunk.vertices * [0.3, 0.5, 0.5]
    vertices = [trunk.vertices, np.add(sleeve, [0.36, 0.1, 0]), np.add(sleeve, [-0.36, 0.1, 0])]
    faces = [trunk.faces + k * len(trunk.vertices) for k in range(3)]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


@pytest.mark.parametrize(("mesh", "by_four"), [(tube(), 0.999), (sleeved(), 0.97)], ids=["tube", "sleeved"])
def test_views_and_layers_add_up(mesh, by_four):
    front_and_back = Coverage.of(TemplateImager.build(mesh, layers=4)).together
    four = Coverage.of(TemplateImager.build(mesh, views="four", layers=2)).together
    assert 0.8 < front_and_back[0] < four[0]
    assert list(front_and_back) == sorted(front_and_back)
    assert four[0] >= by_four
    assert min(front_and_back[-1], four[1]) >= 0.995


@pytest.mark.skipif(
    not (EXTERNAL / "static_dress.npz").is_file(), reason=f"no external garments at {EXTERNAL}"
)
@pytest.mark.parametrize(
    ("name", "two", "four"),
    # Seen on this data: T-shirt 95.05, 99.73, 99.75 %; dress 92.52, 99.65, 99.37 %. The issue asks for 99.5 % by
    # four views, and for front and back to see what the paper states as its failure case, 91 to 96 %.
    [("tshirt", (0.945, 0.955), 0.995), ("dress", (0.92, 0.93), 0.995)],
)
def test_the_public_garments(name, two, four):
    with np.load(EXTERNAL / f"static_{name}.npz") as garment:
        mesh = Mesh(garment["template_vertices"], garment["garment_faces"], name)
    front_and_back = Coverage.of(TemplateImager.build(mesh, layers=2)).together
    assert two[0] < front_and_back[0] < two[1]
    assert front_and_back[1] > 0.99
    assert Coverage.of(TemplateImager.build(mesh, views="four")).together[0] >= four
