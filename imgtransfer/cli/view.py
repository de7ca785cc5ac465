"""`imgtransfer view`: clips and predictions in motion, and a garment predicted live, as a page in the browser."""

from __future__ import annotations

import argparse

from imgtransfer.cli.options import add_clip_names, whole_number
from render import InputError

_GENERAL = "general"
_LAST_PORT = 65535


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "view",
        help="look at clips and predictions in motion, in the browser",
        description="A page with clips in motion: predictions side by side with the truth, errors and strain as "
        "colours, crossing edges, maps; and a garment predicted live on a body shaped and posed by sliders.",
        examples=(
            "imgtransfer view configs/sample_data/tshirt.zarr.zip",
            "imgtransfer view configs/sample_data/tshirt.zarr.zip predictions --clip 'tshirt/punch*'",
        ),
    )
    parser.add_argument(
        "source",
        nargs="*",
        help="data set, clip npz, folder of them, or folder that predict or fuse wrote; several are shown side by "
        "side, and without any only the live garment is",
    )
    add_clip_names(parser)
    parser.add_argument(
        "--model",
        help="for the live garment: a run's folder, a model.safetensors or OWNER/NAME on the Hugging Face hub, of a "
        "general model; default general, which comes with the package",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to serve the page on; default 127.0.0.1")
    parser.add_argument(
        "--port", type=port_number, help="port to serve it on; default 8080, 0 is any free one"
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the page's address")
    return parser


def run(args: argparse.Namespace) -> None:
    """Serve the page until Ctrl-C."""
    from imgtransfer.training.hub import model_path  # noqa: PLC0415
    from imgtransfer.viewing import (  # noqa: PLC0415
        PORT,
        LiveControls,
        Show,
        address_of,
        open_browser,
        open_sources,
        page_server,
    )

    if args.clip and not args.source:
        raise InputError(f"view: --clip {args.clip[0]} chooses among the clips of sources, and none is given")
    clips = open_sources(args.source, args.clip)
    live = LiveControls(model_path(args.model or _GENERAL), on=not clips)
    if args.model or not clips:  # it is wanted, and not only at hand
        live.check()
    with page_server(args.host, PORT if args.port is None else args.port) as server:
        show = Show(server, clips, live)
        show.draw()
        address = address_of(server)
        print(f"look at {address} (Ctrl-C ends)", flush=True)
        if not args.no_browser:
            open_browser(address)
        show.run()


def port_number(text: str) -> int:
    """0 to 65535, for argparse's `type`."""
    number = whole_number(text)
    if number is None or number > _LAST_PORT:
        raise argparse.ArgumentTypeError(f"a number from 0 to {_LAST_PORT} is wanted, found {text!r:.40}")
    return number
