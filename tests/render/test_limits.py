"""Rotations, rates and memory that cannot be, at their limits."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_info

from render import InputError, memory
from render.limits import check_rate, check_rotations
from render.memory import available_bytes, check_memory
from render.threads import one_blas_thread

TURNS = Rotation.from_rotvec([[0, 0, 0], [0.3, -1, 2], [np.pi, 0, 0]]).as_matrix()


def test_rotations_are_let_pass_also_rounded_ones_and_none():
    check_rotations(TURNS, "rotation")
    check_rotations(TURNS.astype(np.float32), "rotation")
    check_rotations(TURNS[:0], "rotation")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda turn: 1.001 * turn, "R Rᵀ = 1; that of frame 2 is none"),  # by twice what is let pass
        (lambda turn: turn * [[1, 1, -1]], r"frame 2 mirrors, its determinant is -1"),
        (lambda turn: 0 * turn, "frame 2 is none"),
        (lambda turn: np.nan * turn, "frame 2 is none"),
        (lambda turn: turn[[0, 0, 2]], "frame 2 is none"),
    ],
)
def test_what_is_no_rotation_is_named_by_its_frame(spoil, message):
    with pytest.raises(InputError, match=f"maps: rotation must hold rotation matrices.*{message}"):
        check_rotations(np.stack([*TURNS[:2], spoil(TURNS[2])]), "maps: rotation")
    check_rotations(np.stack([*TURNS[:2], 1.0004 * TURNS[2]]), "maps: rotation")


def test_a_mirror_among_damaged_frames_is_not_what_is_told_first():
    with pytest.raises(InputError, match="frame 1 is none"):
        check_rotations(np.stack([-np.eye(3), np.zeros((3, 3))]), "rotation")


@pytest.mark.parametrize("fps", [0.01, 29.97, 1e4])
def test_rates_that_can_be(fps):
    check_rate(fps, "clip")


@pytest.mark.parametrize("fps", [0, -30, 0.0099, 10001, np.nan, np.inf])
def test_rates_that_cannot_be(fps):
    with pytest.raises(InputError, match=r"clip: fps is .*; a positive number .* expected, 0\.01 to 10000"):
        check_rate(fps, "clip")


def test_memory_is_asked_for_before_it_is_taken(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 2**30)
    check_memory(2**30, "maps of 8 frames")
    with pytest.raises(InputError, match=r"maps of 8 frames need 1\.5 GiB of memory, and 1\.0 GiB are free"):
        check_memory(3 * 2**29, "maps of 8 frames")
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    check_memory(2**60, "maps")


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("MemTotal: 9 kB\nMemAvailable:   2048 kB\n", 2048 * 1024),
        ("MemTotal: 9 kB\n", None),  # an old kernel
        ("MemAvailable: much\n", None),
        ("MemAvailable:\n", None),
        (None, None),  # no such file
    ],
)
def test_free_memory_is_what_the_system_says(tmp_path, monkeypatch, text, want):
    path = tmp_path / "meminfo"
    if text is not None:
        path.write_text(text)
    monkeypatch.setattr(memory, "Path", lambda name: path)
    assert available_bytes() == want


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_linear_algebra_keeps_to_one_thread_inside_and_is_let_go_after_an_error():
    before = blas_threads()
    assert before
    with one_blas_thread():
        with one_blas_thread():
            assert blas_threads() == {1}
        assert blas_threads() == {1}  # of the outer block
    assert blas_threads() == before
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        raise ZeroDivisionError
    assert blas_threads() == before


def test_a_function_can_be_kept_to_one_thread_each_time_it_is_called():
    inside = one_blas_thread()(blas_threads)
    assert inside() == inside() == {1}
