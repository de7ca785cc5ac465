"""A mesh in motion: whole and in parts, mapped, and set at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from render import InputError, Mesh, MeshSequence

SQUARE = Mesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]), "square.obj"
)
FRAMES = np.float32(SQUARE.vertices + np.arange(5)[:, None, None])


def test_frames_in_memory_are_not_copied() -> None:
    moving = MeshSequence.of_array(SQUARE, FRAMES, fps=24)
    assert (moving.n_frames, moving.fps, moving.frame_name(3)) == (5, 24, "frame 3")
    assert moving.vertices() is FRAMES or np.shares_memory(moving.vertices(), FRAMES)
    assert np.shares_memory(next(moving.parts(2)), FRAMES)
    assert [len(part) for part in moving.parts(2)] == [2, 2, 1]
    np.testing.assert_array_equal(moving.faces, SQUARE.faces)


def test_frames_of_another_mesh_are_refused() -> None:
    for wrong in (FRAMES[:, :3], FRAMES[0], FRAMES[..., :2]):
        with pytest.raises(InputError, match=r"mine: frames must have shape \(frames, 4, 3\)"):
            MeshSequence.of_array(SQUARE, wrong, source="mine")


@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_a_function_is_told_which_frames_it_gets(count: int) -> None:
    def numbered(vertices: np.ndarray, first: int) -> np.ndarray:
        return vertices[:, :3] + first + np.arange(len(vertices), dtype=np.float32)[:, None, None]

    triangle = Mesh(SQUARE.vertices[:3], np.array([[0, 1, 2]]))
    mapped = MeshSequence.of_array(SQUARE, FRAMES).mapped(numbered, triangle)
    assert mapped.mesh is triangle
    wanted = SQUARE.vertices[:3] + 2 * np.arange(5)[:, None, None]
    np.testing.assert_array_equal(np.concatenate(list(mapped.parts(count))), wanted)
    np.testing.assert_array_equal(mapped.vertices(), wanted)


def test_nothing_is_read_before_it_is_asked_for() -> None:
    asked: list[int] = []

    def seen(vertices: np.ndarray, first: int) -> np.ndarray:
        asked.append(first)
        return vertices

    mapped = MeshSequence.of_array(SQUARE, FRAMES).mapped(seen, SQUARE)
    parts = mapped.parts(2)
    assert asked == []
    next(parts)
    assert asked == [0]
    loaded = replace(mapped, frame_names=list("abcde")).loaded()
    asked.clear()
    np.testing.assert_array_equal(loaded.vertices(), FRAMES)
    assert asked == []
    assert loaded.frame_name(4) == "e"


@pytest.mark.parametrize("random_access", [True, False])
@pytest.mark.parametrize(
    "frames", [slice(None), slice(1, 4), slice(0, 5, 2), slice(-2, None), slice(3, 4), slice(9, None)]
)
def test_some_frames_are_those_of_the_whole(frames: slice, random_access: bool) -> None:
    moving = replace(MeshSequence.of_array(SQUARE, FRAMES, fps=24), frame_names=list("abcde"))
    if not random_access:
        moving = replace(moving, read_frames=None)
    some = moving.selected(frames)
    assert (some.n_frames, some.fps, some.mesh) == (len(FRAMES[frames]), 24, SQUARE)
    assert "".join(some.frame_names) == "abcde"[frames]
    for count in (1, 2, 9):
        parts = list(some.parts(count))
        assert all(len(part) == count for part in parts[:-1])
        np.testing.assert_array_equal(np.concatenate([FRAMES[:0], *parts]), FRAMES[frames])
    for number, frame in enumerate(FRAMES[frames]):
        np.testing.assert_array_equal(some.frame(number), frame)


def test_frames_that_are_not_wanted_are_not_read() -> None:
    asked: list[int] = []

    def seen(numbers: Sequence[int]) -> np.ndarray:
        asked.extend(numbers)
        return FRAMES[list(numbers)]

    moving = replace(MeshSequence.of_array(SQUARE, FRAMES), read_frames=seen)
    list(moving.selected(slice(0, None, 3)).parts(9))
    assert asked == [0, 3]


def test_a_mapped_sequence_has_single_frames_only_where_the_first_has() -> None:
    moving = MeshSequence.of_array(SQUARE, FRAMES)
    mapped = replace(moving, read_frames=None).mapped(lambda vertices, _: vertices, SQUARE)
    assert mapped.read_frames is None
    np.testing.assert_array_equal(mapped.frame(3), FRAMES[3])


def test_the_rest_pose_must_be_the_same_mesh() -> None:
    moving = MeshSequence.of_array(SQUARE, FRAMES)
    rest = replace(SQUARE, vertices=SQUARE.vertices * 2, source="rest.obj")
    assert moving.at_rest(rest).mesh is rest
    turned = replace(rest, faces=SQUARE.faces[::-1])
    message = r"square\.obj: 4 vertices and 2 triangles, but the template rest\.obj has 4 and 2, or others"
    with pytest.raises(InputError, match=message + ".* the garment's own mesh"):
        moving.at_rest(turned, "garment")
