"""`imgtransfer dress`: from a motion, or a moving body, to a file of the dressed figure."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imgtransfer.cli.mesh_options import OF_AXES, OF_GARMENT_AXES, OF_SEQUENCES, add_axes, add_objects
from imgtransfer.cli.options import frame_slice
from imgtransfer.running.messages import as_flag
from render import InputError
from render.options import Option, options_named

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.dressing.source import Source
    from imgtransfer.simulation.config import SimulateConfig

_GENERAL = "general"  # the checkpoint that comes with the package
_FABRICS = ("cotton", "silk", "denim")
_TOGETHER = 32  # frames that are written together
_OF_MESHES = (*OF_AXES, "weld")  # what goes with any mesh file
_OF_GARMENT = ("pinned", "garment_object", *OF_GARMENT_AXES)
_OF_BOTH = ("fps", "motion_up")  # of motion files and moving bodies
_OF_MOTIONS = ("body", "smpl", "arms_out")


def add_parser(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "dress",
        help="dress a motion, or your own moving body, and write the figure for Blender and other programs",
        description="Poses a body by a motion file, puts a garment on it, moves the garment by a network that has seen "
        "neither, and writes both. The file appears whole or not at all, in place of an earlier one; a folder must be "
        "new. The body stands where the motion's file has it.",
        examples=(
            "imgtransfer dress walk.bvh --garment dress --body weight=0.8 --out walk.glb",
            "imgtransfer dress walk.npz --garment shirt.obj --garment-unit=cm --weld --frames 0:100 --out walk.usd",
        ),
    )
    parser.add_argument(
        "motion",
        type=Path,
        metavar="MOTION",
        help="motion file (AMASS-style npz, BVH); or a moving body: a folder of meshes, one a frame, or with body/ or "
        "body.pc2 (.mdd) in it, a point cache, an Alembic or USD file",
    )
    parser.add_argument(
        "--garment",
        required=True,
        metavar="GARMENT",
        help="tshirt, dress, trousers or skirt; or a mesh file, made for the body's rest pose: a moving body needs one",
    )
    parser.add_argument(
        "--body",
        metavar="SHAPE",
        help="shape of the body: seed:7 for a random adult, or gender, age, muscle, weight, height and proportions, "
        "each from 0 to 1: weight=0.8,height=0.3; with --smpl gender and beta0 to beta9; default the mean shape",
    )
    parser.add_argument("--smpl", type=Path, metavar="FOLDER", help="a SMPL body, from your own model files")
    parser.add_argument(
        "--model",
        metavar="MODEL",
        help="a run's folder or a model.safetensors of networks, or OWNER/NAME on the Hugging Face hub; default "
        f"{_GENERAL}, which comes with the package and dresses any garment on any body",
    )
    parser.add_argument(
        "--self-contact",
        action="store_true",
        help="take the garment out of itself where folds pass through each other; fusing then takes up to 3 times as "
        "long",
    )
    parser.add_argument(
        "--simulate",
        action="store_true",
        help="simulate the cloth instead, to compare (extra simulate); nothing is written where it goes wrong",
    )
    parser.add_argument(
        "--settle",
        action="store_true",
        help="let your own garment hang on the resting body first, by simulation (extra simulate), where its file has "
        "a pattern, or a garment that was only put on",
    )
    parser.add_argument("--fabric", choices=_FABRICS, help="of the simulated cloth; default cotton")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="file to write; its ending says what: .glb, .usd, .abc, .npz and others; or a folder for one file a frame",
    )
    parser.add_argument(
        "--frames-as", choices=("obj", "ply"), help="form of the files in a folder; default obj"
    )
    parser.add_argument(
        "--frames",
        metavar="START:STOP",
        help="only these frames of the result, such as 0:100; all by default",
    )
    parser.add_argument(
        "--fps",
        type=float,
        help="frames a second that a motion is resampled to; of a moving body those of its files, where they do not "
        "say; default 30",
    )
    parser.add_argument(
        "--arms-out",
        type=float,
        metavar="DEGREES",
        help="how far hanging arms are turned away from the trunk, so that cloth has room; default 6",
    )
    parser.add_argument(
        "--joints",
        type=Path,
        metavar="FILE",
        help="YAML of what a BVH skeleton calls SMPL's joints, where its names do not tell (left_knee: Bone07)",
    )
    parser.add_argument(
        "--anyway",
        action="store_true",
        help="go on although the checks of motion, meshes or the simulated cloth found something",
    )
    _add_meshes(parser.add_argument_group("your own garment and body"))
    return parser


def _add_meshes(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--weld", action="store_true", help="join split seams; outputs still have the file's vertices and UVs"
    )
    group.add_argument(
        "--pinned",
        action="store_true",
        help="with --simulate or --settle: the garment's topmost opening is a waistband, which stays on the skin",
    )
    add_axes(group)
    add_objects(group, "garment", "body")
    group.add_argument("--body-rest", type=Path, metavar="FILE", help="the moving body in its rest pose")


def as_option(option: Option) -> str:
    """An option as this command has it: what is said of a motion file's up axis and of a SMPL body has other names."""
    if option.name == "up_axis":
        return as_flag(Option("motion_up", option.value))
    return f"--body gender={option.value or '...'}" if option.name == "gender" else as_flag(option)


class _Stopwatch:
    """Seconds of what is done, by name."""

    def __init__(self) -> None:
        self.started, self.seconds = time.perf_counter(), dict[str, float]()

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Add the seconds of the block."""
        started = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started

    def line(self) -> str:
        parts = [f"{name} {seconds:.1f} s" for name, seconds in self.seconds.items()]
        return f"{', '.join(parts)}; {time.perf_counter() - self.started:.1f} s in all"


def run(args: argparse.Namespace) -> None:
    """Dress one motion, and say where the file is and how the garment lies."""
    with options_named(as_option):
        _dress(args)


def _dress(args: argparse.Namespace) -> None:
    from imgtransfer.cli.dress_settings import figure_settings  # noqa: PLC0415
    from imgtransfer.dressing.source import open_source  # noqa: PLC0415
    from imgtransfer.exports import check_target  # noqa: PLC0415

    watch = _Stopwatch()
    frames = slice(None) if args.frames is None else frame_slice(args.frames)
    check_target(args.out)
    config = figure_settings(args)
    with watch.of("reading"):
        source = open_source(args.motion, config, frames=frames, anyway=args.anyway)
    _check_used(args, config)
    made = _simulated if args.simulate else _predicted
    lines = made(args, source, config, watch)
    print(
        f"figure   {config.garment.title}/{source.name}: {len(source.frames)} frames at {source.fps:g} a second"
    )
    for line in lines:
        print(line)
    print(f"time     {watch.line()}")
    print(f"written  {args.out}{_size(args.out)}")


def _predicted(
    args: argparse.Namespace, source: Source, config: SimulateConfig, watch: _Stopwatch
) -> list[str]:
    """Write the figure with the garment as the network moves it; what there is to say of it."""
    from fusion import FusionConfig  # noqa: PLC0415
    from imgtransfer.data.clip import Clip  # noqa: PLC0415
    from imgtransfer.dressing.deformed import predict_and_fuse  # noqa: PLC0415
    from imgtransfer.dressing.figure import figure_of  # noqa: PLC0415
    from imgtransfer.exports import written_animation  # noqa: PLC0415
    from imgtransfer.network.shapes import check_hangs  # noqa: PLC0415
    from imgtransfer.pipeline.fuse_summary import notes_of  # noqa: PLC0415
    from imgtransfer.simulation.hang import hanging_template  # noqa: PLC0415
    from imgtransfer.training.checkpoint import load_model  # noqa: PLC0415
    from imgtransfer.training.hub import model_path  # noqa: PLC0415

    with watch.of("model"):
        model = load_model(_of_networks(model_path(args.model or _GENERAL)))
    with watch.of("body and garment"):
        reader = figure_of(source, config)
        model.check_garment(still := reader.clip(0, 1))
        if args.settle:
            check_hangs(model.general, model.source)
        hangs = None
        if args.settle:
            hangs = hanging_template(still, pinned=args.pinned, anyway=args.anyway)
    with (
        _bar(reader.n_frames, reader.name) as bar,
        written_animation(args.out, n_frames=reader.n_frames, frames_as=args.frames_as) as add,
    ):

        def take(clip: Clip) -> None:
            with watch.of("writing"):
                add(clip)

        fusion = FusionConfig(self_contact=args.self_contact)
        done = predict_and_fuse(model, reader, take, fusion, hangs=hangs, progress=bar.update)
    watch.seconds |= {"predicting": done.predict_seconds, "fusing (all threads)": done.fuse_seconds}
    report = done.report
    body = report["crossing_percent"]["after"]
    return [
        _crossing(body, report["self_crossing_percent"]),
        *(f"look at  {note}" for note in notes_of(report)),
    ]


def _simulated(
    args: argparse.Namespace, source: Source, config: SimulateConfig, watch: _Stopwatch
) -> list[str]:
    """Write the figure with its cloth simulated; what there is to say of it."""
    from imgtransfer.dressing.simulated import simulate_source  # noqa: PLC0415
    from imgtransfer.exports import written_animation  # noqa: PLC0415

    with _bar(len(source.frames), source.name) as bar, watch.of("simulating"):
        clip, quality = simulate_source(
            source, config, anyway=args.anyway, progress=_Stages(bar, source.name)
        )
    with (
        watch.of("writing"),
        written_animation(args.out, n_frames=clip.n_frames, frames_as=args.frames_as) as add,
    ):
        for first in range(0, clip.n_frames, _TOGETHER):
            add(clip.slice(slice(first, first + _TOGETHER)))
    return [_crossing(quality.crossing_percent, quality.self_crossing_percent)]


def _crossing(body: float, itself: float) -> str:
    return f"crossing {body:.2f} % of the garment's edges the body, {itself:.2f} % the garment itself"


def _of_networks(path: Path) -> Path:
    """The model's path, if it is one of the networks that make maps."""
    from imgtransfer.deformers.checkpoint import is_deformer  # noqa: PLC0415

    if is_deformer(path):
        raise InputError(
            f"--model {path}: is of a method without maps; dress takes networks, `imgtransfer predict` any method"
        )
    return path


def _bar(frames: int, name: str) -> Any:
    from tqdm import tqdm  # noqa: PLC0415

    return tqdm(total=frames, desc=name, unit="frame", leave=False, disable=None)


class _Stages:
    """Shows the stages of a simulation on one bar, each from its beginning."""

    def __init__(self, bar: Any, name: str) -> None:
        self._bar, self._name, self._stage = bar, name, ""

    def __call__(self, stage: str, done: int, frames: int) -> None:
        if stage != self._stage:
            self._stage = stage
            self._bar.reset(frames)
            self._bar.set_description(f"{self._name}, {stage}")
        self._bar.update(done - self._bar.n)


def _size(path: Path) -> str:
    return f", {path.stat().st_size / 1e6:.1f} MB" if path.is_file() else ""


def _check_used(args: argparse.Namespace, config: SimulateConfig) -> None:
    """Raise InputError where an argument would do nothing."""
    from imgtransfer.dressing.source import is_motion_file  # noqa: PLC0415
    from imgtransfer.garments.config import TemplateConfig  # noqa: PLC0415

    motion, bvh = is_motion_file(args.motion), args.motion.suffix.lower() == ".bvh"
    own = isinstance(config.garment, TemplateConfig)
    needs = {
        "a motion file; a moving body is as it is": () if motion else _OF_MOTIONS,
        "BVH files; npz files have SMPL's joints": () if bvh else ("joints",),
        "a moving body": tuple(name for name in OF_SEQUENCES if name not in _OF_BOTH) if motion else (),
        "--garment FILE": () if own else (*_OF_GARMENT, "settle"),
        "--garment FILE or a moving body": _OF_MESHES if motion and not own else (),
        "--simulate": () if args.simulate else ("fabric",),
        "--simulate or --settle": () if args.simulate or args.settle else ("pinned",),
        "networks, not with --simulate": ("model", "self_contact", "settle") if args.simulate else (),
    }
    for what, options in needs.items():
        for option in options:
            if getattr(args, option) not in (None, False):
                raise InputError(f"--{option.replace('_', '-')} goes with {what}")
