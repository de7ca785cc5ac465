"""Smoothing over time: what stays, what goes, without lag, and the same whatever the batches."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch

from fusion import BodySdf, FusionConfig, FusionInputs, MovingSurface, PinnedVertices, fuse
from fusion.crossing_report import CrossingFractions
from fusion.smoothing import TemporalSmoothing, period_in_frames, smoothed_paths
from fusion.stages import BatchResult
from render import InputError
from tests.helpers.fusion_examples import (
    cylinder_body,
    imager_of,
    inputs_of,
    leaning,
    true_maps,
    tube,
    wrinkled,
)

UNCROSSED = CrossingFractions(None, np.zeros(0))
RANDOM = np.random.default_rng(8)


def paths(values: np.ndarray) -> np.ndarray:
    """(T,) -> (T, 1, 3): one vertex that moves along x."""
    return np.stack([values, 0 * values, 0 * values], axis=-1)[:, None]


def test_three_frames_by_hand() -> None:
    """Period 2: κ = 1/16. One second difference: x = y − d κ/(1 + 6κ) (1, −2, 1), here 3 of (0, 3, 0) with d = −6."""
    smooth = smoothed_paths(paths(np.array([0.0, 3.0, 0.0])), 2.0)[:, 0, 0]
    step = -6 / 16 / (1 + 6 / 16)
    np.testing.assert_allclose(smooth, [-step, 3 + 2 * step, -step], atol=1e-12)


def test_equals_a_dense_system() -> None:
    frames, period = 40, 7.3
    noise = RANDOM.normal(size=(frames, 5, 3))
    bend = np.zeros((frames - 2, frames))
    for row in range(frames - 2):
        bend[row, row : row + 3] = 1, -2, 1
    system = np.eye(frames) + bend.T @ bend / (2 * np.sin(np.pi / period)) ** 4
    wanted = np.linalg.solve(system, noise.reshape(frames, -1)).reshape(noise.shape)
    np.testing.assert_allclose(smoothed_paths(noise, period), wanted, atol=1e-12)


def test_a_ramp_stays_to_its_ends() -> None:
    ramp = paths(0.3 * np.arange(50) - 4)
    np.testing.assert_allclose(smoothed_paths(ramp, 9.0), ramp, atol=1e-10)


@pytest.mark.parametrize(("period", "gain"), [(12.0, 0.5), (24.0, 0.9394), (60.0, 0.9983), (4.0, 0.01764)])
def test_a_sine_keeps_its_phase_and_loses_what_is_said_of_its_height(period: float, gain: float) -> None:
    time = np.arange(1200)
    wave = np.exp(2j * np.pi * time / period)
    smooth = [smoothed_paths(paths(part), 12.0)[:, 0, 0] for part in (wave.real, wave.imag)]
    middle = slice(300, 900)
    ratio = (smooth[0] + 1j * smooth[1])[middle] / wave[middle]
    by_formula = 1 / (1 + (np.sin(np.pi / period) / np.sin(np.pi / 12)) ** 4)
    np.testing.assert_allclose(ratio, by_formula, atol=1e-9)  # real: no phase
    assert by_formula == pytest.approx(gain, rel=1e-3)


def test_backwards_is_the_same_and_a_shift_goes_through() -> None:
    noise = RANDOM.normal(size=(30, 4, 3))
    smooth = smoothed_paths(noise, 6.0)
    np.testing.assert_allclose(smoothed_paths(noise[::-1], 6.0)[::-1], smooth, atol=1e-10)
    np.testing.assert_allclose(smoothed_paths(noise + 7.0, 6.0), smooth + 7, atol=1e-10)


@pytest.mark.parametrize("frames", [1, 2])
def test_fewer_than_three_frames_stay(frames: int) -> None:
    noise = RANDOM.normal(size=(frames, 4, 3))
    np.testing.assert_array_equal(smoothed_paths(noise, 6.0), noise)


def in_batches(vertices: np.ndarray, size: int, smoothing: TemporalSmoothing) -> Iterator[BatchResult]:
    parts = [vertices[first : first + size] for first in range(0, len(vertices), size)]
    inputs = smoothing.noting(FusionInputs(initial=part) for part in parts)
    solved = (
        BatchResult(part, part, {}, np.zeros(len(part)), None, UNCROSSED)
        for part, _ in zip(parts, inputs, strict=True)
    )
    return smoothing.smoothed(solved)


@pytest.mark.parametrize("size", [1, 7, 8, 50, 200])
def test_batches_equal_the_whole_clip(size: int) -> None:
    vertices = RANDOM.normal(size=(120, 6, 3)).astype(np.float32)
    smoothing = TemporalSmoothing(5.0, lambda _, before, smooth: (smooth, None), 30.0)
    batches = list(in_batches(vertices, size, smoothing))
    assert [len(batch.vertices) for batch in batches] == [
        len(part) for part in np.split(vertices, range(size, 120, size))
    ]
    whole = smoothed_paths(vertices, 5.0)
    found = np.concatenate([batch.vertices for batch in batches])
    np.testing.assert_allclose(found, whole, atol=3e-7)
    accelerations = smoothing.report()["acceleration_m_s2"]
    for name, clip in (("before_smoothing", vertices), ("after", whole)):
        wanted = 900 * np.linalg.norm(np.diff(clip.astype(float), 2, axis=0), axis=-1).mean()
        assert accelerations[name] == pytest.approx(wanted, rel=1e-5)


def test_no_more_frames_are_taken_than_reach_and_a_batch() -> None:
    """With period 5 twenty frames on either side count: of 2 a batch, 11 batches have come when the first leaves."""
    taken = []

    def counted() -> Iterator[FusionInputs]:
        for number in range(100):
            taken.append(number)
            yield FusionInputs(initial=np.zeros((2, 1, 3)))

    smoothing = TemporalSmoothing(5.0, lambda _, before, smooth: (smooth, None), 30.0)
    still = np.zeros((2, 1, 3), np.float32)
    solved = (
        BatchResult(still, still, {}, np.zeros(2), None, UNCROSSED) for _ in smoothing.noting(counted())
    )
    next(smoothing.smoothed(solved))
    assert len(taken) == 11


def test_less_than_two_frames_and_an_unknown_rate_are_refused() -> None:
    config = FusionConfig(smooth_time_s=0.05)
    assert period_in_frames(config, 60) == pytest.approx(3)
    with pytest.raises(
        InputError, match=r"smooth_time_s is 0.05, less than two frames at 30 .* at least 0.067, or 0"
    ):
        period_in_frames(config, 30)
    with pytest.raises(InputError, match="how many frames a second there are is not known; give fps, too"):
        period_in_frames(config, None)
    with pytest.raises(InputError, match="fps"):
        period_in_frames(config, float("nan"))


@pytest.fixture(scope="module")
def shaken():
    """Imager, and inputs of ten frames of a garment that jumps by 8 mm to and fro, beside a body that leans."""
    mesh, body = tube(), cylinder_body()
    imager = imager_of(mesh, (48, 48))
    truth = np.repeat(wrinkled(mesh, 1).numpy(), 10, axis=0)
    truth[1::2, :, 0] += 0.008
    positions, normals = true_maps(imager, torch.from_numpy(truth))
    bodies = leaning(np.asarray(body.vertices), 10)
    inputs = inputs_of(positions=positions, normals=normals, body=(bodies, np.asarray(body.faces)))
    return imager, replace(inputs, fps=30.0)


def jumps(vertices: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(vertices, 2, axis=0), axis=-1).mean())


@pytest.mark.parametrize("solver", ["local_global", "adam"])
def test_a_clip_that_shakes_is_calmed_whatever_the_batch_and_stays_outside_of_the_body(
    shaken, solver: str
) -> None:
    imager, inputs = shaken
    few = {"edge_steps": 5, "normal_steps": 5, "solver": solver}
    rough = fuse(imager, inputs, FusionConfig(**few))
    smooth = [
        fuse(imager, inputs, FusionConfig(**few, smooth_time_s=0.2, batch_frames=size)) for size in (3, 10)
    ]
    assert jumps(smooth[0].vertices) < 0.2 * jumps(rough.vertices)
    np.testing.assert_allclose(
        smooth[0].vertices, smooth[1].vertices, atol=2e-5 if solver == "local_global" else 1e-6
    )
    body = BodySdf(inputs.body.faces, inputs.body.vertices.shape[1])
    body.update(inputs.body.vertices)
    assert body.query(torch.from_numpy(smooth[0].vertices)).distance.min() > 0
    assert smooth[0].report["penetration_percent"]["after"] == 0
    measured = smooth[0].report["acceleration_m_s2"]
    assert measured["after"] == pytest.approx(900 * jumps(smooth[0].vertices), rel=1e-4)
    assert measured["before_smoothing"] == pytest.approx(900 * jumps(rough.vertices), rel=1e-3)
    assert "acceleration_m_s2" not in rough.report


def test_pins_stay_where_they_are_held(shaken) -> None:
    imager, inputs = shaken
    places = RANDOM.normal(scale=0.01, size=(10, 2, 3)).astype(np.float32) + np.float32([0, 0.5, 0.3])
    pinned = FusionInputs(maps=inputs.maps, pins=PinnedVertices(np.array([3, 40]), places), fps=30.0)
    config = FusionConfig(edge_iterations=3, normal_iterations=3, smooth_time_s=0.2)
    np.testing.assert_array_equal(fuse(imager, pinned, config).vertices[:, [3, 40]], places)


def test_a_body_that_moves_into_the_smoothed_garment_pushes_it_out(shaken) -> None:
    """A body that jumps takes the garment with it; halfway between, the smoothed garment would be in it."""
    imager, inputs = shaken
    bodies = inputs.body.vertices.clone()
    bodies[5:] += torch.tensor([0.06, 0.0, 0.0])
    moved = FusionInputs(maps=inputs.maps, body=MovingSurface(bodies, inputs.body.faces), fps=30.0)
    result = fuse(imager, moved, FusionConfig(smooth_time_s=0.3))
    assert result.report["penetration_percent"]["after"] == 0
