"""A small garment on a small body: an open tube around a closed cylinder, leaning and wrinkled."""

from pathlib import Path

import numpy as np
import torch
import trimesh
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from fusion import DecodedMaps, FusionInputs, MovingSurface, PinnedVertices
from fusion.inputs import Array
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from render import (
    MapFile,
    Mesh,
    PositionBox,
    TemplateImager,
    encode_normals,
    frame_cameras,
    save_maps,
    vertex_normals,
)

AROUND, ALONG = 32, 17  # vertices of the tube


def tube(radius: float = 0.15, height: float = 0.4) -> Mesh:
    """(AROUND · ALONG) vertices, open at both ends, axis along y."""
    angle, y = np.meshgrid(
        np.arange(AROUND) * 2 * np.pi / AROUND, np.linspace(-height / 2, height / 2, ALONG)
    )
    vertices = np.stack([radius * np.sin(angle), y, radius * np.cos(angle)], axis=-1).reshape(-1, 3)
    row, column = (part.ravel() for part in np.mgrid[: ALONG - 1, :AROUND])
    a, b = row * AROUND + column, row * AROUND + (column + 1) % AROUND
    faces = np.concatenate([np.stack([a, b, b + AROUND], 1), np.stack([a, b + AROUND, a + AROUND], 1)])
    return Mesh(vertices, faces, source="tube")


def cylinder_body(radius: float = 0.13, height: float = 0.6) -> trimesh.Trimesh:
    mesh = trimesh.creation.cylinder(radius=radius, height=height, sections=48)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return mesh


def leaning(points: np.ndarray, frames: int) -> np.ndarray:
    """(N, 3) -> (frames, N, 3) float32: turned further with every frame, rigidly."""
    turns = [Rotation.from_rotvec([lean, 0, lean / 2]).as_matrix() for lean in np.linspace(0.0, 0.4, frames)]
    return np.stack([points @ turn.T for turn in turns]).astype(np.float32)


def wrinkled(mesh: Mesh, frames: int, *, waves: int = 5, amplitude: float = 0.005) -> torch.Tensor:
    """(frames, N, 3) float32: the tube leaning as the body, with folds of 5 mm along its axis.

    Cloth does not stretch, and the edge term rests on that, so the tube gets narrower by as much as its folds
    take up.
    """
    angle = np.arctan2(mesh.vertices[:, 0], mesh.vertices[:, 2])
    radius = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 2])
    around = np.linspace(0, 2 * np.pi, 2001)

    def excess(mean: float) -> float:
        r = mean + amplitude * np.sin(waves * around)
        curve = np.stack([r * np.sin(around), r * np.cos(around)], axis=1)
        return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() - 2 * np.pi * radius[0])

    folded = brentq(excess, 0.5 * radius[0], radius[0]) + amplitude * np.sin(waves * angle)
    points = np.stack([folded * np.sin(angle), mesh.vertices[:, 1], folded * np.cos(angle)], axis=1)
    return torch.from_numpy(leaning(points, frames))


def imager_of(mesh: Mesh, size: tuple[int, int] = (48, 40)) -> TemplateImager:
    """Front and back cameras near enough that the tube's sides are seen by neither."""
    return TemplateImager.build(mesh, cameras=frame_cameras(mesh, size=size, fov_degrees=30), backend="numpy")


def true_maps(imager: TemplateImager, vertices: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions in metres and unit-vertex normals, interpolated: (T, S, H, W, 3) each."""
    return imager.operator(vertices), imager.operator(vertex_normals(vertices, imager.faces))


def inputs_of(
    *,
    positions: Array | None = None,
    normals: Array | None = None,
    confidence: Array | None = None,
    initial: Array | None = None,
    rest: Array | None = None,
    body: tuple[Array, Array] | None = None,
    inner: tuple[Array, Array] | None = None,
    pins: tuple[Array, Array | None] | None = None,
) -> FusionInputs:
    """What `fuse` takes, of arrays: of a body and an inner garment (vertices, faces), of pins (indices, positions)."""
    return FusionInputs(
        maps=DecodedMaps(positions, normals, confidence),
        body=None if body is None else MovingSurface(*body),
        inner=None if inner is None else MovingSurface(*inner),
        pins=None if pins is None else PinnedVertices(*pins),
        initial=initial,
        rest=rest,
    )


def write_example(folder: Path, frames: int) -> Clip:
    """Write maps.npz, clip.npz (the truth, in the world), body.npz and template.obj; returns the clip."""
    mesh, body = tube(), cylinder_body()
    imager = imager_of(mesh, (64, 64))
    truth = wrinkled(mesh, frames)
    positions, normals = true_maps(imager, truth)
    box = PositionBox.around(truth.numpy())
    rotation = Rotation.from_rotvec([[0, 0.5, 0], [0, 2.0, 0.1]][:frames]).as_matrix()
    translation = np.array([[0.3, 1.0, 0], [0.5, 1.1, -0.2]])[:frames]
    mask = imager.mask[..., None]
    maps = MapFile.of(
        imager,
        position=(box.encode(positions) * mask).numpy(),
        normal=(encode_normals(normals) * mask).numpy(),
        box=box,
        rotation=rotation,
        translation=translation,
        fps=30,
    )
    save_maps(folder / "maps.npz", maps)

    def to_world(points: np.ndarray) -> np.ndarray:
        return (np.einsum("tab,tnb->tna", rotation, points) + translation[:, None]).astype(np.float32)

    rest = np.asarray(body.vertices, np.float32)
    clip = Clip(
        template=Template(vertices=mesh.vertices.astype(np.float32), faces=mesh.faces),
        garment=Garment(to_world(truth.numpy())),
        body=Body(rest=rest, faces=np.asarray(body.faces), vertices=to_world(leaning(rest, frames))),
        fps=30.0,
        info={"licence": "CC0"},
    )
    save_clip(folder / "clip.npz", clip)
    np.savez(folder / "body.npz", body_faces=clip.body.faces, body_vertices=clip.body.vertices)
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices] + [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    (folder / "template.obj").write_text("\n".join(lines) + "\n")
    return clip
