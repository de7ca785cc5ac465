"""Grown maps are judged by what they were before they grew."""

from functools import cache

import numpy as np
import pytest
import torch

from fusion.grown_maps import GrownMaps
from fusion.robust.automatic_confidence import AutomaticConfidence
from tests.helpers.fusion_examples import imager_of, true_maps, tube, wrinkled

CPU = torch.device("cpu")


@cache
def scene():
    """Imager of a tube, what judges its maps, true positions (1, S, H, W, 3), and the same grown with 2 pixels off."""
    mesh = tube()
    imager = imager_of(mesh, (64, 64))
    truth, _ = true_maps(imager, wrinkled(mesh, 1))
    return imager, AutomaticConfidence(imager, mesh, CPU), truth, GrownMaps(imager, imager.mask.numpy(), 2)


def wild(truth: torch.Tensor, covered: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """True positions of which one covered pixel in fifteen is 30 cm off, and which those are."""
    rng = np.random.default_rng(3)
    hit = torch.from_numpy(rng.random(truth.shape[:-1]) < 1 / 15) & covered
    off = torch.from_numpy(rng.normal(size=truth.shape)).float()
    return truth + 0.3 * hit[..., None] * off / off.norm(dim=-1, keepdim=True), hit


def test_single_wild_pixels_are_found_though_the_maps_have_grown_and_do_not_spread():
    imager, automatic, truth, grown = scene()
    spoilt, hit = wild(truth, imager.mask)
    positions = torch.from_numpy(grown(spoilt.numpy()))
    judged = grown.judged(automatic, positions, None)
    inside = torch.from_numpy(grown._trusted)
    assert (judged.confidence[hit & inside] == 0).all()
    assert (judged.confidence[~hit & inside] > 0).float().mean() > 0.98
    rim = (imager.mask & ~inside)[None]
    error = (judged.positions - truth).norm(dim=-1)
    without = (positions - truth).norm(dim=-1)
    assert error[rim].max() < 0.03
    assert without[rim].max() > 0.1
    assert judged.findings.left_out[0] == pytest.approx(float((hit & inside).sum() / inside.sum()), abs=0.02)


def test_maps_that_hold_together_are_the_ones_given():
    _, automatic, truth, grown = scene()
    positions = torch.from_numpy(grown(truth.numpy()))
    judged = grown.judged(automatic, positions, None)
    assert judged.positions is positions
    assert judged.confidence is None
    confidence = torch.full(positions.shape[:-1], 0.5)
    assert grown.judged(automatic, positions, confidence).confidence is confidence


def test_the_confidence_given_counts_for_what_grows():
    imager, automatic, truth, grown = scene()
    spoilt, _ = wild(truth, imager.mask)
    positions = torch.from_numpy(grown(spoilt.numpy()))
    half = grown.judged(automatic, positions, torch.full(positions.shape[:-1], 0.5))
    whole = grown.judged(automatic, positions, None)
    torch.testing.assert_close(half.confidence, 0.5 * whole.confidence)
    torch.testing.assert_close(half.positions, whole.positions)


def test_frames_are_judged_each_by_itself():
    imager, automatic, truth, grown = scene()
    spoilt, _ = wild(truth, imager.mask)
    positions = torch.from_numpy(grown(torch.cat([truth, spoilt]).numpy()))
    both, alone = grown.judged(automatic, positions, None), grown.judged(automatic, positions[1:], None)
    assert torch.equal(both.positions[0], positions[0])
    assert (both.confidence[0] == 1).all()
    assert torch.equal(both.positions[1], alone.positions[0])
    assert torch.equal(both.confidence[1], alone.confidence[0])
