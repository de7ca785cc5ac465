"""What is rendered together: a garment, a body or both in motion, from a clip or from plain mesh files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imgtransfer.data.canonical import RootFrames, RootMode, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.checks.weld import weld, weld_motion
from render import InputError, Mesh, Option, load_mesh
from render.files.frame_files import read_moving_mesh
from render.files.mesh_files import SUFFIXES
from render.mesh.mesh import check_finite


@dataclass(frozen=True, eq=False)
class Moved:
    """A mesh at rest, and where it moves: (T, N, 3) float32, metres, world coordinates."""

    rest: Mesh
    vertices: np.ndarray


@dataclass(frozen=True, eq=False)
class Scene:
    """What is rendered together, with the same cameras and position box.

    Args:
        name: what folders and titles call it.
        framed: the mesh that the cameras are framed on: the garment's template.
        meshes: by name, "garment", "body" or both, all of T frames.
        frames: T canonical frames.
        fps: frames a second.
        numbers: T, what the frames are called in pictures.
    """

    name: str
    framed: Mesh
    meshes: dict[str, Moved]
    frames: RootFrames
    fps: float
    numbers: range

    @property
    def n_frames(self) -> int:
        return len(self.frames.rotation)

    def cut(self, frames: slice) -> Scene:
        """The scene with only some frames."""
        meshes = {name: Moved(m.rest, m.vertices[frames]) for name, m in self.meshes.items()}
        kept = RootFrames(self.frames.rotation[frames], self.frames.translation[frames])
        return replace(self, meshes=meshes, frames=kept, numbers=self.numbers[frames])


def clip_scene(clip: Clip, root: RootMode) -> Scene:
    """A clip, seen in the canonical frame that `root` says."""
    garment = Mesh(clip.template.vertices, clip.template.faces, f"{clip.name}: garment")
    body = Mesh(clip.body.rest, clip.body.faces, f"{clip.name}: body")
    meshes = {"body": Moved(body, clip.body.vertices)}
    if clip.garment is not None:
        meshes["garment"] = Moved(garment, clip.garment.vertices)
    return Scene(clip.name, garment, meshes, root_frames(clip, root), clip.fps, range(clip.n_frames))


def mesh_scene(
    template: Path,
    frames: Path,
    *,
    body_template: Path | None = None,
    body: Path | None = None,
    root: RootMode | None = None,
    fps: float = 30.0,
    axes: Axes | None = None,
    garment_axes: Axes | None = None,
    welding: bool = False,
) -> Scene:
    """Plain mesh files.

    Args:
        template: the garment at rest.
        frames: the garment in motion: one mesh file, a folder with a file a frame, a pattern or a point cache.
        body_template, body: the same of the body; both or neither.
        root: the canonical frame, found by fitting the body at rest to each frame; None: the meshes lie in it
            already. Needs a body.
        fps: frames a second.
        axes: how the files' coordinates lie; None for metres, y up, facing +z. garment_axes: the garment's, where
            they lie otherwise.
        welding: join split seams, so that normals are smooth across them.

    Raises:
        InputError: files that are missing, cannot be read or do not belong together; only one of the body's two; a
            root without a body; welded seams that part.
    """
    axes = axes or Axes()
    garment = _moved(load_mesh(template), frames, garment_axes or axes, welding)
    name = template.stem if frames.is_dir() or any(sign in frames.name for sign in "*?[") else frames.stem
    if (body_template is None) != (body is None):
        raise InputError(
            f"{Option('body')} and {Option('body_template')} belong together: the body in motion, and at rest"
        )
    if body_template is None or body is None:
        if root is not None:
            raise InputError(
                f"{Option('root')} {root}: there is no body to find the root's motion of; give {Option('body')}"
            )
        count = len(garment.vertices)
        still = RootFrames(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
        return Scene(name, garment.rest, {"garment": garment}, still, fps, range(count))
    dressed = _moved(load_mesh(body_template), body, axes, welding)
    clip = Clip(
        template=Template(vertices=garment.rest.vertices.astype(np.float32), faces=garment.rest.faces),
        garment=Garment(garment.vertices),
        body=Body(
            rest=dressed.rest.vertices.astype(np.float32), faces=dressed.rest.faces, vertices=dressed.vertices
        ),
        fps=fps,
        name=name,
    )
    return clip_scene(clip, root or "heading")


def _moved(rest: Mesh, frames: Path, axes: Axes, welding: bool) -> Moved:
    if frames.suffix.lower() in SUFFIXES and not any(sign in frames.name for sign in "*?["):
        mesh = load_mesh(frames)
        vertices = mesh.vertices[None].astype(np.float32)
    else:
        moving = read_moving_mesh(frames, topology=rest)
        mesh, vertices = moving.mesh, moving.vertices
    if mesh.vertices.shape != rest.vertices.shape or not np.array_equal(mesh.faces, rest.faces):
        raise InputError(
            f"{mesh.source}: {len(mesh.vertices)} vertices and {len(mesh.faces)} triangles, but the template "
            f"{rest.source} has {len(rest.vertices)} and {len(rest.faces)}, or others; they must be the same mesh, "
            "with its vertices in the same order"
        )
    rest, vertices = axes.of_mesh(rest), axes.apply(vertices)
    check_finite(vertices, str(frames))
    if not welding:
        return Moved(rest, vertices)
    welded = weld(rest)
    return Moved(welded.mesh, weld_motion(vertices, welded, source=str(frames)))
