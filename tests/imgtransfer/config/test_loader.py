"""One way to read configurations: a file, `--set`, or both, and one line about what is wrong."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, Field

from imgtransfer.config.loader import load_config, parse_config, read_yaml, with_changes
from render import InputError


class Wheel(BaseModel):
    model_config = ConfigDict(extra="forbid")

    spokes: int = Field(28, ge=1)


class Cart(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: str = "cart"
    front: Wheel = Wheel()
    spare: tuple[Wheel, ...] = ()


def test_a_file_and_changes_are_one_configuration(tmp_path: Path) -> None:
    (tmp_path / "cart.yaml").write_text("name: a\nfront: {spokes: 3}\nspare: [{spokes: 4}, {spokes: 5}]\n")
    cart = load_config(Cart, tmp_path / "cart.yaml", ["name=b", "spare.1.spokes=7", "name=c"])
    assert cart == Cart(name="c", front=Wheel(spokes=3), spare=(Wheel(spokes=4), Wheel(spokes=7)))
    assert load_config(Cart, None, ["front.spokes=2", "spare=[{spokes: 9}]"]) == Cart(
        front=Wheel(spokes=2), spare=(Wheel(spokes=9),)
    )
    assert load_config(Cart) == Cart()


def test_an_empty_file_and_an_empty_section_are_the_defaults(tmp_path: Path) -> None:
    (tmp_path / "cart.yaml").write_text("")
    assert load_config(Cart, tmp_path / "cart.yaml") == Cart()
    (tmp_path / "cart.yaml").write_text("front:\n")
    assert load_config(Cart, tmp_path / "cart.yaml", ["front.spokes=2"]).front.spokes == 2


def test_changes_leave_the_content_they_are_made_to() -> None:
    content = {"front": {"spokes": 3}}
    assert with_changes(content, ["front.spokes=4", "rear.spokes=x=y"]) == {
        "front": {"spokes": 4},
        "rear": {"spokes": "x=y"},
    }
    assert content == {"front": {"spokes": 3}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("spokes", "changes spokes: section.key=value is wanted"),
        ("=3", "changes =3: section.key=value is wanted"),
        ("front..spokes=3", "changes front..spokes=3: section.key=value is wanted"),
        ("name.first=3", "changes name.first=3: first is wanted of 'a', which is not a section"),
        ("spare.2.spokes=3", "changes spare.2.spokes=3: there are 1 items, counted from 0, and no 2 among them"),
        ("spare.last.spokes=3", "changes spare.last.spokes=3: there are 1 items, counted from 0, and no last among"),
        ("spare.²=3", "changes spare.²=3: there are 1 items"),
        ("name=[", "changes name=[: not YAML ("),
        (
            "front.spokse=3",
            "changes front.spokse=3: front.spokse: no such setting of front, did you mean spokes? There",
        ),
        ("spokes=3", "changes spokes=3: spokes: no such setting, did you mean front.spokes? There are front, name"),
        ("front.spare=3", "changes front.spare=3: front.spare: no such setting of front, did you mean spare? There"),
        ("front.bell=3", "changes front.bell=3: front.bell: no such setting of front; there are spokes"),
        (
            "front.spokes=null",
            "changes front.spokes=null: front.spokes: a whole number from 1 on is wanted, found null",
        ),
        ("front={spokes: 0}", "changes front={spokes: 0}: front.spokes: a whole number from 1 on is wanted, found 0"),
        ("front=3", "changes front=3: front: a mapping of settings is wanted, found 3"),
    ],
)  # fmt: skip
def test_a_wrong_change_is_named_as_it_was_given(tmp_path: Path, change: str, message: str) -> None:
    (tmp_path / "cart.yaml").write_text("name: a\nspare: [{}]\n")
    with pytest.raises(InputError) as caught:
        load_config(Cart, tmp_path / "cart.yaml", ["front.spokes=5", change])
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_a_mistake_of_the_file_is_not_blamed_on_a_change(tmp_path: Path) -> None:
    (tmp_path / "cart.yaml").write_text("nmae: a\n")
    with pytest.raises(InputError, match=r"cart.yaml: nmae: no such setting, did you mean name\? There are"):
        load_config(Cart, tmp_path / "cart.yaml", ["front.spokes=5"])


def test_what_was_found_is_shown_short() -> None:
    with pytest.raises(InputError) as caught:
        parse_config(Cart, {"front": {"spokes": "x" * 10_000}}, "here")
    assert len(str(caught.value)) < 200


def test_a_file_that_is_missing_or_no_yaml(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.yaml: no such file; a cart is wanted"):
        load_config(Cart, tmp_path / "none.yaml", wanted="a cart")
    (tmp_path / "cart.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"cart.yaml: not YAML"):
        read_yaml(tmp_path / "cart.yaml")
    (tmp_path / "cart.yaml").write_text("- 1")
    with pytest.raises(InputError, match=r"cart.yaml: a mapping of settings is wanted, found a list"):
        load_config(Cart, tmp_path / "cart.yaml")


HOSTILE = {
    "nested lists": ("name: " + "[" * 40_000, "nested deeper than 50 levels"),
    "nested sections": (
        "".join(f"{' ' * i}a:\n" for i in range(60)) + " " * 60 + "1",
        "nested deeper than 50",
    ),
    "a bomb of aliases": (
        "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 40)),
        "more than 100000 values",
    ),
    "an alias to itself": ("a: &a [*a]", "nested deeper than 50 levels"),
    "an alias to nothing": ("a: *b", "undefined alias"),
    "a key twice": ("name: a\nfront: {}\nname: b", "name is there twice, in lines 1 and 3"),
    "a key twice in a section": ("front: {spokes: 1, spokes: 2}", "spokes is there twice, in lines 1 and 1"),
    "a list for a key": ("? [a, b]\n: 1", "unhashable"),
    "a tag of Python": ("name: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
    "a tag that does not fit": ("name: !!int x", "not YAML"),
    "an empty number": ("name: !!int ''", "not YAML"),
    "a date that is none": ("name: 2020-13-45", "not YAML"),
    "a number without end": ("front: {spokes: " + "9" * 5000 + "}", "not YAML"),
    "two documents": ("name: a\n---\nname: b", "expected a single document"),
    "a text": ("cart", "a mapping of settings is wanted, found only 'cart'"),
    "control codes": ("name: a\x00b", "special characters are not allowed"),
    "far too much text": ("# " + "x" * 1_000_000, "bytes of text"),
    "numbers for keys": ("1: 2", "1: keys should be strings"),
}


@pytest.mark.parametrize("fault", HOSTILE)
def test_text_that_means_harm_is_one_short_line(tmp_path: Path, fault: str) -> None:
    content, message = HOSTILE[fault]
    (tmp_path / "cart.yaml").write_text(content)
    with pytest.raises(InputError) as caught:
        load_config(Cart, tmp_path / "cart.yaml")
    said = str(caught.value)
    assert said.startswith(f"{tmp_path}/cart.yaml: ")
    assert message in said
    assert "\n" not in said
    assert len(said) < 500


def test_aliases_and_merged_keys_are_understood(tmp_path: Path) -> None:
    (tmp_path / "cart.yaml").write_text(
        "front: &wheel {spokes: 3}\nspare: [*wheel, {<<: *wheel, spokes: 4}]\n"
    )
    assert load_config(Cart, tmp_path / "cart.yaml").spare == (Wheel(spokes=3), Wheel(spokes=4))


def test_changes_nest_no_deeper_than_files() -> None:
    with pytest.raises(InputError, match=r"section\.key=value is wanted"):
        with_changes({}, [".".join("a" * 5000) + "=1"])


def test_a_pipe_is_no_configuration(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "cart.yaml")
    with pytest.raises(InputError, match="a pipe or a device"):
        load_config(Cart, tmp_path / "cart.yaml")
