"""From a map file to vertices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fusion.config import FusionConfig
from fusion.fuse import FusionResult, fuse
from render.dilation import dilate, surface_guide
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
    initial: np.ndarray | None = None,
    positions_only: bool = False,
    erode: int = 0,
    pinned: np.ndarray | None = None,
    pinned_positions: np.ndarray | None = None,
    body_vertices: np.ndarray | None = None,
    body_faces: np.ndarray | None = None,
    under_vertices: np.ndarray | None = None,
    under_faces: np.ndarray | None = None,
    config: FusionConfig | None = None,
    device: str = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> FusionResult:
    """Recover the garment from a map file. Everything is in the canonical frame of its maps.

    Args:
        maps: T frames of encoded maps from S views; the confidence in it is used, and its rest shape.
        template: in place of the one in the file; same number of vertices, same silhouette.
        initial: (T, N, 3) metres, vertices to start from; position maps are then neither needed nor used.
        positions_only: leave the normal maps out.
        erode: how many pixels along the outline not to trust, because they are blurred with the background.
            Values from inside are grown over them, and over pixels of the template that the maps' mask lacks.
        pinned, pinned_positions: (P,) vertices that stay in place, and (T, P, 3) metres, where.
        body_vertices, body_faces: (T, B, 3) metres and (G, 3); the garment is kept out of it.
        under_vertices, under_faces: (T, M, 3) metres and (K, 3), another garment worn beneath.
        config, device, history, progress: as for `fuse`.

    Raises:
        InputError: nothing to start from, a template that does not fit the maps, or what `fuse` refuses.
    """
    if maps.position is None and initial is None:
        raise InputError(
            "maps: no position maps to start from, only normals; add `position` to the file, or give initial vertices"
        )
    template = template or maps.template
    if len(template.vertices) != len(maps.template_vertices):
        raise InputError(
            f"{template.source}: {len(template.vertices)} vertices, but the maps were made with a template "
            f"of {len(maps.template_vertices)}; give the mesh that they were made with"
        )
    imager = TemplateImager.build(template, cameras=maps.cameras)
    grown = _Grown(imager, maps.mask, erode)
    positions = maps.position if initial is None else None
    normals = None if positions_only else maps.normal
    imaged = positions is not None or normals is not None
    if not imaged and body_vertices is None and under_vertices is None:
        raise InputError(
            "maps: initial vertices replace the position maps and there are no normals: nothing to fuse"
        )
    return fuse(
        imager,
        positions=None if positions is None else maps.box.decode(grown(positions)),
        normals=None if normals is None else decode_normals(grown(normals)),
        initial=initial,
        rest=maps.rest_vertices,
        confidence=maps.confidence if imaged else None,
        pinned=pinned,
        pinned_positions=pinned_positions,
        body_vertices=body_vertices,
        body_faces=body_faces,
        under_vertices=under_vertices,
        under_faces=under_faces,
        config=config,
        device=device,
        history=history,
        progress=progress,
    )


class _Grown:
    """Images (T, S, H, W, C) with values wherever the template has pixels.

    Raises:
        InputError: the maps' silhouette is not that of the template, or `erode` is below 0.
    """

    def __init__(self, imager: TemplateImager, mask: np.ndarray, erode: int) -> None:
        needed = imager.mask.numpy()
        missing = float((needed & ~mask).sum() / needed.sum())
        if missing > _TOLERATED:
            raise InputError(
                f"{imager.mesh.source}: {100 * missing:.1f} % of its pixels lie outside the maps' silhouette; "
                "give the mesh that the maps were made with"
            )
        if erode < 0:
            raise InputError(f"erode is {erode}; pixels are counted from 0")
        self._mask, self._erode = mask, erode
        self._guide = surface_guide(imager) if erode or missing else None

    def __call__(self, images: np.ndarray) -> np.ndarray:
        if self._guide is None:
            return images
        return dilate(images, self._mask, erode=self._erode, guide=self._guide)
