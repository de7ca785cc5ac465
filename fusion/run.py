"""From a map file to vertices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from fusion.config import FusionConfig
from fusion.fuse import FusionResult, fuse
from render.encoding import decode_normals
from render.errors import InputError
from render.imager import TemplateImager
from render.mapfile import MapFile
from render.mesh import Mesh

# Share of the template's pixels that the maps may lack: rasterisers differ in single pixels of the outline.
_TOLERATED = 0.01


def fuse_maps(
    maps: MapFile,
    *,
    template: Mesh | None = None,
    body_vertices: np.ndarray | None = None,
    body_faces: np.ndarray | None = None,
    positions_only: bool = False,
    config: FusionConfig | None = None,
    device: str | torch.device = "cpu",
    progress: Callable[[int], object] | None = None,
) -> FusionResult:
    """Recover the garment from a map file, in the canonical frame of its maps.

    Args:
        maps: T frames of encoded maps; positions are needed, normals are used where there are any.
        template: in place of the one in the file; same number of vertices, same silhouette.
        body_vertices: (T, B, 3) metres, in the maps' canonical frame.
        body_faces: (G, 3) integers.
        positions_only: leave the normal maps out.
        config, device, progress: as for `fuse`.

    Raises:
        InputError: no position maps, a template that does not fit the maps, or what `fuse` refuses.
    """
    if maps.position is None:
        raise InputError("maps: no position maps to start from, only normals; add `position` to the file")
    template = template or maps.template
    if len(template.vertices) != len(maps.template_vertices):
        raise InputError(
            f"{template.source}: {len(template.vertices)} vertices, but the maps were made with a template "
            f"of {len(maps.template_vertices)}; give the mesh that they were made with"
        )
    imager = TemplateImager.build(template, cameras=maps.cameras)
    needed = imager.mask.numpy()
    missing = float((needed & ~maps.mask).sum() / needed.sum())
    if missing > _TOLERATED:
        raise InputError(
            f"{template.source}: {100 * missing:.1f} % of its pixels lie outside the maps' silhouette; "
            "give the mesh that the maps were made with"
        )
    normal = None if positions_only or maps.normal is None else _filled(maps.normal, maps.mask, needed)
    return fuse(
        imager,
        positions=maps.box.decode(_filled(maps.position, maps.mask, needed)),
        normals=None if normal is None else decode_normals(normal),
        body_vertices=body_vertices,
        body_faces=body_faces,
        config=config,
        device=device,
        progress=progress,
    )


def _filled(images: np.ndarray, mask: np.ndarray, needed: np.ndarray) -> np.ndarray:
    """Images (T, S, H, W, C); pixels in `needed` but not in `mask` get the value of the nearest in `mask`."""
    if not (needed & ~mask).any():
        return images
    filled = images.copy()
    for view, covered in enumerate(mask):
        rows, columns = np.nonzero(needed[view] & ~covered)
        nearest = distance_transform_edt(~covered, return_distances=False, return_indices=True)
        filled[:, view, rows, columns] = images[:, view][:, *nearest[:, rows, columns]]
    return filled
