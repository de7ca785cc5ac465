"""Methods by name: those of this package, and those that another package offers."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from imgtransfer.deformers.base import Deformer
from imgtransfer.deformers.registry import BUILT_IN, GROUP, deformer_class, deformer_names
from render import InputError

PACKAGE = '''
from imgtransfer.config.schema import Section
from imgtransfer.deformers import Deformer

class Still(Deformer):
    """The garment as it rests."""
    name = "still"
    Config = Section
    def fit(self, clips, folder): pass
    def predict(self, clip): return clip.template.vertices[None].repeat(clip.n_frames, 0)
    def tensors(self): return {}
    def restore(self, tensors): pass
'''


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with a method of its own, with something that is none, and with one that cannot be imported."""
    (tmp_path / "own_methods.py").write_text(PACKAGE)
    info = tmp_path / "own_methods-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-methods\nVersion: 1.0\n")
    lines = ["still = own_methods:Still", "none = own_methods:Section", "lost = own_methods:Nothing"]
    (info / "entry_points.txt").write_text("\n".join([f"[{GROUP}]", *lines]) + "\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)


@pytest.mark.parametrize("name", BUILT_IN)
def test_each_name_is_of_the_class_that_has_it(name: str) -> None:
    kind = deformer_class(name)
    assert issubclass(kind, Deformer)
    assert kind.name == name
    assert kind.Config()
    assert kind.Config.__doc__
    assert kind.__doc__


@pytest.mark.usefixtures("installed")
def test_a_method_of_another_package_has_its_place() -> None:
    assert deformer_names() == [*BUILT_IN, "lost", "none", "still"]
    assert deformer_class("still").name == "still"
    with pytest.raises(InputError, match="no subclass"):
        deformer_class("none")
    with pytest.raises(InputError, match="cannot be imported from own_methods:Nothing"):
        deformer_class("lost")


@pytest.mark.parametrize("name", ["knit", None, 3, ["lbs"], ""])
def test_a_method_that_is_none_is_refused_with_all_names(name: object) -> None:
    with pytest.raises(InputError, match="there are image_transfer, lbs"):
        deformer_class(name)
