"""A mesh of a scene file as its format's reader hands it over, before it is cut into triangles and frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from render.errors import InputError
from render.files.scenes.polygons import Polygons


@dataclass(frozen=True, eq=False)
class Look:
    """Texture coordinates and materials of polygons.

    Args:
        uvs: (U, 2) float32, v upwards; None where there are none. uv_corners: (C,) an index into `uvs` for each corner.
        materials: names. polygon_materials: (P,) an index into `materials` for each polygon; None without.
    """

    uvs: np.ndarray | None = None
    uv_corners: np.ndarray | None = None
    materials: tuple[str, ...] = ()
    polygon_materials: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """One mesh of a scene in motion.

    Args:
        path: of the object in its scene, such as /root/shirt.
        polygons: of the first frame.
        times: (S,) seconds, rising, at which the mesh or one of its parents has values of its own.
        points: seconds and the frame's number -> (N, 3) float64 vertices in the scene's coordinates, with the
            transforms of all parents; InputError where the mesh is another by then.
        backwards: whether the polygons' corners are counter-clockwise, seen from outside, only when read backwards.
        look: its texture coordinates and materials.
        rate: frames a second that the file states; None where it states none.
        up, metres: the axis that points up and the metres a unit, where the file says so.
    """

    path: str
    polygons: Polygons
    times: np.ndarray
    points: Callable[[float, int], np.ndarray]
    backwards: bool
    look: Look = field(default_factory=Look)
    rate: float | None = None
    up: str | None = None
    metres: float | None = None


class SceneFile(Protocol):
    """A scene file that is open."""

    def names(self, *, hidden: bool) -> list[str]:
        """Paths of the meshes in it, in the file's order; those that are not to be seen only if `hidden`."""

    def mesh(self, name: str) -> SceneMesh:
        """The mesh of a path."""


def matching(names: Sequence[str], wanted: str) -> list[str]:
    """Which paths an object's name means: the whole path, or else the last names of an object or of what it lies in.

    "shirt" means /root/shirt and /root/shirt/mesh, not /root/shirts; "/root/shirt" only itself and what lies in it.
    """
    if wanted in names:
        return [wanted]
    if wanted.startswith("/"):
        return [name for name in names if name.startswith(wanted.rstrip("/") + "/")]
    ended = [name for name in names if name.endswith("/" + wanted)]
    return ended or [name for name in names if f"/{wanted.strip('/')}/" in name]


def check_same(mesh: Polygons, n_vertices: int, points: np.ndarray, when: str) -> None:
    """Raise InputError where a frame has another number of vertices than the first one."""
    if len(points) != n_vertices:
        raise InputError(
            f"{mesh.source}: {len(points)} vertices {when}, but {n_vertices} in the first frame; the mesh must not "
            "change between frames: export without remeshing, decimation or a view-dependent modifier"
        )


def in_world(local: np.ndarray, placed: np.ndarray) -> np.ndarray:
    """(N, 3) points of a mesh, placed by a (4, 4) matrix for row vectors; without a copy where it does nothing."""
    if np.array_equal(placed, np.eye(4)):
        return local
    world: np.ndarray = local @ placed[:3, :3]
    world += placed[3, :3]
    return world


def face_sets(n_polygons: int, sets: Sequence[tuple[str, np.ndarray]], source: str) -> Look:
    """Materials from named sets of polygons; what no set holds is of "default"."""
    names = list(dict.fromkeys(name for name, _ in sets))
    used = np.full(n_polygons, -1, np.int64)
    for name, polygons in sets:
        if len(polygons) and not (polygons.min() >= 0 and polygons.max() < n_polygons):
            raise InputError(
                f"{source}: its face set {name} names polygons beyond the {n_polygons} there are"
            )
        used[polygons] = names.index(name)
    if (used < 0).all():
        return Look()
    if (used < 0).any():
        names.append("default")
        used[used < 0] = len(names) - 1
    kept, order = np.unique(used, return_index=True)
    kept = kept[np.argsort(order)]  # in the order of their first use
    number = np.full(len(names), -1, np.int64)
    number[kept] = np.arange(len(kept))
    return Look(materials=tuple(names[index] for index in kept), polygon_materials=number[used])
