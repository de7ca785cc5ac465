"""How the networks begin, so that the first hundred steps are not lost, and what the first layer leaves out."""

import numpy as np
import torch
from torch import nn

from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig
from imgtransfer.deformers.motion_guided.method import _begin
from imgtransfer.deformers.motion_guided.networks import perceptron
from imgtransfer.deformers.motion_guided.training import Stages, begin_codes, training_clip
from tests.helpers.synthetic import tube_clip

CONFIG = MotionGuidedConfig(seeds=12, uv_size=8, channels=(16, 32), features=8, latent=6)


def _begun(config=CONFIG, clips=2):
    torch.manual_seed(0)
    clip = tube_clip(12)
    model = _begin(clip, config)
    chosen = model.seeds.numpy()
    return model, [training_clip(clip, chosen, torch.device("cpu"))] * clips


def test_the_perceptron_keeps_the_size_of_what_goes_through_it():
    torch.manual_seed(0)
    hidden = perceptron(34, 32)[:-1](torch.randn(1000, 34)).detach()
    assert 0.3 < float(hidden.std(0).mean()) < 3


def test_codes_begin_uncorrelated_with_mean_0_and_variance_1():
    model, (clip, _) = _begun()
    begin_codes(model, [clip])
    with torch.no_grad():
        code = model.static_code(clip.garment, clip.body.seeds.points, clip.rest)
    np.testing.assert_allclose(code.mean(0), 0, atol=1e-3)
    np.testing.assert_allclose(code.T @ code / len(code), np.eye(6), atol=5e-3)


def test_numbers_that_few_frames_cannot_tell_apart_begin_at_0():
    model, (clip, _) = _begun(CONFIG.model_copy(update={"latent": 16}))
    begin_codes(model, [clip])
    with torch.no_grad():
        code = model.static_code(clip.garment, clip.body.seeds.points, clip.rest)
    assert bool((code[:, 12:] == 0).all())  # twelve frames less their mean have at most eleven directions
    assert bool(code.isfinite().all())


def test_the_dynamics_begin_with_the_code_of_the_last_frame():
    model, (clip, _) = _begun()
    model.dynamics.begin_still(model.space.encoder)
    seeds = clip.body.seeds[3:]
    with torch.no_grad():
        features = model.static_features(clip.garment[2:-1], clip.body.seeds.points[2:-1], clip.rest)
        told = model.dynamics(features, model.motion_map(clip.before, seeds))
        torch.testing.assert_close(told, model.space.encoder(features))


def test_features_equal_those_of_the_whole_map_of_descriptors():
    model, (clip, _) = _begun()
    points, seeds = clip.garment[:3], clip.body.seeds.points[:3]

    def around(points, seeds):
        return (model.maps.at_pixels(points)[:, :, None] - seeds[:, None]).flatten(2)

    whole = (around(points, seeds) - around(clip.rest.vertices[None], clip.rest.seeds[None])) / 0.1
    with torch.no_grad():
        wanted = nn.Sequential(*model.space.project)(model.maps.image(whole))
        torch.testing.assert_close(
            model.static_features(points, seeds, clip.rest), wanted, rtol=1e-3, atol=1e-5
        )


def test_a_batch_is_of_all_clips_and_its_terms_are_means_over_its_frames():
    model, clips = _begun(CONFIG.model_copy(update={"batch_frames": 24}))
    stages = Stages(CONFIG.model_copy(update={"batch_frames": 24}), model, clips, 0)
    parts = stages._draw(0, 0)
    assert [frames.tolist() for _, frames in parts] == [list(range(12))] * 2
    terms, single = stages.static(0), stages._static(clips[0], torch.arange(12))
    torch.testing.assert_close(terms["reconstruction"], single["reconstruction"])
