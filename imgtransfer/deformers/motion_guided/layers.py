"""Layered garments: the garment beneath takes the place of the body (section 6.4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Template


def on_garment(clip: Clip, inner: Template, vertices: np.ndarray) -> Clip:
    """The clip of an outer garment on an inner one, to fit to or to predict for.

    The outer garment does not act on the inner one; nor does the body act on the outer one, but through the inner.

    Args:
        clip: of the outer garment, on the body.
        inner: the inner garment at rest on the same body. vertices: (T, N', 3) its motion, true or predicted, metres.

    Raises:
        InputError: a motion of other frames or vertices.
    """
    body = Body(inner.vertices, inner.faces, np.asarray(vertices, np.float32))
    # Blend weights and their transforms are the body's; the joints' motion still tells where the root heads.
    skeleton = replace(clip.skeleton, blend_weights=None, joint_transforms=None)
    return replace(clip, body=body, skeleton=skeleton)
