"""The clip npz: read back equal, and clear about what is wrong with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.data.clip import Clip, load_clip, save_clip
from render import InputError


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
        np.testing.assert_array_equal(getattr(back, key), getattr(tube_clip, key))
    assert back.joint_transforms is None
    assert (back.fps, back.info, back.name) == (30.0, {"source": "synthetic", "units": "m"}, "tube_bend")


def test_a_slice_cuts_every_array_that_has_frames(tube_clip: Clip) -> None:
    cut = tube_clip.slice(slice(1, 5, 2))
    assert cut.n_frames == 2
    np.testing.assert_array_equal(cut.trans, tube_clip.trans[[1, 3]])
    np.testing.assert_array_equal(cut.garment_vertices, tube_clip.garment_vertices[[1, 3]])
    assert cut.body_rest is tube_clip.body_rest


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_clip(tmp_path / "absent.npz")


def test_a_file_that_is_no_npz(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(InputError, match="not a readable npz"):
        load_clip(tmp_path / "text.npz")


def test_pickled_objects_are_not_read(tmp_path: Path, clip_file: Path) -> None:
    np.savez(tmp_path / "bad.npz", **{**arrays_of(clip_file), "poses": np.array([{}], dtype=object)})
    with pytest.raises(InputError, match="plain arrays"):
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
        ("body_faces", np.array([[0.0, 1, 2]]), "faces must be integers"),
        ("trans", np.zeros((5, 3)), r"trans must have shape \(6, 3\), found \(5, 3\)"),
        ("body_rest", np.full((128, 3), np.nan, np.float32), "body_rest: vertex 0 is .* not finite"),
        ("fps", 0.0, "fps is 0"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tube_clip: Clip, key: str, value: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(tube_clip, **{key: value})


def test_a_vertex_that_is_not_finite_is_named_with_its_frame(tube_clip: Clip) -> None:
    vertices = tube_clip.garment_vertices.copy()
    vertices[4, 7, 1] = np.inf
    with pytest.raises(InputError, match="garment_vertices: frame 4, vertex 7"):
        tube_clip.with_garment(vertices)


def test_no_frames_are_refused(tube_clip: Clip) -> None:
    with pytest.raises(InputError, match="no frames"):
        tube_clip.slice(slice(0, 0))
