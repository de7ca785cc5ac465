"""What is measured of a clip at a glance, on clips whose strain and penetration are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imgtransfer.data.clip import Clip
from imgtransfer.evaluation.summary import SAMPLED_FRAMES, edge_strain, summarise
from render import InputError
from tests.helpers import synthetic

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_strain_of_edges_by_hand() -> None:
    wide = SQUARE * np.float32([2, 1, 1])
    strain = edge_strain(np.stack([SQUARE, wide]), SQUARE, FACES)
    assert strain.dtype == np.float64
    np.testing.assert_allclose(strain[0], 0, atol=1e-12)
    # Two sides twice as long, two as they were, and the diagonal from √2 to √5.
    np.testing.assert_allclose(np.sort(strain[1]), [0, 0, np.sqrt(2.5) - 1, 1, 1], atol=1e-7)


def test_strain_does_not_depend_on_unit_or_place() -> None:
    random = np.random.default_rng(0)
    moved = SQUARE + random.normal(0, 0.1, (3, 4, 3))
    turn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    strain = edge_strain(moved, SQUARE, FACES)
    np.testing.assert_allclose(edge_strain(1000 * moved, 1000 * SQUARE, FACES), strain, atol=1e-9)
    np.testing.assert_allclose(edge_strain(moved @ turn.T + 5, SQUARE, FACES), strain, atol=1e-9)


def test_edges_without_a_length_are_left_out_and_a_template_of_such_alone_is_refused() -> None:
    folded = SQUARE.copy()
    folded[1] = folded[0]
    strain = edge_strain(SQUARE[None], folded, FACES)
    assert strain.shape == (1, 4)
    assert np.isfinite(strain).all()
    with pytest.raises(InputError, match="template: all its edges have length 0"):
        edge_strain(SQUARE[None], np.zeros_like(SQUARE), FACES)


def test_a_clip_that_does_not_stretch_has_no_strain_and_one_that_grows_has_that_of_all_edges(
    tube_clip: Clip,
) -> None:
    template = np.tile(tube_clip.template.vertices, (6, 1, 1))
    still = summarise(tube_clip.with_garment(template))
    assert still.strain == pytest.approx((0, 0), abs=1e-4)
    grown = summarise(tube_clip.with_garment(1.03 * template))
    assert grown.strain == pytest.approx((3, 3), abs=1e-3)  # per cent


def test_penetration_is_the_part_of_vertices_inside_the_body(tube_clip: Clip) -> None:
    assert summarise(tube_clip).penetration == 0
    vertices = tube_clip.garment.vertices.copy()
    vertices[:3, :96] = tube_clip.body.vertices[:3].mean(
        axis=1, keepdims=True
    )  # half of them in three of six frames
    assert summarise(tube_clip.with_garment(vertices)).penetration == pytest.approx(25)


def test_crossings_are_means_over_the_frames(tube_clip: Clip) -> None:
    assert (summarise(tube_clip).crossing, summarise(tube_clip).self_crossing) == (0, 0)
    aside = tube_clip.garment.vertices.copy()
    aside[:3, :, 0] += 0.1  # three of six frames
    all_six = summarise(tube_clip.with_garment(aside)).crossing
    three = summarise(tube_clip.with_garment(aside).slice(slice(0, 3))).crossing
    assert all_six > 1
    assert three == pytest.approx(2 * all_six)


def test_sizes_and_names(tube_clip: Clip) -> None:
    summary = summarise(tube_clip)
    assert (summary.name, summary.frames, summary.fps) == ("tube/bend", 6, 30.0)
    assert (summary.garment_vertices, summary.garment_faces) == (192, 2 * 11 * 16)
    assert (summary.body_vertices, summary.body_faces) == (128, 2 * 8 * 14 + 28)
    assert summary.sampled == 6


def test_of_long_clips_some_frames_are_measured_first_and_last_among_them() -> None:
    clip = synthetic.tube_clip(40)
    assert summarise(clip).sampled == SAMPLED_FRAMES
    wild = np.tile(clip.template.vertices, (40, 1, 1))
    wild[[0, -1]] *= 2
    summary = summarise(clip.with_garment(wild))
    assert summary.strain is not None
    assert summary.strain[1] == pytest.approx(100, abs=0.1)  # two of twelve frames are more than a hundredth
    assert summary.strain[0] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("frames", [1, 2])
def test_short_clips_count_every_frame_once(tube_clip: Clip, frames: int) -> None:
    assert summarise(synthetic.tube_clip(frames)).sampled == frames


def test_a_clip_without_a_garment_has_no_strain(tube_clip: Clip) -> None:
    summary = summarise(replace(tube_clip, garment=None))
    assert (summary.strain, summary.penetration) == (None, None)
    assert (summary.crossing, summary.self_crossing) == (None, None)
