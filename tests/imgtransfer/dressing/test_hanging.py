"""Garments that come with the package, on the default body and on other shapes of it."""

from pathlib import Path

import numpy as np
import pytest
import torch

from fusion import BodySdf
from imgtransfer.bodies.config import AnnyConfig, SmplConfig, make_body
from imgtransfer.data.grid import lies_on_grid
from imgtransfer.data.source import open_clips
from imgtransfer.dressing.hanging import hanging_garment, ships
from imgtransfer.garments.config import DressConfig, SkirtConfig, TemplateConfig, TrousersConfig, TShirtConfig
from tests.helpers.paths import ROOT

KINDS = {"tshirt": TShirtConfig, "dress": DressConfig, "trousers": TrousersConfig, "skirt": SkirtConfig}


@pytest.mark.parametrize("kind", KINDS)
def test_on_the_default_body_it_is_the_sample_data_s_template(kind):
    """So what the shipped checkpoints were trained on, and a build that makes another garment would show here."""
    sample = open_clips(ROOT / f"configs/sample_data/{kind}.zarr.zip", names=["*walk*"])[0].template
    mesh = hanging_garment(KINDS[kind](detail="small"), AnnyConfig())
    np.testing.assert_array_equal(mesh.faces, sample.faces)
    np.testing.assert_allclose(mesh.vertices, sample.vertices, rtol=0, atol=1e-6)
    assert lies_on_grid(mesh.vertices.astype(np.float32))


def test_on_another_shape_it_has_the_same_faces_and_hangs_outside_the_body():
    garment, body = SkirtConfig(detail="small"), AnnyConfig(seed=7)
    mesh, default = hanging_garment(garment, body), hanging_garment(garment, AnnyConfig())
    np.testing.assert_array_equal(mesh.faces, default.faces)
    wearer = make_body(body)
    sdf = BodySdf(wearer.faces, len(wearer.rest))
    sdf.update(wearer.rest)
    distance = sdf.distance(torch.from_numpy(mesh.vertices.astype(np.float32))).numpy()
    assert distance.min() > 0.0008
    # The waist lies higher by what the body's own waist does, and the garment is no longer the default's.
    moved = mesh.vertices - default.vertices
    assert 0.005 < np.linalg.norm(moved, axis=1).max() < 0.4


@pytest.mark.parametrize(
    ("garment", "body"),
    [
        (TShirtConfig(), AnnyConfig()),  # in full detail
        (TShirtConfig(detail="small", length=0.2), AnnyConfig()),
        (TShirtConfig(detail="small"), SmplConfig(path=Path("models"))),
        (TemplateConfig(path=Path("shirt.obj")), AnnyConfig()),
    ],
)
def test_other_sizes_bodies_and_files_do_not_ship(garment, body):
    assert not ships(garment, body)


def test_a_name_and_a_shape_make_no_other_garment():
    assert ships(TShirtConfig(detail="small", name="mine"), AnnyConfig(seed=3))
