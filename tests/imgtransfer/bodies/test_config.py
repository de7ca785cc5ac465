"""Which body a configuration means, and what it is called."""

from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from imgtransfer.bodies.anny import load_body
from imgtransfer.bodies.config import AnnyConfig, BodyConfig, SmplConfig, make_body
from imgtransfer.bodies.shape import AnnyShape


def body(**values):
    return TypeAdapter(BodyConfig).validate_python(values)


@pytest.mark.parametrize(("config", "title"), [
    (AnnyConfig(), ""),
    (AnnyConfig(shape=AnnyShape()), ""),  # the default shape, though it is written out
    (AnnyConfig(seed=0), "anny0"),
    (AnnyConfig(shape=AnnyShape(height=0.333, weight=0.8)), "weight80-height33"),
    (SmplConfig(path=Path("models/SMPL_MALE.npz")), "SMPL_MALE"),
    (SmplConfig(path=Path("SMPL_MALE.npz"), betas=(0.5, -2.0, 1e-3)), "SMPL_MALE-0.5--2-0.001"),
])  # fmt: skip
def test_a_body_is_called_by_what_differs_from_the_default(config, title):
    assert config.title == title


def test_the_reference_is_the_same_body_in_its_default_shape():
    smpl = SmplConfig(path=Path("folder"), gender="female", betas=(1.0, 2.0))
    assert smpl.reference == SmplConfig(path=Path("folder"), gender="female")
    assert AnnyConfig(shape=AnnyShape(height=0.4)).reference == AnnyConfig()
    assert smpl.reference.reference == smpl.reference


def test_the_kind_decides_and_without_one_it_is_anny():
    assert body(seed=3) == AnnyConfig(seed=3)
    assert body(kind="smpl", path="m.npz") == SmplConfig(path=Path("m.npz"))
    assert TypeAdapter(BodyConfig).validate_python(SmplConfig(path=Path("m.npz"))).kind == "smpl"


@pytest.mark.parametrize(("values", "wanted"), [
    ({"kind": "star"}, "star"),
    ({"kind": "smpl"}, "path"),
    ({"path": "m.npz"}, "path"),  # Anny has no file
    ({"kind": "smpl", "path": "m.npz", "gender": "any"}, "gender"),
    ({"kind": "smpl", "path": "m.npz", "betas": [float("nan")]}, "finite"),
    ({"seed": -1}, "seed"),
    ({"seed": 2**63}, "seed"),
    ({"shape": {"height": 1.2}}, "height"),
])  # fmt: skip
def test_mistakes_are_named(values, wanted):
    with pytest.raises(ValidationError, match=wanted):
        body(**values)


def test_equal_configurations_are_one_body_in_memory():
    assert make_body(AnnyConfig(seed=7)) is make_body(AnnyConfig(seed=7))
    assert make_body(None) is load_body()
    assert make_body(AnnyConfig(seed=0)).rest.shape == load_body().rest.shape
    assert not (make_body(AnnyConfig(seed=0)).rest == load_body().rest).all()  # seed 0 is a seed
