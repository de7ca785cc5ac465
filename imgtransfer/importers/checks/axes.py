"""Units and axes of other programs, turned into metres, y up, facing +z; and guessed from a body's shape."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from render import InputError, Mesh, MeshSequence, Option
from render.mesh.file_axes import FileAxes
from render.mesh.mesh import check_finite

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "dm": 0.1, "in": 0.0254, "ft": 0.3048}  # metres; likeliest first
AXES = ("x", "y", "z", "-x", "-y", "-z")
_SAMPLES = 4000  # vertices that a guess looks at


@dataclass(frozen=True)
class Axes:
    """How a file's coordinates lie.

    Args:
        up: the file's axis that points up, one of `AXES`.
        facing: the file's axis that the body faces in its rest pose.
        scale: metres a unit of the file.
        given: which of the three somebody said; for the others, the word of a file that says how it lies comes first.
        said: which of the three are by the word of the file.

    Raises:
        InputError: an unknown axis, up and facing along one line, or a scale that is not positive.
    """

    up: str = "y"
    facing: str = "z"
    scale: float = 1.0
    # Neither changes how coordinates lie; fingerprints are of reprs.
    given: frozenset[str] = field(default=frozenset(), repr=False, compare=False)
    said: frozenset[str] = field(default=frozenset(), repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, axis in (("up", self.up), ("facing", self.facing)):
            if axis not in AXES:
                raise InputError(f"{Option(name, axis)}: one of {', '.join(AXES)} is wanted")
        if self.up[-1] == self.facing[-1]:
            raise InputError(f"{self}: the two must be different axes")
        if not 1e-6 <= self.scale <= 1e6:
            raise InputError(
                f"{Option('scale', self.scale)}: a positive number of metres a unit is wanted, from a micrometre to "
                "1000 km"
            )

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) float64: ours = rotation @ theirs, without the scale; right-handed stays right-handed."""
        up, facing = axis_vector(self.up), axis_vector(self.facing)
        return np.stack([np.cross(up, facing), up, facing])

    def apply(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) in the file's units and axes -> (..., 3) metres, y up, facing +z; same dtype."""
        return (points @ (self.scale * self.rotation.T)).astype(points.dtype)

    def of_file(self, said: FileAxes | None) -> Axes:
        """How a file lies that says so itself: as it says, but for what is `given`."""
        if said is None:
            return self
        up = self.up if "up" in self.given else said.up
        facing = self.facing if self.given & {"up", "facing"} else usual_facing(up)
        scale = self.scale if "scale" in self.given else said.metres
        return Axes(up, facing, scale, self.given, frozenset({"up", "scale"} - self.given))

    def of_mesh(self, mesh: Mesh) -> Mesh:
        """The mesh in metres, y up, facing +z."""
        return replace(mesh, vertices=self.of_file(mesh.axes).apply(mesh.vertices), axes=None)

    def of_sequence(self, sequence: MeshSequence) -> MeshSequence:
        """The sequence in metres, y up, facing +z.

        Raises:
            InputError: when frames are read: a vertex too far away to be of a garment or body.
        """

        axes = self.of_file(sequence.mesh.axes)

        def in_metres(vertices: np.ndarray, first: int) -> np.ndarray:
            moved = axes.apply(vertices)
            check_finite(moved, sequence.source, first=first)
            return moved

        return sequence.mapped(in_metres, self.of_mesh(sequence.mesh))

    def __str__(self) -> str:
        return f"{Option('up', self.up)} {Option('facing', self.facing)}"


@dataclass(frozen=True)
class MotionAxes:
    """How frames lie where that is otherwise than their rest meshes do, as when a cache is exported on its own.

    Args:
        up: the frames' axis that points up; None is the rest mesh's.
        facing: the axis that a body at rest would face in them; None is what is usual with this axis up.
        scale: metres a unit of the frames; None is the rest mesh's.
    """

    up: str | None = None
    facing: str | None = None
    scale: float | None = None

    def beside(self, rest: Axes) -> Axes:
        """How the frames of a mesh lie whose rest pose lies so.

        Raises:
            InputError: as `Axes`.
        """
        up = self.up or rest.up
        facing = self.facing or (rest.facing if up == rest.up else usual_facing(up))
        given = {name for name in ("up", "facing", "scale") if getattr(self, name) is not None}
        return Axes(up, facing, rest.scale if self.scale is None else self.scale, rest.given | given)


AS_AT_REST = MotionAxes()


@dataclass(frozen=True, eq=False)
class InMetres:
    """A mesh in motion as commands take it.

    Args:
        sequence: in metres, y up, facing +z.
        axes: how the rest mesh's file lay, by the user's word, else by its own. frames: how the frames' files did; None
            for arrays, which are in metres, y up, always.
    """

    sequence: MeshSequence
    axes: Axes
    frames: Axes | None


def usual_facing(up: str) -> str:
    """What a body usually faces in files with this axis up: -y where z is up, as in Blender, else z."""
    return "z" if up[-1:] != "z" else "-y"


def axis_vector(axis: str) -> np.ndarray:
    """(3,) the unit vector along one of `AXES`."""
    vector = np.zeros(3)
    vector["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return vector


def axis_name(axis: int, sign: float) -> str:
    """What is called an axis of `AXES`, by its number and direction."""
    return ("-" if sign < 0 else "") + "xyz"[axis]


def guess_axes(body: np.ndarray) -> Axes | None:
    """Guess how a standing body in its rest pose (arms out or down) lies, whatever its units.

    Left and right mirror each other; of the other two axes the longer one is up, with the head, which lies in the
    middle, at one end and the feet, which do not, at the other; toes point forward.

    Args:
        body: (B, 3) vertices.

    Returns:
        Axes of scale 1, or None where the shape does not tell.
    """
    points = np.asarray(body, np.float64)[:: max(1, len(body) // _SAMPLES)]
    points = points - (points.min(0) + points.max(0)) / 2
    extent = np.ptp(points, axis=0)
    if not (extent > 0).all():
        return None
    lateral = _mirror_axis(points, extent)
    if lateral is None:
        return None
    up, depth = sorted((axis for axis in range(3) if axis != lateral), key=lambda axis: -extent[axis])
    if extent[up] < 2 * extent[depth]:
        return None
    height = points[:, up] / extent[up]
    head = _head_end(height, np.abs(points[:, lateral]) / extent[up])
    ahead = _toes_ahead(head * height + 0.5, points[:, depth] / extent[up]) if head else 0.0
    return Axes(axis_name(up, head), axis_name(depth, ahead)) if ahead else None


def _head_end(height: np.ndarray, side: np.ndarray) -> float:
    """+1 or -1 for the end (height 0.5 or -0.5) at which the body is in its middle plane, 0 where neither is clear."""
    in_the_middle = [float((side[end] < 0.02).mean()) for end in (height > 0.47, height < -0.47)]
    difference = in_the_middle[0] - in_the_middle[1]
    return float(np.sign(difference)) if abs(difference) > 0.15 else 0.0


def _toes_ahead(above_ground: np.ndarray, depth: np.ndarray) -> float:
    """How far the soles reach before the shins, in body heights; 0 where that is not clear."""
    soles, shins = above_ground < 0.025, (above_ground > 0.06) & (above_ground < 0.16)
    if not (soles.any() and shins.any()):
        return 0.0
    ahead = float(depth[soles].mean() - depth[shins].mean())
    return ahead if abs(ahead) > 0.008 else 0.0


def _mirror_axis(points: np.ndarray, extent: np.ndarray) -> int | None:
    """The axis across which the points mirror best, if that is clear."""
    tree = cKDTree(points)
    errors = [tree.query(points * np.where(np.arange(3) == axis, -1.0, 1.0))[0].mean() for axis in range(3)]
    best, second = np.argsort(errors)[:2]
    if errors[best] > 0.02 * extent.max() or errors[second] < 2 * errors[best]:
        return None
    return int(best)


def likely_unit(size: float) -> str | None:
    """The unit in which a body of this size (its longest extent, in the file's units) is of human size."""
    for shortest, longest in ((0.9, 2.4), (0.4, 2.8)):
        for unit, metres in UNITS.items():
            if shortest <= size * metres <= longest:
                return unit
    return None
