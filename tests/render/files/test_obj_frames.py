"""Frames of OBJ: what differs between them and is yet the same mesh, and what the whole reader has to judge."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from render import InputError, open_sequence
from render.files.obj_frames import vertices_and_rest

FIRST = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1//1 2//1 3//1\n"
SECOND = [[0, 0, 5], [1, 0, 5], [0, 1, 5]]


def frames(tmp_path: Path, second: str) -> np.ndarray:
    (tmp_path / "f_0.obj").write_text(FIRST, newline="")
    (tmp_path / "f_1.obj").write_text(second, newline="")
    return open_sequence(tmp_path / "f_*.obj").vertices()


def moved(text: str) -> str:
    return text.replace("v 0 0 0", "v 0 0 5").replace("v 1 0 0", "v 1 0 5").replace("v 0 1 0", "v 0 1 5")


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text,
        lambda text: "# frame 2\n" + text,
        lambda text: text.replace("vn 0 0 1", "vn 0 1 0"),
        lambda text: text.removesuffix("\n"),
        lambda text: text.replace(" 5\n", " 5 0.5 0.5 0.5\n"),  # colours
        lambda text: text.replace(" 5\n", "  5 \n"),
    ],
)
def test_the_same_mesh_is_known_by_its_text(tmp_path: Path, change) -> None:
    assert frames(tmp_path, change(moved(FIRST)))[1].tolist() == SECOND
    first, second = (vertices_and_rest(tmp_path / f"f_{number}.obj") for number in (0, 1))
    assert second[0].tolist() == SECOND
    assert first[1] == second[1]


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("v 0", "v\t0"),
        lambda text: text.replace("v 0", "  v 0"),
        lambda text: text.replace("v 1 0 5", "v 1 \\\n0 5"),
        lambda text: text.replace(" 5\n", " 5 # here\n", 1),
        lambda text: text.replace("//1", ""),
        lambda text: text.replace("vt 0 0\n", ""),
        lambda text: "\ufeff" + text.replace("mtllib a.mtl\n", ""),
    ],
)
def test_other_text_is_read_in_full_and_may_be_the_same_mesh(tmp_path: Path, change) -> None:
    assert frames(tmp_path, change(moved(FIRST)))[1].tolist() == SECOND


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("f 1//1 2//1", "f 2//1 1//1", "other triangles"),
        ("v 0 0 5\n", "v 0 0 5\nv 0 0 0\n", "4 vertices, but the first frame has 3"),
        ("v 0 0 5", "v 0 5", r"line 2 is not a valid vertex or face: 'v 0 5'"),
        ("v 0 0 5", "v 0 0 x", r"line 2 is not a valid vertex or face: 'v 0 0 x'"),
        ("v 0 0 5", "v 0 0 nan", "vertex 0 is .*not finite"),
        ("v 0 0 5", "v 0 0 1e12", "vertex 0 is .*beyond"),
    ],
)
def test_what_is_another_mesh_or_none_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"f_1\.obj: .*{message}"):
        frames(tmp_path, moved(FIRST).replace(old, new))


def test_an_empty_frame_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"f_1\.obj"):
        frames(tmp_path, "")


def test_faces_that_count_backwards_from_another_place_are_other_faces(tmp_path: Path) -> None:
    both = "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "v 0 0 9\nv 1 0 9\nv 0 1 9\n"
    face = "f -3 -2 -1\n"
    (tmp_path / "f_0.obj").write_text(both[0] + face + both[1] + face)
    (tmp_path / "f_1.obj").write_text("".join(both) + 2 * face)
    with pytest.raises(InputError, match=r"f_1\.obj: .*other triangles"):
        open_sequence(tmp_path).vertices()
