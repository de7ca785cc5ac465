"""The clip npz: read back equal, and clear about what is wrong with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.data.clip_parts import Garment
from render import InputError
from tests.helpers.clips import with_arrays


def arrays_of(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as stored:
        return {key: stored[key] for key in stored.files}


@pytest.fixture
def clip_file(tmp_path: Path, tube_clip: Clip) -> Path:
    return save_clip(tmp_path / "tube_bend.npz", tube_clip)


def test_a_clip_comes_back_equal(clip_file: Path, tube_clip: Clip) -> None:
    back = load_clip(clip_file)
    for key in (
        "template_vertices",
        "garment_faces",
        "garment_vertices",
        "body_vertices",
        "poses",
        "blend_weights",
    ):
        np.testing.assert_array_equal(back.arrays()[key], tube_clip.arrays()[key])
    assert back.skeleton.joint_transforms is None
    assert (back.fps, back.info, back.name) == (30.0, {"source": "synthetic", "units": "m"}, "tube_bend")


def test_a_slice_cuts_every_array_that_has_frames(tube_clip: Clip) -> None:
    cut = tube_clip.slice(slice(1, 5, 2))
    assert cut.n_frames == 2
    np.testing.assert_array_equal(cut.skeleton.trans, tube_clip.skeleton.trans[[1, 3]])
    np.testing.assert_array_equal(cut.garment.vertices, tube_clip.garment.vertices[[1, 3]])
    assert cut.body.rest is tube_clip.body.rest


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_clip(tmp_path / "absent.npz")


def test_a_file_that_is_no_npz(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(InputError, match="not a readable npz"):
        load_clip(tmp_path / "text.npz")


def test_pickled_objects_are_not_read(tmp_path: Path, clip_file: Path) -> None:
    np.savez(tmp_path / "bad.npz", **{**arrays_of(clip_file), "poses": np.array([{}], dtype=object)})
    with pytest.raises(InputError, match="poses is not a readable plain array"):
        load_clip(tmp_path / "bad.npz")


@pytest.mark.parametrize("key", ["body_rest", "garment_faces", "fps"])
def test_a_missing_array_is_named(tmp_path: Path, clip_file: Path, key: str) -> None:
    arrays = arrays_of(clip_file)
    del arrays[key]
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(InputError, match=f"lacks {key}"):
        load_clip(tmp_path / "bad.npz")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("garment_faces", np.array([[0, 1, 192]]), r"garment_faces: face 0 uses vertices \[0, 1, 192\]"),
        ("garment_faces", np.zeros((0, 3), int), "no faces"),
        ("body_faces", np.array([[0.0, 1, 2]]), "body_faces: integers are wanted, found float64"),
        ("trans", np.zeros((5, 3)), r"trans must have shape \(6, 3\), found \(5, 3\)"),
        ("body_rest", np.full((128, 3), np.nan, np.float32), "body_rest: vertex 0 is .* not finite"),
        ("fps", 0.0, "fps is 0"),
        ("fps", np.inf, "fps is inf"),
        ("fps", np.nan, "fps is nan"),
        ("fps", -30.0, "fps is -30"),
        ("fps", 1e300, "fps is 1e[+]300"),
        ("body_vertices", np.float32(1), r"body_vertices must have shape \(any, 128, 3\), found \(\)"),
        ("trans", np.zeros((6, 3), bool), "trans: numbers are wanted, found bool"),
        ("trans", np.zeros((6, 3), complex), "trans: numbers are wanted, found complex128"),
        ("body_rest", np.full((128, 3), "x"), "body_rest: numbers are wanted, found <U1"),
        ("trans", np.full((6, 3), 1e30), r"trans: vertex 0 is .*beyond ±10000 m"),
        ("poses", np.zeros((6, 0, 3)), "poses have no joint"),
        ("parents", np.array([-1.0, 0.0]), "parents: integers are wanted"),
        ("original_faces", np.array([[0.0, 1, 2]]), "original_faces: integers are wanted"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tube_clip: Clip, key: str, value: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        with_arrays(tube_clip, **{key: value})


def test_a_vertex_that_is_not_finite_is_named_with_its_frame(tube_clip: Clip) -> None:
    vertices = tube_clip.garment.vertices.copy()
    vertices[4, 7, 1] = np.inf
    with pytest.raises(InputError, match="garment_vertices: frame 4, vertex 7"):
        tube_clip.with_garment(vertices)


def test_no_frames_are_refused(tube_clip: Clip) -> None:
    with pytest.raises(InputError, match="no frames"):
        tube_clip.slice(slice(0, 0))


def test_other_types_of_numbers_become_those_that_every_library_takes(tube_clip: Clip) -> None:
    half = tube_clip.garment.vertices.astype(np.float16)
    clip = replace(
        tube_clip,
        garment=Garment(half),
        skeleton=replace(
            tube_clip.skeleton,
            trans=tube_clip.skeleton.trans.astype(">f8"),
            parents=tube_clip.skeleton.parents.astype(">i4"),
        ),
        body=replace(tube_clip.body, faces=tube_clip.body.faces.astype(np.uint16)),
    )
    kinds = {
        key: clip.arrays()[key].dtype.str for key in ("garment_vertices", "trans", "body_faces", "parents")
    }
    native = np.dtype(np.int32).str[0]
    assert kinds == {
        "garment_vertices": f"{native}f4",
        "trans": f"{native}f8",
        "body_faces": f"{native}i8",
        "parents": f"{native}i4",
    }
    np.testing.assert_array_equal(clip.garment.vertices, half)
    np.testing.assert_array_equal(clip.skeleton.trans, tube_clip.skeleton.trans)
    assert clip.body.rest is tube_clip.body.rest


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"fps": np.array([30.0, 30.0])}, "fps must be one number"),
        ({"fps": np.str_("fast")}, "fps must be one number, found <U4"),
        ({"fps": np.array([[-1.0]])}, "fps is -1"),
        ({"poses": np.array([b"x"])}, "poses: numbers are wanted, found .S1"),
        ({"garment_faces": np.array([[0, 1, 2**63]], np.uint64)}, "garment_faces: face 0 uses vertices"),
    ],
)
def test_what_is_wrong_in_a_file_is_said_with_its_name(
    tmp_path: Path, clip_file: Path, arrays: dict[str, np.ndarray], message: str
) -> None:
    path = tmp_path / "bad.npz"
    np.savez(path, **{**arrays_of(clip_file), **arrays})
    with pytest.raises(InputError, match=message) as caught:
        load_clip(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_arrays_that_do_not_fit_are_refused_before_they_are_read(
    tmp_path: Path, clip_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "bad.npz"
    np.savez(path, **{**arrays_of(clip_file), "garment_vertices": np.zeros((7, 192, 3), np.float32)})
    monkeypatch.setattr("render.files.npz.Npz.read", lambda *_: pytest.fail("read"))
    with pytest.raises(InputError, match=r"garment_vertices must have shape \(6, 192, 3\)"):
        load_clip(path)


def test_an_object_array_of_any_name_is_refused(tmp_path: Path, clip_file: Path) -> None:
    path = tmp_path / "more.npz"
    np.savez(path, **{**arrays_of(clip_file), "extra": np.array([{}], dtype=object)})
    with pytest.raises(InputError, match="extra is not a readable plain array"):
        load_clip(path)
