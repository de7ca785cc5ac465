"""AMASS-style motion files."""

import numpy as np


def write_amass(path, **changes):
    time = np.arange(61) / 60
    poses = np.zeros((61, 156), np.float32)  # SMPL-H: body and hands
    poses[:, 3 * 18 + 1] = 0.8 * time
    arrays = {
        "poses": poses,
        "trans": np.stack([0 * time, 0.9 + 0 * time, time], axis=1),
        "mocap_framerate": np.float64(60),
    }
    arrays.update(changes)
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path
