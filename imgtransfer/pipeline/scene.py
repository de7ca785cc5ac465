"""What is rendered together: a garment, a body or both in motion, from a clip or from plain mesh files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imgtransfer.data.canonical import RootFrames, RootMode, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.data.sequences import Kind
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.sequences import open_in_metres, weld_sequence
from render import InputError, Mesh, MeshSequence, Option
from render.files.frame_files import is_pattern


@dataclass(frozen=True, eq=False)
class Scene:
    """What is rendered together, with the same cameras and position box.

    Args:
        name: what folders and titles call it.
        framed: the mesh that the cameras are framed on: the garment's template.
        meshes: by name, "garment", "body" or both, all of T frames, in memory.
        frames: T canonical frames.
        fps: frames a second.
        numbers: T, what the frames are called in pictures.
    """

    name: str
    framed: Mesh
    meshes: dict[str, MeshSequence]
    frames: RootFrames
    fps: float
    numbers: range

    @property
    def n_frames(self) -> int:
        return len(self.frames.rotation)

    def cut(self, frames: slice) -> Scene:
        """The scene with only some frames."""
        meshes = {
            name: MeshSequence.of_array(moving.mesh, moving.vertices()[frames])
            for name, moving in self.meshes.items()
        }
        kept = RootFrames(self.frames.rotation[frames], self.frames.translation[frames])
        return replace(self, meshes=meshes, frames=kept, numbers=self.numbers[frames])


def clip_scene(clip: Clip, root: RootMode) -> Scene:
    """A clip, seen in the canonical frame that `root` says."""
    garment = Mesh(clip.template.vertices, clip.template.faces, f"{clip.name}: garment")
    body = Mesh(clip.body.rest, clip.body.faces, f"{clip.name}: body")
    meshes = {"body": MeshSequence.of_array(body, clip.body.vertices)}
    if clip.garment is not None:
        meshes["garment"] = MeshSequence.of_array(garment, clip.garment.vertices)
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
    garment_object: str | None = None,
    body_object: str | None = None,
    welding: bool = False,
) -> Scene:
    """Plain mesh files.

    Args:
        template: the garment at rest.
        frames: the garment in motion: one mesh file, a folder with a file a frame, a pattern, a point cache, an
            Alembic or USD file, or an npz of arrays or of a clip.
        body_template, body: the same of the body; both or neither.
        root: the canonical frame, found by fitting the body at rest to each frame; None: the meshes lie in it
            already. Needs a body.
        fps: frames a second.
        axes: how the files' coordinates lie; None for metres, y up, facing +z. garment_axes: the garment's, where
            they lie otherwise.
        garment_object, body_object: which mesh of an Alembic or USD file, by name or path; None takes the only one.
        welding: join split seams, so that normals are smooth across them.

    Raises:
        InputError: files that are missing, cannot be read or do not belong together; only one of the body's two; a
            root without a body; welded seams that part.
    """
    axes = axes or Axes()
    garment = _read(frames, "garment", garment_axes or axes, template, chosen=garment_object, welding=welding)
    name = template.stem if frames.is_dir() or is_pattern(frames) else frames.stem
    if (body_template is None) != (body is None):
        raise InputError(
            f"{Option('body')} and {Option('body_template')} belong together: the body in motion, and at rest"
        )
    if body_template is None or body is None:
        if root is not None:
            raise InputError(
                f"{Option('root')} {root}: there is no body to find the root's motion of; give {Option('body')}"
            )
        count = garment.n_frames
        still = RootFrames(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
        return Scene(name, garment.mesh, {"garment": garment}, still, fps, range(count))
    dressed = _read(body, "body", axes, body_template, chosen=body_object, welding=welding)
    clip = Clip(
        template=Template(vertices=garment.mesh.vertices.astype(np.float32), faces=garment.mesh.faces),
        garment=Garment(garment.vertices()),
        body=Body(
            rest=dressed.mesh.vertices.astype(np.float32),
            faces=dressed.mesh.faces,
            vertices=dressed.vertices(),
        ),
        fps=fps,
        name=name,
    )
    return clip_scene(clip, root or "heading")


def _read(
    frames: Path, kind: Kind, axes: Axes, rest: Path, *, chosen: str | None, welding: bool
) -> MeshSequence:
    sequence = open_in_metres(frames, kind, axes, rest, which=Option(f"{kind}_object", chosen))
    return (weld_sequence(sequence) if welding else sequence).loaded()
