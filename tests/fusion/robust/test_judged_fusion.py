"""What the judgement of maps changes in a fusion: nothing where they hold together, much where they do not."""

import numpy as np
import pytest
import torch

from fusion import FusionConfig, fuse
from tests.helpers.fusion_examples import imager_of, inputs_of, true_maps, tube, wrinkled

IMAGER = imager_of(tube())
TRUTH = wrinkled(tube(), 3)
POSITIONS, NORMALS = true_maps(IMAGER, TRUTH)


def fused(positions, *, confidence=None, **config):
    inputs = inputs_of(positions=positions, normals=NORMALS, confidence=confidence)
    return fuse(IMAGER, inputs, FusionConfig(edge_steps=10, normal_steps=5, **config))


def error_mm(result):
    return 1000 * float(np.linalg.norm(result.vertices - TRUTH.numpy(), axis=-1).mean())


def with_outliers(frames=slice(None)):
    random = torch.Generator().manual_seed(0)
    wrong = (torch.rand(POSITIONS.shape[:-1], generator=random) < 0.1) & IMAGER.mask
    positions = POSITIONS.clone()
    positions[frames] += (0.2 * torch.randn(POSITIONS.shape, generator=random) * wrong[..., None])[frames]
    return positions


@pytest.mark.parametrize("solver", ["local_global", "adam"])
def test_maps_that_hold_together_give_the_same_bit_for_bit(solver):
    judged = fused(POSITIONS, solver=solver)
    plain = fused(POSITIONS, solver=solver, automatic_confidence=False)
    np.testing.assert_array_equal(judged.vertices, plain.vertices)
    assert judged.report["left_out_percent"] == 0
    assert judged.report["faults"] == []
    assert "left_out_percent" not in plain.report


@pytest.mark.parametrize("solver", ["local_global", "adam"])
def test_one_pixel_in_ten_elsewhere_does_little_harm(solver):
    positions = with_outliers()
    judged, plain = (fused(positions, solver=solver, automatic_confidence=on) for on in (True, False))
    assert error_mm(judged) < 0.3 * error_mm(plain)
    assert judged.report["left_out_percent"] == pytest.approx(10, abs=2)


def test_percentages_are_of_the_clip_however_it_is_cut():
    positions = with_outliers(slice(1, 2))
    whole, cut = (fused(positions, batch_frames=size) for size in (8, 1))
    assert whole.report["left_out_percent"] == pytest.approx(cut.report["left_out_percent"])
    assert whole.report["left_out_percent"] == pytest.approx(10 / 3, abs=1)
    assert whole.report["faults"] == cut.report["faults"]
    np.testing.assert_allclose(whole.vertices, cut.vertices, atol=1e-5)


def test_faults_are_counted_by_the_clip_s_frames():
    positions = POSITIONS.clone()
    positions[2] *= 1.2
    (fault,) = fused(positions, batch_frames=2).report["faults"]
    assert (fault["kind"], fault["frames"], fault["n_frames"]) == ("scale", [2, 2], 1)


def test_a_given_start_has_no_position_maps_to_judge():
    report = fuse(IMAGER, inputs_of(initial=TRUTH, normals=NORMALS)).report
    assert "left_out_percent" not in report
