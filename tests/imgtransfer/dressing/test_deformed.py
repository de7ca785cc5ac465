"""Frames from the network to the fusion and on, without maps in between."""

import numpy as np
import pytest

from fusion import FusionConfig
from imgtransfer.data.clip import load_clip, written_clip
from imgtransfer.data.reader import LoadedReader
from imgtransfer.data.sequences import clip_reader, open_clip_arrays
from imgtransfer.dressing.deformed import predict_and_fuse
from imgtransfer.pipeline.folder import FUSED_FILE, MAPS_FILE, POSITION_ONLY_FILE
from imgtransfer.pipeline.fuse import FuseInputs, FuseOptions, fuse_into
from imgtransfer.pipeline.predict import save_prediction
from render import open_maps
from tests.helpers import synthetic
from tests.helpers.models import local_model_for

CONFIG = FusionConfig(edge_iterations=4, normal_iterations=2, batch_frames=3)


@pytest.fixture(scope="module")
def clip():
    return synthetic.tube_clip(18)  # more than the network takes at once


def test_the_vertices_are_those_of_predict_and_fuse(clip, tmp_path):
    """To the bit, also of a network that is shown the body at earlier times."""
    model, reader, taken = local_model_for(clip), LoadedReader(clip), []
    progress = []
    done = predict_and_fuse(model, reader, taken.append, CONFIG, progress=progress.append)
    save_prediction(tmp_path / "p", model, reader, record={})
    body = tmp_path / "p" / POSITION_ONLY_FILE
    inputs = FuseInputs(body=open_clip_arrays(body, "body"), clip=clip_reader(body))
    report = fuse_into(
        tmp_path / "p", open_maps(tmp_path / "p" / MAPS_FILE), inputs, FuseOptions(config=CONFIG)
    )
    fused = load_clip(tmp_path / "p" / FUSED_FILE)
    vertices = np.concatenate([part.garment.vertices for part in taken])
    np.testing.assert_array_equal(vertices, fused.garment.vertices)
    np.testing.assert_array_equal(np.concatenate([part.body.vertices for part in taken]), clip.body.vertices)
    assert sum(progress) == 18
    assert done.report["frames"] == 18
    assert done.report["crossing_percent"] == report["crossing_percent"]
    assert done.predict_seconds > 0
    assert done.fuse_seconds > 0


def test_what_stops_it_leaves_no_file(clip, tmp_path):
    """Ctrl-C comes when some frames are written."""

    def stop(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), written_clip(tmp_path / "x.npz") as add:
        predict_and_fuse(local_model_for(clip), LoadedReader(clip), add, CONFIG, progress=stop)
    assert list(tmp_path.iterdir()) == []
