"""What the networks are told of the body around each patch of cloth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.network import NetworkConfig
from imgtransfer.network.history import earlier_steps, mixed
from imgtransfer.network.local_view import mirrored_features, mirrored_template
from imgtransfer.network.places import PLACES, mirrored_places, places
from imgtransfer.training.checkpoint import load_model, save_model
from imgtransfer.training.sampler import Frames
from tests.helpers.models import local_model_for


def test_places_mirror_each_other() -> None:
    offsets, widths = places()
    assert offsets.shape == (93, 3)
    order = mirrored_places()
    np.testing.assert_allclose(offsets[order], offsets * [-1, 1, 1], atol=1e-12)
    np.testing.assert_array_equal(order[order], np.arange(PLACES))
    np.testing.assert_array_equal(widths[order], widths)


def test_a_rigid_motion_of_the_body_is_nothing_to_any_patch(tube_clip: Clip) -> None:
    model = local_model_for(tube_clip)
    imager = model.body_imager(tube_clip)
    assert imager.view is not None
    turn = Rotation.from_rotvec([0.5, -0.9, 0.7]).as_matrix().astype(np.float32)
    moved = torch.from_numpy(tube_clip.body.rest @ turn.T + np.float32([0.2, -0.1, 0.4]))[None]
    rest = torch.from_numpy(tube_clip.body.rest)[None]
    up = torch.tensor([[0.0, 1.0, 0.0]])
    there = [imager(v, earlier=imager.view.samples(v)[:, None], up=up).local for v in (rest, moved)]
    for local in there:
        assert local is not None
        assert local[..., :-1, :, :].abs().max() < 1e-5
    covered = imager.view.template().covered[0]
    vertical = there[1][0, ..., -1, 0, :][covered]
    expected = torch.from_numpy(0.1 * turn[1]).expand_as(
        vertical
    )  # the world's up in the turned patch's own axes
    torch.testing.assert_close(vertical, expected, rtol=0, atol=1e-4)


def test_each_place_tells_what_a_plain_loop_finds(tube_clip: Clip) -> None:
    """Against the definition: Gaussian means of the samples around the place, relative to the patch's rigid motion."""
    model = local_model_for(tube_clip)
    imager = model.body_imager(tube_clip)
    view = imager.view
    assert view is not None
    frames = root_frames(tube_clip, "root")
    bodies = torch.from_numpy(frames.to_canonical(tube_clip.body.vertices))
    maps = imager(bodies[3:4], earlier=view.samples(bodies[1:2])[:, None])
    assert maps.guess is not None
    assert maps.guess.rotation is not None
    assert maps.local is not None
    offsets, widths = places()
    template = model.imager.operator(torch.from_numpy(model.imager.mesh.vertices))
    rest = view.samples(torch.from_numpy(tube_clip.body.rest)).double().numpy()
    now, before = (view.samples(bodies[k]).double().numpy() for k in (3, 1))
    rows, columns = maps.local.shape[2:4]
    height, width = model.imager.size
    patch = height // rows
    checked = 0
    for row, column in [(rows // 2, columns // 2), (1, columns // 2)]:
        inside = np.zeros((2, height, width), bool)
        inside[0, row * patch : (row + 1) * patch, column * patch : (column + 1) * patch] = True
        pixels = np.argwhere(inside & model.imager.mask.numpy())
        points = template.numpy()[tuple(pixels.T)]
        nearest = pixels[np.square(points - points.mean(0)).sum(1).argmin()]
        centre = template.numpy()[tuple(nearest)]
        turn = maps.guess.rotation[0].double().numpy()[tuple(nearest)]
        anchor = maps.guess.positions[0].double().numpy()[tuple(nearest)]
        for place in (0, 7, 40, 92):
            weight = np.exp(-np.square(rest - centre - offsets[place]).sum(1) / (2 * widths[place] ** 2))
            mass = weight.sum()
            weight = weight / (mass + 0.05) * np.sqrt(mass / (mass + 1))
            displaced = [
                sum(
                    w * (turn.T @ (x - anchor) - (r - centre))
                    for w, x, r in zip(weight, samples, rest, strict=True)
                )
                for samples in (now, before)
            ]
            made = maps.local[0, 0, row, column, place].double().numpy()
            np.testing.assert_allclose(made, [displaced[0], displaced[1] - displaced[0]], atol=2e-5)
            checked += np.abs(made).max() > 1e-3
    assert checked >= 2  # the tube bends


def test_mirroring_twice_changes_nothing(tube_clip: Clip) -> None:
    model = local_model_for(tube_clip)
    imager = model.body_imager(tube_clip)
    assert imager.view is not None
    bodies = torch.from_numpy(root_frames(tube_clip, "root").to_canonical(tube_clip.body.vertices))
    local = imager(bodies, earlier=imager.view.samples(bodies)[:, None]).local
    assert local is not None
    torch.testing.assert_close(mirrored_features(mirrored_features(local)), local, rtol=0, atol=0)
    template = imager.view.template()
    again = mirrored_template(mirrored_template(template))
    for name in ("images", "places", "covered"):
        assert torch.equal(getattr(again, name), getattr(template, name))


def test_the_other_views_change_what_is_predicted_for_one(tube_clip: Clip) -> None:
    model = local_model_for(tube_clip)
    imager = model.body_imager(tube_clip)
    assert imager.view is not None
    bodies = torch.from_numpy(root_frames(tube_clip, "root").to_canonical(tube_clip.body.vertices))[:1]
    maps = imager(bodies, earlier=imager.view.samples(bodies)[:, None])
    assert maps.local is not None
    spoilt = maps.local.clone()
    spoilt[:, 1] += 0.1
    template = imager.view.template()
    same, changed = (
        model(replace(maps, local=local), garment=template).positions[:, 0] for local in (maps.local, spoilt)
    )
    assert (same - changed).abs().max() > 1e-5


@pytest.mark.parametrize(
    ("seconds", "fps", "steps"),
    [
        ((0.1,), 30.0, [(3, 3, 0.0)]),
        ((0.1, 0.25), 30.0, [(3, 3, 0.0), (7, 8, 0.5)]),
        ((0.1,), 24.0, [(2, 3, 0.4)]),
        ((0.01,), 30.0, [(0, 1, 0.3)]),
        ((), 30.0, []),
    ],
)
def test_earlier_times_in_frames(
    seconds: tuple[float, ...], fps: float, steps: list[tuple[int, int, float]]
) -> None:
    made = earlier_steps(seconds, fps)
    assert [step[:2] for step in made] == [step[:2] for step in steps]
    np.testing.assert_allclose([step[2] for step in made], [step[2] for step in steps], atol=1e-9)


def test_times_between_frames_are_mixed_by_hand() -> None:
    near, far = np.zeros((1, 3), np.float32), np.full((1, 3), 4.0, np.float32)
    assert mixed(near, far, 0.0) is near
    np.testing.assert_array_equal(mixed(near, far, 0.25), np.full((1, 3), 1.0, np.float32))


def test_training_frames_know_the_body_some_time_before(tube_clip: Clip) -> None:
    """0.05 s at the clip's 30 frames a second lie between one frame and two before; at the start the body stands."""
    frames = Frames.from_clips([tube_clip, tube_clip], "root", history_s=(0.05,))
    count = tube_clip.n_frames
    index = torch.tensor([0, 3, count, count + 4])
    earlier, up = frames.earlier(index)
    roots = root_frames(tube_clip, "root")
    world = tube_clip.body.vertices.astype(np.float64)
    back = 0.05 * tube_clip.fps
    for row, frame in enumerate([0, 3, 0, 4]):
        near, far = max(frame - int(back), 0), max(frame - int(back) - 1, 0)
        expected = (1 - back % 1) * world[near] + back % 1 * world[far]
        own = (expected - roots.translation[frame]) @ roots.rotation[frame]
        np.testing.assert_allclose(earlier[row, 0].numpy(), own, atol=1e-5)
        np.testing.assert_allclose(up[row].numpy(), roots.rotation[frame].T @ [0, 1, 0], atol=1e-6)


def test_a_clip_predicted_in_parts_equals_the_whole(tube_clip: Clip) -> None:
    model = local_model_for(tube_clip)
    whole = model.predictor(tube_clip)(tube_clip)
    parts = model.predictor(tube_clip)
    cut = [parts(tube_clip.slice(slice(*ends))) for ends in ((0, 1), (1, 4), (4, tube_clip.n_frames))]
    made = torch.cat([part.positions for part in cut])
    torch.testing.assert_close(made, whole.positions, rtol=0, atol=1e-6)
    alone = model.predictor(tube_clip)(tube_clip.slice(slice(4, 5)))
    assert (
        alone.positions - whole.positions[4:5]
    ).abs().max() > 1e-5  # without what went before it is another


def test_a_model_comes_back_from_its_file(tube_clip: Clip, tmp_path: object) -> None:
    model = local_model_for(tube_clip)
    again = load_model(save_model(f"{tmp_path}/model.safetensors", model))
    assert again.network == model.network
    assert torch.equal(again.predict(tube_clip).positions, model.predict(tube_clip).positions)


@pytest.mark.parametrize(
    ("switches", "said"),
    [
        ({"body": "local"}, "target: residual"),
        ({"body": "local", "target": "residual", "frame": "canonical"}, "frame: body"),
        ({"body": "local", "target": "residual", "frame": "body", "shortcuts": True}, "shortcuts: false"),
        ({"history_s": [0.1]}, "body: local"),
        ({"body": "local", "target": "residual", "frame": "body", "history_s": [0.0]}, "history_s"),
    ],
)
def test_switches_that_do_not_go_together(switches: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        NetworkConfig.model_validate(switches)
