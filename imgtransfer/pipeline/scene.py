"""What is rendered together: a garment, a body or both in motion, from a clip or from plain mesh files."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from imgtransfer.data.canonical import RootFrames, RootMode, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Template
from imgtransfer.importers.checks.axes import AS_AT_REST, Axes, MotionAxes
from imgtransfer.importers.checks.motion import note_motion
from imgtransfer.importers.sequences import open_in_metres, weld_sequence
from imgtransfer.importers.summary import mesh_text, motion_text, size_text
from imgtransfer.importers.together import together
from render import InputError, Mesh, MeshSequence, Option
from render.files.frame_files import is_pattern

_log = logging.getLogger(__name__)

_MOST_IN_MEMORY = 1 << 28  # bytes of frames of mesh files; longer ones are read again when they are drawn
_AT_ONCE = 16  # frames


@dataclass(frozen=True, eq=False)
class Scene:
    """What is rendered together, with the same cameras and position box.

    Args:
        name: what folders and titles call it.
        framed: the mesh that the cameras are framed on: the garment's template.
        meshes: by name, "garment", "body" or both, all of T frames; in memory, or read whenever they are needed.
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
        meshes = {name: moving.selected(frames) for name, moving in self.meshes.items()}
        return replace(self, meshes=meshes, frames=self.frames.part(frames), numbers=self.numbers[frames])

    def canonical(self) -> dict[str, MeshSequence]:
        """The meshes by name, all frames in the canonical frame, float32."""

        def turned(vertices: np.ndarray, first: int) -> np.ndarray:
            return self.frames.part(slice(first, first + len(vertices))).to_canonical(vertices)

        return {name: moving.mapped(turned, moving.mesh) for name, moving in self.meshes.items()}


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
    moved = [one.sequence for one in moving]
    if len(moved) == 2:
        *moved, note = together(*moved)
        if note:
            _log.warning("note: %s", note)
    note_motion([replace(one, sequence=matched) for one, matched in zip(moving, moved, strict=True)])
    taken = tuple(f"{motion_text(one)}; {mesh_text(one.mesh)}; {size_text(one.mesh)}" for one in moved)
    sequences = [weld_sequence(one) if welding else one for one in moved]
    if sum(12 * one.n_frames * len(one.mesh.vertices) for one in sequences) <= _MOST_IN_MEMORY:
        with _reading(sum(one.n_frames for one in sequences)) as bar:
            sequences = [one.loaded(bar.update) for one in sequences]
    garment, *dressed = sequences
    name = template.stem if frames.is_dir() or is_pattern(frames) else frames.stem
    if dressed:
        return replace(_dressed(name, garment, dressed[0], root or "heading", fps), taken=taken)
    if root is not None:
        raise InputError(
            f"{Option('root')} {root}: there is no body to find the root's motion of; give {Option('body')}"
        )
    count = garment.n_frames
    still = RootFrames(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
    return Scene(name, garment.mesh, {"garment": garment}, still, fps, range(count), taken)


def _dressed(name: str, garment: MeshSequence, body: MeshSequence, root: RootMode, fps: float) -> Scene:
    """The scene of a garment on a body, whose motion tells the root's."""
    template = Template(vertices=garment.mesh.vertices.astype(np.float32), faces=garment.mesh.faces)
    rest = body.mesh.vertices.astype(np.float32)
    found = []
    with _reading(body.n_frames) as bar:
        for part in body.parts(_AT_ONCE):
            worn = Body(rest=rest, faces=body.mesh.faces, vertices=part)
            found.append(
                root_frames(Clip(template=template, garment=None, body=worn, fps=fps, name=name), root)
            )
            bar.update(len(part))
    frames = RootFrames(
        np.concatenate([one.rotation for one in found]), np.concatenate([one.translation for one in found])
    )
    framed = Mesh(template.vertices, template.faces, f"{name}: garment")
    meshes = {
        "body": replace(body, mesh=Mesh(rest, body.mesh.faces, f"{name}: body")),
        "garment": replace(garment, mesh=framed),
    }
    return Scene(name, framed, meshes, frames, fps, range(body.n_frames))


def _reading(n_frames: int) -> tqdm:
    return tqdm(total=n_frames, desc="read", unit="frame", leave=False, disable=None)
