"""Garments in real, short simulations on coarse meshes."""

import numpy as np
import torch

from fusion import BodySdf
from imgtransfer.bodies.config import make_body
from imgtransfer.garments.config import SkirtConfig
from imgtransfer.garments.garment import make_garment
from imgtransfer.motions.library import make_motion
from imgtransfer.simulation.config import SimulateConfig, SolverConfig
from imgtransfer.simulation.run import simulate_clip


def test_a_skirt_stays_at_the_waist_of_a_shaped_body():
    solver = SolverConfig(
        min_substeps=4, max_substeps=4, iterations=3, settle_seconds=0.4, warm_up_seconds=0.2
    )
    config = SimulateConfig(garment=SkirtConfig(edge_length=0.045), body={"seed": 5}, solver=solver)
    clip = simulate_clip(make_motion("squat", seed=1, seconds=0.4), config)[0]
    assert clip.name == "skirt/squat_s1_anny5"
    assert clip.info["body"] == '{"seed":5}'
    body = make_body(config.body)
    assert np.allclose(clip.body.rest, body.rest, atol=1e-5)
    garment = make_garment(body, config.garment, like=make_body())
    assert np.array_equal(clip.template.faces, garment.mesh.faces)
    # At rest the waistband is where it was put, and it moves with the skin.
    np.testing.assert_allclose(
        clip.template.vertices[garment.pinned], garment.mesh.vertices[garment.pinned], atol=1e-4
    )
    for frame in (0, clip.n_frames - 1):
        sdf = BodySdf(clip.body.faces, len(clip.body.rest))
        sdf.update(clip.body.vertices[frame])
        away = sdf.distance(torch.from_numpy(clip.garment.vertices[frame][garment.pinned]))
        assert away.min() > 0
        assert away.max() < 0.03
    # The rest hangs: it is free, and below the waist.
    free = np.setdiff1d(np.arange(len(clip.template.vertices)), garment.pinned)
    moved = np.linalg.norm(clip.template.vertices - garment.mesh.vertices, axis=1)[free]
    assert np.median(moved) > 0.003
    assert clip.garment.vertices[:, free, 1].max() < clip.garment.vertices[:, garment.pinned, 1].max() + 0.01
