"""What moves the body: a motion file, or a mesh sequence of the body itself."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

from imgtransfer.data.schema import valid_clip_name
from imgtransfer.garments.config import GarmentConfig
from imgtransfer.importers.checks.findings import refuse
from imgtransfer.importers.checks.motion import check_motion
from imgtransfer.importers.formats.meshes import FPS
from imgtransfer.importers.mesh_files import rest_mesh
from imgtransfer.motions.check import motion_faults
from imgtransfer.motions.files import SUFFIXES, read_motion
from imgtransfer.motions.motion import Motion, arms_out
from imgtransfer.running.fingerprint import files_fingerprint
from imgtransfer.simulation.body_motion.body_sequence import BodySequence, find_sequence
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.motion_config import SequenceFiles
from imgtransfer.simulation.planning.sources import has_body
from render import InputError, Option
from render.files.frame_files import is_pattern
from render.files.sequence import is_sequence, sequence_files

_log = logging.getLogger(__name__)

_WANTED = (
    "wanted is a motion file (AMASS-style .npz, or .bvh), or a moving body: a folder of its meshes, a point cache with "
    "its mesh beside it (.pc2, .mdd, .pc16), an Alembic or USD file"
)


@dataclass(frozen=True, eq=False)
class Source:
    """A motion of the configuration's body, or the user's own body in motion.

    Args:
        moved: which of the two, at the frame rate of the result; of a motion all frames.
        frames: which of its frames are wanted, one or more.
    """

    moved: Motion | BodySequence
    frames: range

    @property
    def name(self) -> str:
        """What clips are called after it."""
        return self.moved.name

    @property
    def fps(self) -> float:
        """Frames a second of those that are wanted."""
        return self.moved.fps / self.frames.step


def needs_own_garment(garment: GarmentConfig, source: Source) -> InputError:
    """What is said of a garment of the project's on a body without a skeleton."""
    return InputError(
        f"{source.name}: a {garment.title} cannot be cut for a moving body, which has no skeleton; give a mesh of your "
        f"own, made for its rest pose, by {Option('garment')} FILE"
    )


def is_motion_file(path: Path) -> bool:
    """Whether a path is read as a motion file, by its ending."""
    return path.suffix.lower() in SUFFIXES


def open_source(
    path: Path, config: SimulateConfig, *, frames: slice = slice(None), anyway: bool = False
) -> Source:
    """Read a motion, or look at a mesh sequence's first frame and a few others.

    Args:
        path: a motion file, a folder of mesh files or with `body/` in it, a pattern of files, a point cache, or an
            Alembic or USD file.
        config: how the files are read; `fps` is the result's for motions, and that of sequences which do not say.
        frames: which frames of the result are wanted.
        anyway: go on although no body can move so, or the sequence's checks found something.

    Raises:
        InputError: nothing there, something else, files that cannot be read, frames that are not there, or a motion
            that no body can do.
    """
    if is_motion_file(path):
        motion, summary = read_motion(
            path, fps=config.fps, up_axis=config.files.up_axis, joints=config.files.joints
        )
        _log.info("motion   %s", summary)
        chosen = _chosen(frames, len(motion.poses), path)
        _check(motion, chosen, path, config, anyway=anyway)
        name = valid_clip_name("", path.stem).partition("/")[2]
        return Source(replace(arms_out(motion, config.files.arms_out), name=name), chosen)
    sequence = _sequence(path, config.sequences, config.fps)
    opened = sequence.open()
    if sequence.rest is None:
        _log.warning("note: %s: no body_rest beside it, so its first frame is taken as the rest pose", path)
    for text in refuse(check_motion([opened]), anyway=anyway):
        _log.warning("note: %s", text)
    fps = float(sequence.settings.fps or opened.sequence.fps or FPS)
    return Source(replace(sequence, fps=fps), _chosen(frames, opened.sequence.n_frames, path))


def _sequence(path: Path, settings: SequenceFiles, fps: float) -> BodySequence:
    """The body mesh sequence at a path.

    Raises:
        InputError: nothing that is one.
    """
    if not is_pattern(path) and not path.exists():
        raise InputError(f"{path}: no such file or folder; {_WANTED}")
    if not is_sequence(path):
        raise InputError(f"{path}: neither a motion nor a moving body; {_WANTED}")
    if path.is_dir() and has_body(path):
        return find_sequence(path, settings, fps)
    files = sequence_files(path)
    rest = settings.body_rest or rest_mesh(path.parent, path, "body")
    name = valid_clip_name("", path.name if path.is_dir() else path.stem).partition("/")[2]
    return BodySequence(name, path, rest, settings, fps, files_fingerprint(files))


def _chosen(frames: slice, count: int, path: Path) -> range:
    chosen = range(count)[frames]
    if not chosen:
        wanted = Option("frames", f"{_text(frames.start)}:{_text(frames.stop)}")
        raise InputError(f"{wanted}: {path} has the frames 0 to {count - 1}")
    return chosen


def _text(number: int | None) -> str:
    return "" if number is None else str(number)


def _check(motion: Motion, frames: range, path: Path, config: SimulateConfig, *, anyway: bool) -> None:
    """Raise InputError where a body cannot do the frames, from the first to the last that are wanted."""
    part = slice(frames[0], max(frames[-1], frames[0] + 1) + 1)
    if len(motion.poses[part]) < 2:
        part = slice(len(motion.poses) - 2, len(motion.poses))
    cut = replace(motion, poses=motion.poses[part], trans=motion.trans[part])
    faults = motion_faults(cut, turning=config.files.turning, path_speed=config.files.path_speed)
    if not faults:
        return
    text = f"{path}: from frame {part.start} on, {'; '.join(faults)}"
    if not anyway:
        raise InputError(f"{text} ({Option('anyway', True)} goes on all the same)")
    _log.warning("note: %s", text)
