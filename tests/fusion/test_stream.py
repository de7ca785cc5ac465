"""A fusion of files, some frames at a time: the same numbers as of arrays in memory, and no more frames than needed."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from fusion import FusionConfig, FusionInputs, fuse_map_parts, fuse_maps, parallel
from fusion.report import _StageSums
from fusion.stages import SolverResult
from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import load_clip, written_clip
from imgtransfer.data.sequences import clip_reader, open_clip_arrays
from imgtransfer.pipeline.fuse import FuseInputs, FuseOptions, fuse_into
from render import InputError, load_maps, open_maps, written_maps
from tests.helpers.fusion_examples import inputs_of, write_example

ORDER = (0, 1, 1, 0, 1)  # of the example's two frames
QUICK = {"edge_iterations": 3, "normal_iterations": 3}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Maps and a clip of five frames, written frame by frame."""
    folder = tmp_path_factory.mktemp("stream")
    write_example(folder, 2)
    maps, clip = load_maps(folder / "maps.npz"), load_clip(folder / "clip.npz")
    clip = replace(clip, info=clip.info | {"made": "the clip's own"})
    with written_maps(folder / "long.npz") as add_maps, written_clip(folder / "longer.npz") as add_clip:
        for frame in ORDER:
            add_maps(maps.part(slice(frame, frame + 1)))
            add_clip(clip.slice(slice(frame, frame + 1)))
    return folder


@pytest.fixture(params=[1, 2])
def threads(request):
    token = parallel._threads.set(request.param)
    yield request.param
    parallel._threads.reset(token)


@pytest.mark.parametrize("batch", [1, 3, len(ORDER)])
def test_files_give_what_arrays_give(folder, tmp_path, threads, batch):
    config = FusionConfig(**QUICK, batch_frames=batch)
    maps, clip = load_maps(folder / "long.npz"), load_clip(folder / "longer.npz")
    frames = RootFrames(maps.rotation, maps.translation)
    want = fuse_maps(maps, inputs_of(body=(frames.to_canonical(clip.body.vertices), clip.body.faces)), config)
    given = FuseInputs(
        body=open_clip_arrays(folder / "longer.npz", "body"), clip=clip_reader(folder / "longer.npz")
    )
    done = []
    report = fuse_into(
        tmp_path,
        open_maps(folder / "long.npz"),
        given,
        FuseOptions(config=config),
        meshes="ply",
        progress=done.append,
    )
    found = load_clip(tmp_path / "fused.npz")
    np.testing.assert_array_equal(found.garment.vertices, frames.to_world(want.vertices))
    np.testing.assert_array_equal(found.body.vertices, clip.body.vertices)
    assert clip.info["made"] == "the clip's own"
    assert "made" not in found.info
    assert sum(done) == len(list((tmp_path / "meshes").iterdir())) == len(ORDER)
    for key in ("terms", "total", "iterations", "unseen_percent", "penetration_percent"):
        assert json.dumps(report[key]) == json.dumps(want.report[key])
    assert json.loads((tmp_path / "fusion.json").read_text())["frames"] == len(ORDER)


def test_no_more_batches_are_fetched_than_keep_the_threads_busy(folder, threads):
    maps, under_way = open_maps(folder / "long.npz"), []

    def parts(size):
        under_way.clear()
        for part in maps.parts(size):
            under_way.append(part.n_frames)
            assert sum(under_way) <= threads + 1
            yield part, FusionInputs()

    config = FusionConfig(**QUICK, batch_frames=1)
    fuse_map_parts(maps, parts, lambda batch: under_way.pop(), config)
    assert not under_way


def test_what_is_wrong_with_a_late_frame_is_named_and_leaves_nothing(folder, tmp_path):
    maps = load_maps(folder / "maps.npz")
    bad = maps.part(slice(1, 2))
    with written_maps(tmp_path / "bad.npz") as add:
        add(maps)
        add(maps)
        bad.position[0, 0][maps.mask[0]] = np.nan  # of `maps`, too
        add(bad)
    config = FusionConfig(**QUICK, batch_frames=2)
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"bad\.npz: frames 4 to 4: maps: position must be finite"):
        fuse_into(out, open_maps(tmp_path / "bad.npz"), FuseInputs(), FuseOptions(config=config))
    assert list(out.iterdir()) == []


def test_confidence_of_a_late_frame_counts_for_all(folder, tmp_path):
    """Files whose pixels all count alike are read as if they had no confidence, which one pixel changes."""
    maps = load_maps(folder / "long.npz")
    confidence = np.ones(maps.position.shape[:-1], np.float32)
    confidence[-1, 0][maps.mask[0]] = 0.5
    weighted = {name: getattr(maps, name) for name in maps.__dataclass_fields__} | {"confidence": confidence}
    with written_maps(tmp_path / "w.npz") as add:
        for part in type(maps)(**weighted).parts(2):
            add(part)
    config = FusionConfig(**QUICK, batch_frames=2)
    fuse_into(tmp_path / "out", open_maps(tmp_path / "w.npz"), FuseInputs(), FuseOptions(config=config))
    want = fuse_maps(load_maps(tmp_path / "w.npz"), config=config)
    with np.load(tmp_path / "out" / "fused.npz") as found:
        frames = RootFrames(maps.rotation, maps.translation)
        np.testing.assert_array_equal(found["garment_vertices"], frames.to_world(want.vertices))


def test_frames_that_finish_sooner_stay_at_their_last_value_in_the_means():
    """Three frames, with 2, 3 and 3 values: means by hand."""
    sums = _StageSums()
    for values in ([[4.0], [2.0]], [[1.0, 7.0], [0.0, 4.0], [2.0, 1.0]]):
        history = {"edge_length_m2": torch.tensor(values)}
        sums.add(SolverResult(torch.zeros(0), history, torch.full((len(values[0]),), len(values))))
    assert sums.curves()["edge_length_m2"].tolist() == [12 / 3, 6 / 3, 5 / 3]
    assert (sums.frames, sums.iterations) == (3, 2 + 3 + 3)
