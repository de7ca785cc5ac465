"""Models and training states on disk: safetensors files that say what they hold."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from imgtransfer.network import MapsConfig, NetworkConfig, TransferModel
from imgtransfer.network.config import check_laid_out
from imgtransfer.network.memory import least_weights
from imgtransfer.network.shared_trunk import share_trunks
from imgtransfer.training.head_state import empty_head
from render import InputError, Mesh, Option, PositionBox
from render.errors import said_by
from render.files.atomic import check_regular, written_whole
from render.limits import check_contact_offset
from render.mesh.mesh import check_finite

MODEL_FILE, STATE_FILE = "model.safetensors", "state.safetensors"
MODEL_FORMAT, STATE_FORMAT, FORMAT_VERSION = "imgtransfer-model", "imgtransfer-training-state", 2
# Large numbers of both signs that nearly cancel.
NEVER_ROUNDED = frozenset({"head.weights", "head.offset", "head.width"})
_UNREADABLE = (SafetensorError, OSError, ValueError, TypeError, KeyError, RuntimeError, MemoryError)
_LAYOUTS = ("template_layout", "body_layout")
READABLE_VERSIONS = (1, 2)  # version 1 has no body: its models know one shape


def save_model(path: str | Path, model: TransferModel, *, stored: str = "float32", steps: int = 0) -> Path:
    """Write a model whole or not at all.

    The file's header holds, as JSON, the format and its version, both configurations and the position box;
    the template and its body are stored as tensors beside the weights. A general model's header says so, and has the
    views as they were asked for, so that each template gets its own cameras.

    Args:
        path: a .safetensors file.
        model: what to write.
        stored: "float32" or "float16", the number type of the weights.
        steps: how many steps it was trained for, for the record.

    Returns:
        The path.

    Raises:
        InputError: it cannot be written, such as for want of space.
    """
    dtype = {"float32": torch.float32, "float16": torch.float16}[stored]
    tensors = {
        f"model.{key}": value if key in NEVER_ROUNDED else value.to(dtype)
        for key, value in model.state_dict().items()
    }
    tensors["template_vertices"] = torch.from_numpy(model.imager.mesh.vertices)
    tensors["template_faces"] = torch.from_numpy(model.imager.mesh.faces.astype(np.int32))
    if model.body is not None:
        tensors["body_vertices"] = torch.from_numpy(model.body.vertices)
        tensors["body_faces"] = torch.from_numpy(model.body.faces.astype(np.int32))
    for name, layout in zip(_LAYOUTS, model.layouts or (), strict=False):
        tensors[f"{name}_vertices"] = torch.from_numpy(layout.vertices)
        tensors[f"{name}_faces"] = torch.from_numpy(layout.faces.astype(np.int32))
    header = {
        "format": MODEL_FORMAT,
        "format_version": FORMAT_VERSION,
        "general": model.general,
        "maps": (model.asked if model.general else model.maps).model_dump(mode="json"),
        "network": model.network.model_dump(mode="json"),
        "box_lo": model.box.lo.tolist(),
        "box_hi": model.box.hi.tolist(),
        "mirrored_average": model.mirrored_average,
        "contact_offset_m": model.contact_offset_m,
        "steps": steps,
    }
    if model.architecture is not None:
        header["encoder"] = model.architecture
    return write_tensors(path, tensors, header)


def load_model(path: str | Path, *, device: str | torch.device = "cpu") -> TransferModel:
    """Read a model for prediction.

    Args:
        path: a model file, or a run's folder with `model.safetensors` in it.
        device: where the networks shall be.

    Raises:
        InputError: no such file, not a model, of another format version, or weights that do not fit the sizes
            that the file's header states.
    """
    path = Path(path)
    if path.is_dir():
        path = path / MODEL_FILE
    tensors, header = read_tensors(path, MODEL_FORMAT)
    try:
        maps, network = (
            MapsConfig.model_validate(header["maps"]),
            NetworkConfig.model_validate(header["network"]),
        )
        box = PositionBox(np.asarray(header["box_lo"]), np.asarray(header["box_hi"]))
        template = _mesh(tensors, "template", path)
        body = _mesh(tensors, "body", path) if "body_vertices" in tensors else None
        layouts = None
        if maps.laid_out:
            garment_layout, body_layout = (_mesh(tensors, name, path) for name in _LAYOUTS)
            layouts = garment_layout, body_layout
            check_laid_out(maps, network, mirror=header.get("mirrored_average", False))
        mirrored_average = header.get(
            "mirrored_average", False
        )  # models made before it was recorded have none
        if not isinstance(mirrored_average, bool):
            raise TypeError(f"mirrored_average is {mirrored_average!r}, and true or false is wanted")
        offset = known_offset(header, path)
        general = header.get("general", False)  # the same
        if not isinstance(general, bool) or (general and network.body != "local"):
            raise TypeError(f"general is {general!r} with body: {network.body}")
        architecture = header.get("encoder")
        if (architecture is not None) != (network.encoder.kind == "hub"):
            raise TypeError(f"the encoder's architecture with encoder.kind: {network.encoder.kind}")
    # pydantic's ValidationError is a ValueError
    except (KeyError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"{path}: not a model that this version can read ({said_by(error)})") from error
    _check_shapes(network, maps, tensors, architecture, path)
    model = TransferModel(
        maps=maps,
        network=network,
        template=template,
        box=box,
        body=body,
        general=general,
        architecture=architecture,
        layouts=layouts,
    )
    load_weights(model, tensors, path)
    share_trunks(model.position_net, model.normal_net)
    model.source, model.mirrored_average = str(path), mirrored_average
    model.contact_offset_m = offset
    return model.eval().to(device)


def known_offset(header: dict[str, Any], path: Path) -> float | None:
    """How far off the skin cloth rests, as a file's header says; models made before it was recorded do not.

    Raises:
        TypeError: no number.
        InputError: none that can be.
    """
    offset = header.get("contact_offset_m")
    if offset is None:
        return None
    if isinstance(offset, bool) or not isinstance(offset, int | float):
        raise TypeError(f"contact_offset_m is {offset!r}, and metres are wanted")
    check_contact_offset(offset, str(path))
    return float(offset)


def _mesh(tensors: dict[str, Tensor], name: str, path: Path) -> Mesh:
    """The mesh of this name, taken out of the tensors."""
    vertices, faces = tensors.pop(f"{name}_vertices").double(), tensors.pop(f"{name}_faces")
    if faces.is_floating_point() or faces.is_complex():
        raise InputError(f"{path}: {name}_faces must be integers, found {faces.dtype}")
    mesh = Mesh(vertices.numpy(), faces.long().numpy(), str(path))
    check_finite(mesh.vertices, f"{path}: {name}_vertices")
    return mesh


def _check_shapes(
    network: NetworkConfig,
    maps: MapsConfig,
    tensors: dict[str, Tensor],
    architecture: dict[str, Any] | None,
    path: Path,
) -> None:
    """Compare a file's weights with those that its header states, before room is made for networks of any size."""
    counts = [("refinement", network.blocks)]
    if network.encoder.kind == "vit":
        counts.insert(0, ("encoder.blocks", network.encoder.depth))
    for part, stated in counts:
        start = f"model.position_net.{part}."
        there = {key.removeprefix(start).partition(".")[0] for key in tensors if key.startswith(start)}
        if len(there) != stated:
            raise InputError(
                f"{path}: the weights are of another architecture ({len(there)} blocks of {part}, not {stated})"
            )
    count = sum(value.numel() for key, value in tensors.items() if key.startswith("model."))
    try:
        least = 2 * least_weights(network, maps, architecture)
    except InputError as error:  # of the encoder's architecture
        raise InputError(f"{path}: {error}") from error
    if count < least:
        raise InputError(
            f"{path}: the weights are of another architecture ({count} of them, and its header needs {least} at least)"
        )


def fingerprint(path: str | Path) -> str:
    """SHA-256 of the model file that `load_model(path)` reads, as hexadecimal digits: which model made a result."""
    path = Path(path)
    with (path / MODEL_FILE if path.is_dir() else path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def load_weights(model: TransferModel, tensors: dict[str, Tensor], path: Path) -> None:
    """Put the tensors "model.*" into the model, each and no other.

    Raises:
        InputError: weights that are not finite floating-point numbers, or of another architecture.
    """
    weights = _weights(tensors, "model", path)
    if model.network.head.kind == "kernel":
        model.head = empty_head(model, weights, path)
    try:
        model.load_state_dict(weights, strict=True)
    except RuntimeError as error:
        raise InputError(f"{path}: the weights are of another architecture ({said_by(error)})") from error


def averaged_weights(tensors: dict[str, Tensor], model: TransferModel, path: Path) -> dict[str, Tensor]:
    """The tensors "average.*" by the names of the model's parameters (`training.ema`).

    Raises:
        InputError: not one for each parameter, of its shape, finite.
    """
    mean = _weights(tensors, "average", path)
    wanted = {name: parameter.shape for name, parameter in model.named_parameters()}
    if {name: value.shape for name, value in mean.items()} != wanted:
        raise InputError(
            f"{path}: damaged, its averaged weights do not fit the model; choose another {Option('out')} for a new run"
        )
    return mean


def _weights(tensors: dict[str, Tensor], kind: str, path: Path) -> dict[str, Tensor]:
    """The tensors "KIND.NAME" by name, float32."""
    start = f"{kind}."
    weights = {key.removeprefix(start): value for key, value in tensors.items() if key.startswith(start)}
    odd = [key for key, value in weights.items() if not value.is_floating_point()]
    if odd:
        raise InputError(
            f"{path}: {odd[0]} holds {weights[odd[0]].dtype}, and floating-point weights are wanted"
        )
    weights = {key: value.float() for key, value in weights.items()}
    if not all(bool(value.isfinite().all()) for value in weights.values()):
        raise InputError(
            f"{path}: has weights that are not finite; the training diverged, or the file is damaged"
        )
    return weights


def optimizer_state(
    tensors: dict[str, Tensor], parameters: Sequence[Tensor], path: Path, *, begun: bool
) -> dict[int, dict[str, Tensor]]:
    """The tensors "optimizer.NUMBER.NAME" by number and name, as the optimiser takes them.

    Raises:
        InputError: not what an optimiser of these parameters has, or nothing though it has `begun`.
    """
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        kind, _, rest = key.partition(".")
        number, _, name = rest.partition(".")
        if kind == "optimizer" and number.isdecimal():
            state.setdefault(int(number), {})[name] = value
    wanted = {
        number: {"step": torch.Size(()), "exp_avg": parameter.shape, "exp_avg_sq": parameter.shape}
        for number, parameter in enumerate(parameters)
    }
    shapes = {number: {name: value.shape for name, value in its.items()} for number, its in state.items()}
    if bool(shapes) != begun or not shapes.items() <= wanted.items():
        raise InputError(
            f"{path}: damaged, its optimiser's state does not fit the model; choose another {Option('out')} for a new "
            "run"
        )
    return state


def write_tensors(path: str | Path, tensors: dict[str, Tensor], header: dict[str, Any]) -> Path:
    """Write a safetensors file whole or not at all; `header` becomes JSON in its metadata.

    Raises:
        InputError: it cannot be written, such as for want of space.
    """
    whole: dict[str, Tensor] = {}
    written: set[int] = set()
    for key, value in tensors.items():
        on_cpu = value.detach().cpu().contiguous()
        place = on_cpu.untyped_storage().data_ptr()
        # The format has no tensors in shared memory.
        whole[key] = on_cpu.clone() if place in written else on_cpu
        written.add(place)
    try:
        # safetensors writes to a file of its own beside the one it is given, and renames that.
        with written_whole(Path(path), own_folder=True) as temporary:
            save_file(whole, temporary, metadata={"imgtransfer": json.dumps(header)})
    except SafetensorError as error:  # instead of an OSError
        raise InputError(f"{path}: cannot be written ({said_by(error)})") from error
    return Path(path)


def read_tensors(path: Path, wanted: str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors and header of a file that `write_tensors` made.

    Raises:
        InputError: no such file, not safetensors, or not of format `wanted` and a version that this one reads.
    """
    header = read_header(path)
    kind, version = header.get("format"), header.get("format_version")
    if kind != wanted or version not in READABLE_VERSIONS:
        versions = " or ".join(map(str, READABLE_VERSIONS))
        raise InputError(f"{path}: {wanted} version {versions} wanted, found {kind} version {version}")
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118, not a dict
    # A header may name types that PyTorch has none of.
    except _UNREADABLE as error:
        raise InputError(f"{path}: not a readable safetensors file ({said_by(error)})") from error
    return tensors, header


def read_header(path: Path) -> dict[str, Any]:
    """What `write_tensors` put into a file's metadata; empty where that is none of ours.

    Raises:
        InputError: no such file, or not safetensors.
    """
    check_regular(path, "a file that `imgtransfer train` wrote")
    try:
        with safe_open(path, framework="pt") as file:
            header = json.loads((file.metadata() or {}).get("imgtransfer", "{}"))
    except _UNREADABLE as error:  # a header may be nested without end
        raise InputError(f"{path}: not a readable safetensors file ({said_by(error)})") from error
    return header if isinstance(header, dict) else {}
