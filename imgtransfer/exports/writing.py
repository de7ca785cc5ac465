"""One way to write a clip in motion, whatever the form; frames come some at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from imgtransfer.data.clip import Clip, written_clip
from imgtransfer.data.mesh_output import MeshFrames, MeshKind
from imgtransfer.exports.objects import objects_of
from imgtransfer.exports.targets import CACHES, USD, check_target
from render import InputError, Option
from render.files.atomic import written_whole_folder

Add = Callable[[Clip], None]


@contextmanager
def written_animation(
    path: Path, *, n_frames: int, step: int = 1, frames_as: MeshKind | None = None
) -> Iterator[Add]:
    """Yield what takes the frames of a clip in order, some at a time; what is written appears whole, or not at all.

    The first frame is frame 0, at 0 s. Vertices, triangles, texture coordinates and materials are those of the file
    that the template came from, in its order; lengths are metres, y is up.

    Args:
        path: its ending chooses the form (`ENDINGS`); without one it is a folder with garment and body in every frame
            and at rest, as `import meshes` reads them.
        n_frames: that will come, T.
        step: only every so many frames are written; times and numbers in file names stay those of the clip.
        frames_as: form of the files in a folder; OBJ if not given.

    Raises:
        InputError: as `check_target`; a `step` for npz, which hold every frame; `frames_as` where no folder is written;
            more than the form can hold.
    """
    check_target(path)
    ending = path.suffix.lower()
    if ending == ".npz" and step != 1:
        raise InputError(
            f"{Option('step', step)}: a .npz holds every frame; {Option('step')} goes with the others"
        )
    if ending and frames_as is not None:
        raise InputError(f"{Option('frames_as', frames_as)}: goes with a folder, but {path} is a {ending}")
    kept = len(range(0, n_frames, step))
    with _writer(path, ending, kept, step, frames_as or "obj") as add:
        yield _every(add, step)


def _writer(
    path: Path, ending: str, n_frames: int, step: int, frames_as: MeshKind
) -> AbstractContextManager[Add]:
    """Takes those frames that are written, of which `n_frames` come."""
    # Each form's module is imported only where it is wanted: USD and Alembic are extras.
    if ending == ".npz":
        return written_clip(path)
    if ending == ".glb":
        from imgtransfer.exports.gltf import written_glb  # noqa: PLC0415

        return written_glb(path, n_frames=n_frames, step=step)
    if ending in USD:
        from imgtransfer.exports.usd import written_usd  # noqa: PLC0415

        return written_usd(path, n_frames=n_frames, step=step)
    if ending == ".abc":
        from imgtransfer.exports.alembic import written_alembic  # noqa: PLC0415

        return written_alembic(path, step=step)
    if ending in CACHES:
        from imgtransfer.exports.point_caches import written_caches  # noqa: PLC0415

        return written_caches(path, n_frames=n_frames, step=step)
    return _written_folder(path, step, frames_as)


def _every(add: Add, step: int) -> Add:
    """Hands on every `step`-th frame of all that come."""
    done = 0

    def some(part: Clip) -> None:
        nonlocal done
        first = -done % step
        done += part.n_frames
        if step == 1:
            add(part)
        elif first < part.n_frames:
            add(part.slice(slice(first, None, step)))

    return some


@contextmanager
def _written_folder(folder: Path, step: int, kind: MeshKind) -> Iterator[Add]:
    """One file a frame, named as `import meshes` and `simulate` look for them, rest pose included."""
    writers: dict[str, MeshFrames] = {}

    with written_whole_folder(folder) as temporary:

        def add(part: Clip) -> None:
            for thing in objects_of(part):
                if thing.name not in writers:
                    writers[thing.name] = MeshFrames(temporary, thing.rest, kind, name=thing.name, step=step)
                    writers[thing.name].add_still("template" if thing.name == "garment" else "body_rest")
                writers[thing.name].add(thing.moved(part))

        yield add
