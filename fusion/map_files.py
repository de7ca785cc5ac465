"""From a map file to vertices."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.config import FusionConfig
from fusion.inputs import FusionInputs
from fusion.stream import FusionResult, Take, collected, fuse_batches, slices
from render.errors import InputError
from render.maps.dilation import dilate, surface_guide
from render.maps.encoding import decode_normals
from render.maps.imager import TemplateImager
from render.maps.map_file import MapFile, Maps
from render.mesh.mesh import Mesh

# Share of the template's pixels that the maps may lack: rasterisers differ in single pixels of the outline.
_TOLERATED = 0.01
_LOOKED_THROUGH = 16  # frames whose confidence is looked at together


@dataclass(frozen=True, kw_only=True, eq=False)
class MapSurroundings:
    """What some frames of maps are fused with, in the canonical frame of the maps, metres.

    Args:
        initial: (T, N, 3), vertices to start from; position maps are then neither needed nor used.
        pinned_positions: (T, P, 3), where pinned vertices are.
        body_vertices: (T, B, 3); the garment is kept out of it.
        inner_vertices: (T, M, 3), another garment worn beneath.
    """

    initial: np.ndarray | None = None
    pinned_positions: np.ndarray | None = None
    body_vertices: np.ndarray | None = None
    inner_vertices: np.ndarray | None = None


#: Given how many frames make a part, all frames in order, so many at a time, each part with what it is fused with.
MapParts = Callable[[int], Iterator[tuple[MapFile, MapSurroundings]]]


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
    inner_vertices: np.ndarray | None = None,
    inner_faces: np.ndarray | None = None,
    config: FusionConfig | None = None,
    device: str = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> FusionResult:
    """Recover the garment from maps. Everything is in the canonical frame of the maps.

    Args:
        maps: T frames of encoded maps from S views; the confidence in it is used, and its rest shape.
        template: in place of the one in the file; same number of vertices, same silhouette.
        initial: (T, N, 3) metres, vertices to start from; position maps are then neither needed nor used.
        positions_only: leave the normal maps out.
        erode: how many pixels along the outline not to trust, because they are blurred with the background.
            Values from inside are grown over them, and over pixels of the template that the maps' mask lacks.
        pinned, pinned_positions: (P,) vertices that stay in place, and (T, P, 3) metres, where.
        body_vertices, body_faces: (T, B, 3) metres and (G, 3); the garment is kept out of it.
        inner_vertices, inner_faces: (T, M, 3) metres and (K, 3), another garment worn beneath.
        config, device, history, progress: as for `fuse`.

    Raises:
        InputError: nothing to start from, a template that does not fit the maps, or what `fuse` refuses.
    """
    by_frame = {
        "initial": initial,
        "pinned_positions": pinned_positions,
        "body_vertices": body_vertices,
        "inner_vertices": inner_vertices,
    }
    for name, values in by_frame.items():
        if values is not None and len(values) != maps.n_frames:
            raise InputError(
                f"fuse: {name} has {len(values)} frames, but the maps have {maps.n_frames}; give as many"
            )

    def parts(size: int) -> Iterator[tuple[MapFile, MapSurroundings]]:
        for frames in slices(maps.n_frames, size):
            cut = {name: None if values is None else values[frames] for name, values in by_frame.items()}
            yield maps.part(frames), MapSurroundings(**cut)

    return collected(
        lambda take: fuse_map_parts(
            maps,
            parts,
            take,
            template=template,
            positions_only=positions_only,
            erode=erode,
            pinned=pinned,
            body_faces=body_faces,
            inner_faces=inner_faces,
            config=config,
            device=device,
            history=history,
            progress=progress,
        )
    )


def fuse_map_parts(
    maps: Maps,
    parts: MapParts,
    take: Take,
    *,
    template: Mesh | None = None,
    positions_only: bool = False,
    erode: int = 0,
    pinned: np.ndarray | None = None,
    body_faces: np.ndarray | None = None,
    inner_faces: np.ndarray | None = None,
    config: FusionConfig | None = None,
    device: str = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """`fuse_maps` for frames that are read when their turn comes; no more than a few batches of them are in memory.

    Args:
        maps: the same frames as those of `parts`: how many there are, and whether their pixels count alike.
        parts: the frames, with what each is fused with.
        take: gets every batch that is solved, in order.
        template, positions_only, erode, pinned, body_faces, inner_faces: as for `fuse_maps`.
        config, device, history, progress: as for `fuse`.

    Returns:
        The report.

    Raises:
        InputError: as `fuse_maps`.
    """
    first, around = next(parts(1))
    reading = _MapReading(first, template, positions_only, erode, from_positions=around.initial is None)
    if not reading.imaged and around.body_vertices is None and around.inner_vertices is None:
        raise InputError(
            "maps: initial vertices replace the position maps and there are no normals: nothing to fuse"
        )
    constant = {"rest": first.rest_vertices, "pinned": pinned}
    constant |= {"body_faces": body_faces, "inner_faces": inner_faces}

    def batches(size: int) -> Iterator[FusionInputs]:
        inputs, done = None, 0
        for part, its in parts(size):
            frames = reading(part) | vars(its)
            if inputs is None:
                inputs = FusionInputs(reading.imager, **frames, **constant)
            else:
                inputs = inputs.others(done, **frames)
            done += inputs.n_frames
            yield inputs

    return fuse_batches(
        reading.imager,
        maps.n_frames,
        batches,
        take,
        config=config or FusionConfig(),
        device=device,
        weighted=reading.imaged and first.confidence is not None and _weighted(maps, reading.imager),
        history=history,
        progress=progress,
    )


def _weighted(maps: Maps, imager: TemplateImager) -> bool:
    """Whether a pixel of the template has another confidence than 1 in any frame."""
    mask = imager.mask.numpy()
    return any(
        part.confidence is not None and bool((part.confidence[:, mask] != 1).any())
        for part in maps.parts(_LOOKED_THROUGH)
    )


class _MapReading:
    """Maps as the fusion takes them: decoded, and grown beyond their outline.

    Args:
        maps: any frames of them.
        template, positions_only, erode: as for `fuse_maps`.
        from_positions: whether the position maps are where to start from.

    Raises:
        InputError: no position maps to start from, or a template that does not fit.
    """

    def __init__(
        self, maps: MapFile, template: Mesh | None, positions_only: bool, erode: int, *, from_positions: bool
    ) -> None:
        if maps.position is None and from_positions:
            raise InputError(
                "maps: no position maps to start from, only normals; add `position` to the file, or give initial "
                "vertices"
            )
        template = template or maps.template
        if len(template.vertices) != len(maps.template_vertices):
            raise InputError(
                f"{template.source}: {len(template.vertices)} vertices, but the maps were made with a template "
                f"of {len(maps.template_vertices)}; give the mesh that they were made with"
            )
        self.imager = TemplateImager.build(template, cameras=maps.cameras)
        self._grown = _Grown(self.imager, maps.mask, erode)
        self._positions = from_positions
        self._normals = maps.normal is not None and not positions_only
        #: Whether any map is read at all.
        self.imaged = self._positions or self._normals

    def __call__(self, maps: MapFile) -> dict[str, np.ndarray | None]:
        """Positions in metres, normals in [-1, 1] and confidence of some frames, by the names of `FusionInputs`."""
        positions = maps.position if self._positions else None
        normals = maps.normal if self._normals else None
        return {
            "positions": None if positions is None else maps.box.decode(self._grown(positions)),
            "normals": None if normals is None else decode_normals(self._grown(normals)),
            "confidence": maps.confidence if self.imaged else None,
        }


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
