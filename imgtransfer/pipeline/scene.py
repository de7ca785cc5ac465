"""What is rendered together: a garment, a body or both in motion, from a clip or from plain mesh files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from imgtransfer.data.canonical import RootFrames, RootMode, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.importers.checks.axes import AS_AT_REST, Axes, MotionAxes
from imgtransfer.importers.checks.motion import note_motion
from imgtransfer.importers.sequences import open_in_metres, weld_sequence
from imgtransfer.importers.summary import mesh_text, motion_text, size_text
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
        taken: a line a mesh file in motion, what was taken from it.
    """

    name: str
    framed: Mesh
    meshes: dict[str, MeshSequence]
    frames: RootFrames
    fps: float
    numbers: range
    taken: tuple[str, ...] = ()

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
    motion_axes: MotionAxes = AS_AT_REST,
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
            they lie otherwise. motion_axes: the frames' of both, where they lie otherwise than at rest.
        garment_object, body_object: which mesh of an Alembic or USD file, by name or path; None takes the only one.
        welding: join split seams, so that normals are smooth across them.

    Raises:
        InputError: files that are missing, cannot be read or do not belong together; only one of the body's two; a
            root without a body; welded seams that part.
    """
    if (body_template is None) != (body is None):
        raise InputError(
            f"{Option('body')} and {Option('body_template')} belong together: the body in motion, and at rest"
        )
    axes = axes or Axes()
    garment_axes = garment_axes or axes
    chosen = Option("garment_object", garment_object), Option("body_object", body_object)
    moving = [open_in_metres(frames, "garment", garment_axes, template, motion=motion_axes, which=chosen[0])]
    if body is not None:
        moving.append(open_in_metres(body, "body", axes, body_template, motion=motion_axes, which=chosen[1]))
    note_motion(moving)
    sequences = [one.sequence for one in moving]
    taken = tuple(f"{motion_text(one)}; {mesh_text(one.mesh)}; {size_text(one.mesh)}" for one in sequences)
    total = sum(sequence.n_frames for sequence in sequences)
    with tqdm(total=total, desc="read", unit="frame", leave=False, disable=None) as bar:
        garment, *dressed = [(weld_sequence(one) if welding else one).loaded(bar.update) for one in sequences]
    name = template.stem if frames.is_dir() or is_pattern(frames) else frames.stem
    if not dressed:
        if root is not None:
            raise InputError(
                f"{Option('root')} {root}: there is no body to find the root's motion of; give {Option('body')}"
            )
        count = garment.n_frames
        still = RootFrames(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
        return Scene(name, garment.mesh, {"garment": garment}, still, fps, range(count), taken)
    (worn_by,) = dressed
    clip = Clip(
        template=Template(vertices=garment.mesh.vertices.astype(np.float32), faces=garment.mesh.faces),
        garment=Garment(garment.vertices()),
        body=Body(
            rest=worn_by.mesh.vertices.astype(np.float32),
            faces=worn_by.mesh.faces,
            vertices=worn_by.vertices(),
        ),
        fps=fps,
        name=name,
    )
    return replace(clip_scene(clip, root or "heading"), taken=taken)
