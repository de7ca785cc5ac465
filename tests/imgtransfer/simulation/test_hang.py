"""Templates that hang: patterns come to where a garment cut for the body does, seams hold, what slips is refused."""

from pathlib import Path

import numpy as np
import pytest

import imgtransfer.dressing
from imgtransfer.bodies.config import AnnyConfig
from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.data.clip_parts import Body, Template
from imgtransfer.dressing.settling import SOLVER, settled_garment
from imgtransfer.garments.config import TShirtConfig
from imgtransfer.network import TransferModel
from imgtransfer.network.config import MapsConfig, NetworkConfig
from imgtransfer.simulation.config import ClothConfig, SimulateConfig
from imgtransfer.simulation.hang import hanging
from imgtransfer.training.checkpoint import save_model
from render import InputError, MapFile, Mesh, PositionBox, load_maps
from tests.helpers.example_meshes import sphere
from tests.helpers.fusion_examples import cylinder_body, tube
from tests.helpers.import_examples import split, standing_body
from tests.helpers.models import LOCAL

COTTON = ClothConfig()


@pytest.fixture(scope="module")
def shipped() -> dict[str, np.ndarray]:
    file = Path(imgtransfer.dressing.__file__).with_name("garments.npz")
    with np.load(file, allow_pickle=False) as stored:
        return dict(stored)


def mast() -> Mesh:
    """An upright cylinder, 13 cm thick and 60 cm high, whose vertices are 2 cm apart along it."""
    around = cylinder_body()
    fine = around.subdivide_to_size(0.03)
    return Mesh(np.asarray(fine.vertices), np.asarray(fine.faces), source="mast")


@pytest.mark.long
def test_a_pattern_comes_down_to_where_the_garment_hangs_that_is_cut_for_the_body(
    shipped: dict[str, np.ndarray],
) -> None:
    pattern = Mesh(
        shipped["tshirt_pattern"].astype(np.float64), shipped["tshirt_faces"].astype(np.int64), "shirt"
    )
    cut = SimulateConfig(body=AnnyConfig(), garment=TShirtConfig(detail="small"), solver=SOLVER)
    put_on, rests = settled_garment(cut)
    assert np.abs(put_on.vertices - pattern.vertices).max() < 1e-6
    hangs = hanging(pattern, standing_body(), COTTON)
    assert np.linalg.norm(pattern.vertices - rests, axis=-1).mean() > 0.015
    assert np.linalg.norm(hangs - rests, axis=-1).mean() < 0.001


def test_both_sides_of_a_split_seam_hang_together_as_the_sewn_garment_does() -> None:
    sewn, body = tube(), mast()
    parted = split(sewn)
    assert len(parted.vertices) > len(sewn.vertices)
    whole, parts = (hanging(mesh, body, COTTON, pinned=True) for mesh in (sewn, parted))
    where = np.array([np.flatnonzero((sewn.vertices == place).all(1))[0] for place in parted.vertices])
    # Vertices are relaxed in another order, so not to the bit.
    assert np.linalg.norm(parts - whole[where], axis=-1).max() < 0.002
    lies_on = (parted.vertices[:, None] == parted.vertices).all(-1)
    one, other = np.nonzero(np.triu(lies_on, 1))
    assert len(one) == len(parted.vertices) - len(sewn.vertices)
    assert np.array_equal(parts[one], parts[other])


def test_a_waistband_stays_where_it_is() -> None:
    skirt = tube()
    hangs = hanging(skirt, mast(), COTTON, pinned=True)
    top = skirt.vertices[:, 1] == skirt.vertices[:, 1].max()
    assert np.abs(hangs[top] - skirt.vertices[top]).max() < 2**-16
    assert hangs[~top, 1].mean() < skirt.vertices[~top, 1].mean()


def test_a_tube_that_slides_down_a_mast_is_refused_with_the_flag_that_holds_it() -> None:
    refusal = r"tube: the garment's topmost opening slips \d+ cm .*pinned=True .* \(anyway=True goes on all the same\)$"
    with pytest.raises(InputError, match=refusal):
        hanging(tube(radius=0.2), mast(), COTTON)


def test_what_slips_or_is_stretched_hangs_all_the_same_with_a_note(caplog: pytest.LogCaptureFixture) -> None:
    ring = tube(radius=0.2)
    with caplog.at_level("WARNING"):
        hangs = hanging(ring, mast(), COTTON, anyway=True)
    assert "note: tube: the garment's topmost opening slips" in caplog.text
    assert hangs[:, 1].mean() < ring.vertices[:, 1].mean() - 0.15
    caplog.clear()
    tight = tube(radius=0.04)  # of a mast of 6.5 cm
    with pytest.raises(InputError, match=r"one edge in a hundred is stretched to .* \(anyway=True goes on"):
        hanging(tight, mast(), COTTON, pinned=True)
    with caplog.at_level("WARNING"):
        assert np.isfinite(hanging(tight, mast(), COTTON, pinned=True, anyway=True)).all()
    assert "note: tube: one edge in a hundred is stretched to" in caplog.text


def test_a_waist_that_slides_to_where_the_body_is_wider_is_noted(caplog: pytest.LogCaptureFixture) -> None:
    body = mast()
    cone = body.vertices.copy()
    cone[:, [0, 2]] *= (1.0 - 1.2 * body.vertices[:, 1:2]).clip(
        0.3
    )  # 7 cm thinner at the top than at the bottom
    skirt = tube(radius=0.14)
    skirt.vertices[:, [0, 2]] *= (1.0 - 1.2 * (skirt.vertices[:, 1:2] - 0.1)).clip(0.3)
    with caplog.at_level("WARNING"):
        hanging(skirt, Mesh(cone, body.faces), COTTON)
    assert "topmost opening has come down by" in caplog.text
    assert "holds it" in caplog.text
    caplog.clear()
    with caplog.at_level("WARNING"):
        hanging(skirt, Mesh(cone, body.faces), COTTON, pinned=True)
    assert not caplog.text


def test_a_closed_surface_has_no_waistband() -> None:
    with pytest.raises(InputError, match="no opening that could be a waistband"):
        hanging(sphere(0.3), Mesh(sphere(0.1).vertices, sphere(0.1).faces), COTTON, pinned=True)


def clip_of(name: str) -> Clip:
    skirt, body = tube(), mast()
    moved = np.stack([body.vertices, body.vertices + np.array([0.1, 0, 0])]).astype(np.float32)
    return Clip(
        template=Template(skirt.vertices.astype(np.float32), skirt.faces.astype(np.int32)),
        garment=None,
        body=Body(body.vertices.astype(np.float32), body.faces.astype(np.int32), moved),
        fps=30.0,
        name=name,
    )


def untrained(clip: Clip, *, general: bool) -> TransferModel:
    """Networks that change nothing: the model predicts the first guess."""
    return TransferModel(
        maps=MapsConfig(size=(64, 48)),
        network=NetworkConfig.model_validate(LOCAL),
        template=Mesh(clip.template.vertices, clip.template.faces),
        box=PositionBox.around(clip.template.vertices, margin=0.5),
        general=general,
    ).eval()


@pytest.fixture(scope="module")
def general(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("general")
    return save_model(folder / "model.safetensors", untrained(clip_of("a"), general=True))


def predicted(words: list[str], out: Path) -> tuple[MapFile, Clip]:
    assert main(["predict", *words, "--out", str(out)]) == 0
    (folder,) = (path.parent for path in out.rglob("maps.npz"))
    return load_maps(folder / "maps.npz"), load_clip(folder / "position_only.npz")


def test_predict_shows_a_general_model_the_template_as_it_hangs(
    general: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = clip_of("a")
    file = save_clip(tmp_path / "a.npz", clip)
    hangs = hanging(tube(), mast(), COTTON, pinned=True)
    words = [str(general), str(file), "--settle", "--pinned"]
    maps, vertices = predicted(words, tmp_path / "settled")
    assert np.abs(maps.template_vertices - hangs).max() < 1e-5
    assert maps.rest_vertices is not None
    # Edge lengths are the template's, and so is the template of what is written.
    assert np.array_equal(maps.rest_vertices.astype(np.float32), clip.template.vertices)
    assert np.array_equal(vertices.template.vertices, clip.template.vertices)
    _, plain = predicted(words[:2], tmp_path / "plain")
    # On the resting body the first guess is the template, which has come down by centimetres at the hem.
    seen = np.linalg.norm(vertices.garment.vertices[0] - hangs, axis=-1)
    assert np.median(seen) < 0.002
    assert np.median(np.linalg.norm(plain.garment.vertices[0] - clip.template.vertices, axis=-1)) < 0.002
    capsys.readouterr()
    assert main(["predict", *words, "--out", str(tmp_path / "settled")]) == 0
    assert "predicted by this model already" in capsys.readouterr().out
    assert main(["predict", *words[:2], "--out", str(tmp_path / "settled")]) == 0
    assert "predicted by this model already" not in capsys.readouterr().out


def test_a_model_of_one_garment_is_not_shown_another_shape_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = clip_of("a")
    save_model(tmp_path / "model.safetensors", untrained(clip, general=False))
    file = save_clip(tmp_path / "a.npz", clip)
    words = ["predict", str(tmp_path / "model.safetensors"), str(file), "--out", str(tmp_path / "out")]
    assert main([*words, "--settle"]) == 2
    assert (
        "was trained on one garment and knows its template as it is; leave out --settle"
        in capsys.readouterr().err
    )
    for option in ("--pinned", "--anyway"):
        assert main([*words, option]) == 2
        assert f"{option} says how a garment is let hang; give --settle with it" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
