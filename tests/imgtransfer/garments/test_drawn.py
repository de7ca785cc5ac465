"""Garments drawn at random: their names, their sizes, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from imgtransfer.bodies.config import AnnyConfig
from imgtransfer.config.loader import parse_config
from imgtransfer.garments.config import SkirtConfig, TShirtConfig
from imgtransfer.garments.drawn import DrawnGarments, interleaved
from imgtransfer.simulation.config import SimulateConfig
from render import InputError

SLEEVES = {"draws": 3, "seed": 5, "length": (0.0, 0.2), "sleeve": (0.2, 0.6), "ease": 0.03}


def drawn(**changes: Any) -> DrawnGarments:
    return DrawnGarments.model_validate(SLEEVES | changes)


def test_draws_are_numbered_from_one_and_keep_what_is_no_range() -> None:
    shirts = drawn(detail="small").garments()
    assert [shirt.title for shirt in shirts] == ["tshirt-01", "tshirt-02", "tshirt-03"]
    assert all(isinstance(shirt, TShirtConfig) and shirt.detail == "small" for shirt in shirts)
    assert {shirt.ease for shirt in shirts} == {0.03}
    assert {shirt.neck for shirt in shirts if isinstance(shirt, TShirtConfig)} == {TShirtConfig().neck}
    assert drawn(name="vest").garments()[2].title == "vest-03"


def test_a_seed_gives_these_sizes_on_every_machine() -> None:
    sizes = [(shirt.length, shirt.sleeve) for shirt in drawn().garments() if isinstance(shirt, TShirtConfig)]
    assert sizes == [(0.0782, 0.3643), (0.0705, 0.2056), (0.0732, 0.3907)]


def test_sizes_fill_their_range_and_keep_to_it() -> None:
    lengths = [shirt.length for shirt in drawn(draws=200, length=(0.10003, 0.20003)).garments()]
    assert 0.10003 <= min(lengths) < 0.11
    assert 0.19 < max(lengths) <= 0.20003
    assert 0.14 < sum(lengths) / len(lengths) < 0.16


def test_more_draws_or_another_range_leave_the_others_as_they_were() -> None:
    few, many = drawn().garments(), drawn(draws=9).garments()
    assert many[:3] == few
    wider = drawn(neck=(0.0, 0.1)).garments()
    assert [shirt.length for shirt in wider] == [shirt.length for shirt in few]
    assert len({shirt.length for shirt in [*many, *drawn(seed=6).garments()]}) == 12


def test_kinds_of_one_seed_are_drawn_apart() -> None:
    shirts, dresses = (drawn(of=kind, length=(0.1, 0.2)).garments() for kind in ("tshirt", "dress"))
    assert not {shirt.length for shirt in shirts} & {dress.length for dress in dresses}


def test_kinds_take_turns_however_the_list_is_sorted() -> None:
    listed = (drawn(draws=4), drawn(draws=2, of="dress", length=0.5), SkirtConfig())
    assert [garment.title for garment in interleaved(listed)] == [
        *("tshirt-01", "dress-01", "tshirt-02", "skirt", "tshirt-03", "dress-02", "tshirt-04"),
    ]
    plain = (SkirtConfig(), TShirtConfig(), SkirtConfig(name="kilt"))
    assert interleaved(plain) == plain


@pytest.mark.parametrize(("entry", "wanted"), [
    ("{draws: 2, of: trousers, length: [0.1, 0.5]}", "garments.0: length: a number from 0.15 to 0.97 is "),
    ("{draws: 2, sleeve: [0.14, 2]}", "garments.0.sleeve: a number from 0.12 to 0.92 is wanted, or a list "),
    ("{draws: 2, sleeve: [0.6, 0.2]}", "garments.0: sleeve: a range from less to more is wanted, found [0.6, 0.2]"),
    ("{draws: 2, of: skirt, neck: 0.1}", "garments.0: neck: no such setting of skirt; there are detail, "),
    ("{draws: 2, sleve: 1}", "garments.0.sleve: no such setting of drawn, did you mean sleeve? There are detail, "),
    ("{draws: 0}", "garments.0.draws: a whole number from 1 to 10000 is wanted, found 0"),
    ("{of: tshirt}", "garments.0.draws: missing; drawn needs it"),
    ("{draws: 2, of: cape}", "garments.0.of: one of tshirt, dress, trousers, skirt is wanted, found 'cape'"),
    ("{draws: 2, ease: wide}", "garments.0.ease: a number above 0.005 and below 0.1 is wanted, or a list"),
    ("{draws: 2, ease: [1]}", "garments.0.ease: "),
    ("{draws: 2, edge_length: 3}", "garments.0.edge_length: a number above 0.005 and below 0.1 is wanted, found 3"),
    ("{draws: 2}, {kind: drawn, draws: 1}", "garments: two are called tshirt-01; give them a `name` each"),
])  # fmt: skip
def test_mistakes_are_named_in_one_line(entry: str, wanted: str) -> None:
    given = yaml.safe_load(f"garments: [{{kind: drawn, {entry[1:]}]")
    with pytest.raises(InputError) as caught:
        parse_config(SimulateConfig, given, "c.yaml")
    assert str(caught.value).startswith(f"c.yaml: {wanted}")
    assert "\n" not in str(caught.value)


def test_bodies_by_their_seeds() -> None:
    config = SimulateConfig.model_validate({"bodies": [{}, {"kind": "drawn", "seed": 3, "last_seed": 5}]})
    assert config.wearers() == (AnnyConfig(), *(AnnyConfig(seed=seed) for seed in (3, 4, 5)))
    with pytest.raises(ValueError, match="last_seed 2 is less than seed 3"):
        SimulateConfig.model_validate({"bodies": [{"kind": "drawn", "seed": 3, "last_seed": 2}]})
    with pytest.raises(ValueError, match="are more than 10000 bodies"):
        SimulateConfig.model_validate({"bodies": [{"kind": "drawn", "last_seed": 10_000}]})
