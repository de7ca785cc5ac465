"""How good a garment's mesh is: openings, evenness, self-intersections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.warp_start import warp_module
from imgtransfer.garments.cutting import border_loops, components
from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh


@dataclass(frozen=True)
class MeshQuality:
    """Numbers of a triangle mesh; lengths in metres, angles in degrees.

    Args:
        vertices, faces, components, openings: counts; openings are border loops.
        handles: of the surface with its openings closed, 0 for a sphere.
        non_manifold: edges with more than two faces or faces that disagree on their side, and corners whose faces
            are not one fan.
        duplicates: vertices that lie where another one lies, within a micrometre.
        intersecting: faces that pass through another one.
        edge_median, edge_spread: median edge length; standard deviation over mean.
        angle_min, angle_p1: the smallest angle of any face, and the 1st percentile of every face's smallest.
    """

    vertices: int
    faces: int
    components: int
    openings: int
    handles: int
    non_manifold: int
    duplicates: int
    intersecting: int
    edge_median: float
    edge_spread: float
    angle_min: float
    angle_p1: float


def mesh_quality(mesh: Mesh) -> MeshQuality:
    """Measure a mesh.

    Args:
        mesh: with vertices in metres; any number of components, closed or open.
    """
    lengths = edge_lengths(mesh.vertices, mesh.edges)
    smallest = _smallest_angles(mesh)
    parts, broken = components(mesh), _non_manifold(mesh)
    openings = 0 if broken else len(border_loops(mesh.faces))
    euler = len(np.unique(mesh.faces)) - len(mesh.edges) + len(mesh.faces)
    return MeshQuality(
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        components=parts,
        openings=openings,
        handles=(2 * parts - openings - euler) // 2,
        non_manifold=broken,
        duplicates=len(mesh.vertices) - len(np.unique(mesh.vertices.round(6), axis=0)),
        intersecting=int((intersecting_faces(mesh) >= 0).sum()),
        edge_median=float(np.median(lengths)),
        edge_spread=float(lengths.std() / lengths.mean()),
        angle_min=float(smallest.min()),
        angle_p1=float(np.percentile(smallest, 1)),
    )


def intersecting_faces(mesh: Mesh) -> np.ndarray:
    """(F,) int, for every face another one that it passes through, -1 where there is none.

    Faces with a common edge do not count, whatever the fold between them; those with a common corner count where they
    meet elsewhere, too.
    """
    warp = warp_module()

    from imgtransfer.garments import intersection_kernels as kernels  # noqa: PLC0415

    faces = mesh.faces.astype(np.int32)
    with warp.ScopedDevice("cpu"):
        tree = warp.Mesh(
            warp.array(mesh.vertices.astype(np.float32), dtype=warp.vec3),
            warp.array(faces.ravel(), dtype=warp.int32),
        )
        partner = warp.empty(len(faces), dtype=warp.int32)
        warp.launch(
            kernels.intersecting_faces,
            dim=len(faces),
            inputs=[
                tree.id,
                warp.array(mesh.vertices, dtype=warp.vec3d),
                warp.array(faces, dtype=warp.int32),
            ],
            outputs=[partner],
        )
        return partner.numpy().copy()


def _smallest_angles(mesh: Mesh) -> np.ndarray:
    """(F,) degrees."""
    corners = mesh.vertices[mesh.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    lengths = np.maximum(np.linalg.norm(sides, axis=-1), 1e-12)
    cosine = -np.einsum("fij,fij->fi", sides, np.roll(sides, 1, axis=1)) / (
        lengths * np.roll(lengths, 1, axis=1)
    )
    return np.degrees(np.arccos(cosine.clip(-1, 1))).min(axis=1)


def _non_manifold(mesh: Mesh) -> int:
    """Edges and corners at which the surface is no surface; see `MeshQuality`."""
    halves = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    # One direction twice: a third face, or one turned over.
    twice = len(halves) - len(np.unique(halves, axis=0))
    starts, ends = halves.T
    inner = np.isin(ends * len(mesh.vertices) + starts, starts * len(mesh.vertices) + ends)
    border = np.bincount(starts[~inner], minlength=len(mesh.vertices))
    return twice + int((border > 1).sum())  # a corner where two borders touch
