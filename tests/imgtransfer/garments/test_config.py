"""Parameters of garments that say the same twice, or mean something by what they leave out."""

from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from imgtransfer.garments.config import (
    DressConfig,
    GarmentConfig,
    MeshFile,
    SkirtConfig,
    TemplateConfig,
    TrousersConfig,
    TShirtConfig,
)

MADE = (TShirtConfig, DressConfig, TrousersConfig, SkirtConfig)


@pytest.mark.parametrize("kind", MADE)
def test_an_edge_length_counts_before_the_detail_and_small_is_coarser_than_full(kind):
    assert kind(detail="small").target_edge > 1.4 * kind().target_edge > 0
    assert kind(detail="small", edge_length=0.031).target_edge == 0.031


@pytest.mark.parametrize("kind", MADE)
def test_a_made_garment_is_found_by_its_kind_and_called_so(kind):
    name = kind().kind
    assert TypeAdapter(GarmentConfig).validate_python({"kind": name}) == kind()
    assert TypeAdapter(GarmentConfig).validate_python(kind()) == kind()
    assert kind().title == name


@pytest.mark.parametrize(
    ("unit", "metres"), [("m", 1), ("dm", 0.1), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254), ("ft", 0.3048)]
)
def test_units_in_metres(unit, metres):
    assert MeshFile(unit=unit).axes.scale == pytest.approx(metres)


def test_a_scale_takes_the_place_of_a_unit():
    assert MeshFile(scale=0.5).axes.scale == 0.5
    with pytest.raises(ValidationError, match="unit and scale say the same; give one of them"):
        MeshFile(unit="cm", scale=0.01)


@pytest.mark.parametrize(
    ("up", "facing", "wanted"), [("y", None, "z"), ("z", None, "-y"), ("z", "x", "x"), ("-y", "-x", "-x")]
)
def test_where_a_file_faces_unless_it_says(up, facing, wanted):
    axes = MeshFile(up=up, facing=facing).axes
    assert (axes.up, axes.facing) == (up, wanted)


@pytest.mark.parametrize(("up", "facing"), [("y", "y"), ("y", "-y"), ("-z", "z")])
def test_up_and_facing_along_one_axis_are_refused(up, facing):
    with pytest.raises(ValidationError, match=f"up is {up} and facing {facing}; they must be different axes"):
        MeshFile(up=up, facing=facing)


@pytest.mark.parametrize("scale", [0, -1, 1e-7, 1e7, float("nan"), float("inf")])
def test_scales_that_are_none_are_refused(scale):
    with pytest.raises(ValidationError, match="scale"):
        MeshFile(scale=scale)


@pytest.mark.parametrize(("path", "name", "title"), [
    ("clothes/my shirt.obj", None, "my-shirt"),
    ("kilt.ply", None, "kilt"),
    ("kilt.ply", "tartan-2", "tartan-2"),
])  # fmt: skip
def test_a_template_is_called_by_its_name_or_else_its_file(path, name, title):
    assert TemplateConfig(path=Path(path), name=name).title == title


@pytest.mark.parametrize("name", ["", "a b", ".hidden", "a/b", "../up"])
def test_names_that_are_no_file_names_are_refused(name):
    with pytest.raises(ValidationError, match="name"):
        TemplateConfig(path=Path("kilt.obj"), name=name)
