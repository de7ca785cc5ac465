"""From a map file to vertices."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from fusion.config import FusionConfig
from fusion.grown_maps import GrownMaps
from fusion.input_checks import checked
from fusion.inputs import DecodedMaps, FusionInputs
from fusion.stream import FrameStream, FusionResult, Take, collected, fuse_batches, slices
from render.errors import InputError
from render.maps.encoding import decode_normals
from render.maps.imager import TemplateImager
from render.maps.map_file import MapFile, Maps
from render.mesh.mesh import Mesh

_LOOKED_THROUGH = 16  # frames whose confidence is looked at together


@dataclass(frozen=True, kw_only=True, eq=False)
class MapReading:
    """How map files are read.

    Args:
        template: in place of the one in the file; same number of vertices, same silhouette.
        positions_only: leave the normal maps out.
        erode: how many pixels along the outline not to trust, because they are blurred with the background.
            Values from inside are grown over them, and over pixels of the template that the maps' mask lacks.
    """

    template: Mesh | None = None
    positions_only: bool = False
    erode: int = 0


#: Given how many frames make a part, all frames in order, so many at a time, each part with what it is fused with.
MapParts = Callable[[int], Iterator[tuple[MapFile, FusionInputs]]]


def fuse_maps(
    maps: MapFile,
    inputs: FusionInputs | None = None,
    config: FusionConfig | None = None,
    *,
    reading: MapReading | None = None,
    device: str = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> FusionResult:
    """Recover the garment from maps. Everything is in the canonical frame of the maps.

    Args:
        maps: T frames of encoded maps from S views; the confidence in it is used, and its rest shape.
        inputs: T frames of what they are fused with, all but the maps: body, inner garment, pins; `initial`, with
            which position maps are neither needed nor used; `rest` and `contact_offset_m`, in place of the file's.
        config, device, history, progress: as for `fuse`.
        reading: how the maps are read; as they are if None.

    Returns:
        Vertices (T, N, 3) float32, metres, before and after; and the report.

    Raises:
        InputError: nothing to start from, a template that does not fit the maps, or what `fuse` refuses.
    """
    around = inputs or FusionInputs()
    for name, frames in around.frame_counts().items():
        if frames != maps.n_frames:
            raise InputError(
                f"fuse: {name} has {frames} frames, but the maps have {maps.n_frames}; give as many"
            )

    def parts(size: int) -> Iterator[tuple[MapFile, FusionInputs]]:
        return ((maps.part(frames), around.part(frames)) for frames in slices(maps.n_frames, size))

    return collected(
        lambda take: fuse_map_parts(
            maps, parts, take, config, reading=reading, device=device, history=history, progress=progress
        )
    )


def fuse_map_parts(
    maps: Maps,
    parts: MapParts,
    take: Take,
    config: FusionConfig | None = None,
    *,
    reading: MapReading | None = None,
    device: str = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """`fuse_maps` for frames that are read when their turn comes; no more than a few batches of them are in memory.

    Args:
        maps: the same frames as those of `parts`: how many there are, and whether their pixels count alike.
        parts: the frames, with what each is fused with.
        take: gets every batch that is solved, in order.
        config, device, history, progress: as for `fuse`.
        reading: how the maps are read; as they are if None.

    Returns:
        The report.

    Raises:
        InputError: as `fuse_maps`.
    """
    first, around = next(parts(1))
    reader = _MapReader(first, reading or MapReading(), from_positions=around.initial is None)
    if not reader.imaged and around.body is None and around.inner is None:
        raise InputError(
            "maps: initial vertices replace the position maps and there are no normals: nothing to fuse"
        )

    def batches(size: int) -> Iterator[FusionInputs]:
        done = 0
        for part, its in parts(size):
            if not its.maps.empty:
                raise InputError(
                    "fuse: the maps are those of the map file; leave them out of its other inputs"
                )
            rest = part.rest_vertices if its.rest is None else its.rest
            offset = part.contact_offset_m if its.contact_offset_m is None else its.contact_offset_m
            read = replace(its, maps=reader(part), rest=rest, first_frame=done, contact_offset_m=offset)
            yield checked(read, reader.imager)
            done += part.n_frames

    weighted = reader.imaged and first.confidence is not None and _weighted(maps, reader.imager)
    frames = FrameStream(maps.n_frames, batches, weighted=weighted, fps=first.fps, grown=reader.grown)
    return fuse_batches(
        reader.imager, frames, take, config, device=device, history=history, progress=progress
    )


def _weighted(maps: Maps, imager: TemplateImager) -> bool:
    """Whether a pixel of the template has another confidence than 1 in any frame."""
    mask = imager.mask.numpy()
    return any(
        part.confidence is not None and bool((part.confidence[:, mask] != 1).any())
        for part in maps.parts(_LOOKED_THROUGH)
    )


class _MapReader:
    """Maps as the fusion takes them: decoded, and grown beyond their outline.

    Args:
        maps: any frames of them.
        reading: what of them is read, and how.
        from_positions: whether the position maps are where to start from.

    Raises:
        InputError: no position maps to start from, or a template that does not fit.
    """

    def __init__(self, maps: MapFile, reading: MapReading, *, from_positions: bool) -> None:
        if maps.position is None and from_positions:
            raise InputError(
                "maps: no position maps to start from, only normals; add `position` to the file, or give initial "
                "vertices"
            )
        template = reading.template or maps.template
        if len(template.vertices) != len(maps.template_vertices):
            raise InputError(
                f"{template.source}: {len(template.vertices)} vertices, but the maps were made with a template "
                f"of {len(maps.template_vertices)}; give the mesh that they were made with"
            )
        self.imager = maps.imager(template)
        self.grown = GrownMaps(self.imager, maps.mask, reading.erode)
        self._positions = from_positions
        self._normals = maps.normal is not None and not reading.positions_only
        #: Whether any map is read at all.
        self.imaged = self._positions or self._normals

    def __call__(self, maps: MapFile) -> DecodedMaps:
        """Positions in metres, normals in [-1, 1] and confidence of some frames."""
        positions = maps.position if self._positions else None
        normals = maps.normal if self._normals else None
        return DecodedMaps(
            positions=None if positions is None else maps.box.decode(self.grown(positions)),
            normals=None if normals is None else decode_normals(self.grown(normals)),
            confidence=maps.confidence if self.imaged else None,
        )
