"""`imgtransfer inspect`: what is in a data set, a clip, a map file or a checkpoint."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.cli.options import add_clip_choice, add_runner, add_views, chosen_executor, chosen_refs
from render import InputError
from render.errors import one_line

if TYPE_CHECKING:
    from imgtransfer.data.clip import Clip
    from imgtransfer.data.source import ClipRef


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "inspect",
        help="summarise a data set, clip npz, map npz or checkpoint",
        description="Sizes, splits, edge strain, body penetration, and how much of a garment the views see.",
        examples=(
            "imgtransfer inspect configs/sample_data/tshirt.zarr.zip --html sample.html",
            "imgtransfer inspect runs/demo",
        ),
    )
    parser.add_argument(
        "source", type=Path, help="data set, clip npz, folder of them, map npz, checkpoint or run"
    )
    add_clip_choice(parser)
    parser.add_argument(
        "--html",
        type=Path,
        metavar="PAGE",
        help="also write a page with pictures of every clip, strain and speed, and what looks wrong",
    )
    add_runner(parser)
    add_views(parser, default=None, note="default: front,back and four, two layers deep")
    return parser


def run(args: argparse.Namespace) -> None:
    """Find out what the source is, and print its summary."""
    from imgtransfer.data.location import as_url  # noqa: PLC0415

    source: Path = args.source
    if as_url(source) is not None:
        _clips(args)
        return
    if not source.exists():
        raise InputError(f"{source}: no such file or folder")
    checkpoints = sorted(source.glob("*.safetensors")) if source.is_dir() else [source]
    if checkpoints and checkpoints[0].suffix == ".safetensors":
        _check_unused(args, "a checkpoint")
        for checkpoint in checkpoints:
            _checkpoint(checkpoint)
    elif _is_map_file(source):
        _check_unused(args, "a map file")
        _maps(source)
    else:
        _clips(args)


def _check_unused(args: argparse.Namespace, what: str) -> None:
    """Raise InputError where an argument is for clips."""
    for option in ("split", "clip", "html", "ray", "views", "layers"):
        if getattr(args, option) is not None:
            raise InputError(f"--{option} goes with clips; {args.source} is {what}")


def _clips(args: argparse.Namespace) -> None:
    from tqdm import tqdm  # noqa: PLC0415

    if args.html is None and (args.workers != 1 or args.ray is not None):
        raise InputError("inspect: --workers and --ray go with --html, whose pictures take long")
    facts, rejected = _facts(args.source)
    for key, value in facts.items():
        print(f"{key}: {one_line(value)}")
    for name, reason in rejected.items():
        print(f"rejected {one_line(name)}: {one_line(reason)}")
    refs = chosen_refs(args, args.source)
    rows, frames, stills, unreadable = [], 0, [], []
    with tqdm(refs, unit="clip", leave=False, delay=2, disable=None) as bar:
        for ref in bar:
            try:
                clip = ref.load()  # one at a time: all of a large data set would not fit
            except InputError as error:
                rows.append([ref.name, one_line(ref.split or "-"), *["-"] * 8, "unreadable"])
                unreadable.append(str(error))
                continue
            rows.append(_row(clip, ref.split or "-"))
            frames += clip.n_frames
            stills.append(clip.slice(slice(0, 1)))
    _print_table(rows)
    print(f"{len(refs)} clips, {frames} frames")
    _coverage(stills, args)
    if args.html is not None:
        _page(args, facts, refs)
    if unreadable:
        raise InputError(
            unreadable[0]
            if len(refs) == 1
            else f"{len(unreadable)} of {len(refs)} clips cannot be read: {'; '.join(unreadable)}"
        )


def _facts(source: Path) -> tuple[dict[str, str], dict[str, str]]:
    """What a data set says of itself, and why clips were rejected, by name; nothing for clip npz files."""
    from imgtransfer.data.location import place_at  # noqa: PLC0415
    from imgtransfer.data.place import METADATA  # noqa: PLC0415
    from imgtransfer.data.store import DataSet  # noqa: PLC0415

    if not place_at(source).exists(METADATA):
        return {}, {}
    data = DataSet.open(source)
    told = {
        key: str(data.attributes[key]) for key in ("title", "source", "licence") if data.attributes.get(key)
    }
    rejected = {name: entry["reason"] for name, entry in data.rejected().items()}
    return told | {"schema": f"version {data.attributes['schema_version']}"}, rejected


def _row(clip: Clip, split: str) -> list[str]:
    from imgtransfer.evaluation.summary import summarise  # noqa: PLC0415

    s = summarise(clip)
    median, worst = (f"{value:.2f}" for value in s.strain) if s.strain else ("-", "-")
    percentages = [
        "-" if value is None else f"{value:.3f}" for value in (s.penetration, s.crossing, s.self_crossing)
    ]
    sizes = f"{s.garment_vertices}/{s.garment_faces}", f"{s.body_vertices}/{s.body_faces}"
    return [clip.name, one_line(split), str(s.frames), f"{s.fps:g}", *sizes, median, worst, *percentages]


def _print_table(rows: list[list[str]]) -> None:
    from tabulate import tabulate  # noqa: PLC0415

    strain, percentages = ("strain median %", "99th %"), ("inside %", "crossing body %", "itself %")
    headings = ["clip", "split", "frames", "fps", "garment v/f", "body v/f", *strain, *percentages]
    print(tabulate(rows, headers=headings, disable_numparse=True))


def _page(args: argparse.Namespace, facts: dict[str, str], refs: list[ClipRef]) -> None:
    """Write --html."""
    from imgtransfer.data.location import everywhere  # noqa: PLC0415
    from imgtransfer.report.data_page import MANY, PageTask, describe_clip, write_data_page  # noqa: PLC0415
    from imgtransfer.running import run_tasks  # noqa: PLC0415

    tasks = [PageTask(replace(ref, source=everywhere(ref.source)), len(refs) >= MANY) for ref in refs]
    run = run_tasks(
        describe_clip,
        tasks,
        executor=chosen_executor(args),
        name=lambda task: task.name,
        say=lambda part: "",
    )
    parts = list(run.values.values())
    title = facts.pop("title", args.source.name)
    path = write_data_page(args.html, title, facts, parts)
    wrong = sum(bool(part.findings) for part in parts)
    print(f"page     {path}: {wrong} of {len(parts)} clips to look at, {path.stat().st_size / 1e6:.1f} MB")
    run.check()
    unreadable = sum(part.unreadable for part in parts)
    if unreadable:
        raise InputError(f"{args.source}: {unreadable} of {len(parts)} clips cannot be read; {path} says why")


def _coverage(clips: Iterable[Clip], args: argparse.Namespace) -> None:
    """Print in how many shapes each garment occurs, and what the views see of the first of them."""
    from render import Coverage, Mesh, TemplateImager  # noqa: PLC0415

    views = [args.views] if args.views else ["front,back", "four"]
    layers = args.layers or (1 if args.views else 2)
    garments: dict[bytes, dict[bytes, Clip]] = {}
    for clip in clips:
        shapes = garments.setdefault(clip.template.faces.tobytes(), {})
        shapes.setdefault(clip.template.vertices.tobytes() + clip.body.rest.tobytes(), clip)
    for shapes in garments.values():
        clip = next(iter(shapes.values()))
        if len(shapes) > 1:
            print(f"the garment of {clip.name} comes in {len(shapes)} shapes (templates and rest bodies)")
        template = Mesh(clip.template.vertices, clip.template.faces, f"{clip.name}: garment")
        for chosen in views:
            coverage = Coverage.of(TemplateImager.build(template, views=chosen, layers=layers))
            print(f"vertices seen of {clip.name} by {chosen}: {coverage}")


def _is_map_file(source: Path) -> bool:
    from render.files.npz import open_npz  # noqa: PLC0415

    if source.suffix != ".npz" or source.is_dir():
        return False
    with open_npz(source, "a clip or maps") as npz:
        return "view_matrices" in npz


def _maps(source: Path) -> None:
    from render import open_maps  # noqa: PLC0415

    reader = open_maps(source)
    maps = next(reader.parts(1))
    for _ in reader.parts(16):  # what is damaged anywhere is named
        pass
    height, width = maps.mask.shape[1:]
    kinds = [kind for kind in ("position", "normal") if getattr(maps, kind) is not None]
    print(f"maps: {' and '.join(kinds)}, {reader.n_frames} frames at {maps.fps:g} fps")
    print(f"views: {one_line(', '.join(maps.views))}, {height} x {width} pixels (height x width)")
    covered = [
        f"{view} {100 * fraction:.1f} %"
        for view, fraction in zip(maps.views, maps.mask.mean((1, 2)), strict=True)
    ]
    print(f"covered pixels: {', '.join(covered)}")
    print(f"box: {maps.box.lo.round(3).tolist()} to {maps.box.hi.round(3).tolist()} m")
    shape = "" if maps.rest_vertices is None else "; the frames are of another shape of it"
    print(f"template: {len(maps.template_vertices)} vertices, {len(maps.template_faces)} faces{shape}")
    if maps.contact_offset_m is not None:
        print(f"cloth rests {1e3 * maps.contact_offset_m:.1f} mm off the skin")


def _checkpoint(source: Path) -> None:
    from safetensors import SafetensorError, safe_open  # noqa: PLC0415

    from render.files.atomic import check_regular  # noqa: PLC0415

    check_regular(source, "a model that `imgtransfer train` wrote")
    try:
        with safe_open(source, framework="numpy") as stored:
            shapes = {name: stored.get_slice(name) for name in stored.keys()}  # noqa: SIM118 - not a dictionary
            parts: dict[str, int] = {}
            for name, tensor in shapes.items():
                count = 1
                for length in tensor.get_shape():
                    count *= length
                part = ".".join(word for word in name.split(".")[:2] if not word.isdigit())
                parts[part] = parts.get(part, 0) + count
            kinds = sorted({tensor.get_dtype() for tensor in shapes.values()})
            metadata = stored.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise InputError(f"{source}: not a readable safetensors file ({error})") from error
    size = source.stat().st_size / 1e6
    total = sum(parts.values())
    print(f"{source}: {len(shapes)} tensors, {total:,} numbers ({', '.join(kinds)}), {size:.1f} MB")
    for part, count in parts.items():
        print(f"  {one_line(part):32} {count:>12,}")
    for key, value in metadata.items():
        print(f"  {one_line(key)}: {one_line(value if len(value) <= 100 else value[:97] + '...')}")
