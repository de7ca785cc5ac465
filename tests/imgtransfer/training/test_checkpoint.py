"""Model files that are damaged, or say what is not so: one line that names the file, and no memory taken."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from imgtransfer.data.clip import Clip
from imgtransfer.network.config import MapsConfig, NetworkConfig
from imgtransfer.network.memory import check_training_memory
from imgtransfer.training.checkpoint import load_model, save_model, write_tensors
from render import InputError
from tests.helpers.models import model_for
from tests.helpers.paths import ROOT

Parts = tuple[dict[str, torch.Tensor], dict[str, Any]]


@pytest.fixture(scope="module")
def parts(tube_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Parts:
    """Tensors and header of a good model."""
    path = save_model(tmp_path_factory.mktemp("good") / "model.safetensors", model_for(tube_clip))
    with safe_open(path, "pt") as file:
        tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118, not a dict
        return tensors, json.loads(file.metadata()["imgtransfer"])


def _network(header: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return header["network"] | changes


def _encoder(header: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return _network(header, encoder=header["network"]["encoder"] | changes)


def _weight(tensors: dict[str, torch.Tensor]) -> str:
    return next(key for key in tensors if key.startswith("model.position_net.") and tensors[key].ndim == 2)


HEADERS: dict[str, tuple[Callable[[dict[str, Any]], dict[str, Any]], str]] = {
    "a network a million wide": (lambda h: {"network": _encoder(h, dim=10**6)}, "not a model that this version"),
    "the widest network there is": (lambda h: {"network": _encoder(h, dim=8192, depth=256)}, "another architecture"),
    "more blocks": (lambda h: {"network": _network(h, blocks=256)}, "another architecture"),
    "larger images": (lambda h: {"maps": h["maps"] | {"size": [8192, 8192]}}, "another architecture"),
    "images without end": (lambda h: {"maps": h["maps"] | {"size": [10**9, 10**9]}}, "not a model that this"),
    "layers without end": (lambda h: {"maps": h["maps"] | {"layers": 100_000}}, "not a model that this version"),
    "views that are none": (lambda h: {"maps": h["maps"] | {"views": ["top"]}}, "not a model that this version"),
    "a network in words": (lambda _: {"network": "small"}, "not a model that this version can read"),
    "no box": (lambda _: {"box_lo": None}, "not a model that this version can read"),
    "a box in words": (lambda _: {"box_lo": ["a", "b", "c"]}, "not a model that this version can read"),
    "a box of mappings": (lambda _: {"box_lo": {"x": 1}}, "not a model that this version can read"),
    "a box that is not finite": (lambda _: {"box_hi": [float("inf")] * 3}, "not a model that this version can"),
    "cloth that rests nowhere": (lambda _: {"contact_offset_m": 0.3}, "contact_offset_m is 0.3; metres"),
    "an offset in words": (lambda _: {"contact_offset_m": "thin"}, "contact_offset_m is 'thin'"),
    "an offset that is a truth": (lambda _: {"contact_offset_m": True}, "contact_offset_m is True"),
    "a version that is none": (lambda _: {"format_version": [2]}, "version \\[2\\]"),
    "another format": (lambda _: {"format": "imgtransfer-training-state"}, "imgtransfer-model version 1 or 2 wanted"),
}  # fmt: skip
TENSORS: dict[str, tuple[Callable[[dict[str, torch.Tensor]], dict[str, torch.Tensor | None]], str]] = {
    "a weight missing": (lambda t: {_weight(t): None}, "another architecture"),
    "a weight more": (lambda _: {"model.position_net.more": torch.ones(2)}, "another architecture"),
    "a weight of another shape": (lambda t: {_weight(t): t[_weight(t)][:1]}, "another architecture"),
    "a weight that is not finite": (lambda t: {_weight(t): t[_weight(t)] * torch.nan}, "weights that are not finite"),
    "whole numbers for weights": (lambda t: {_weight(t): t[_weight(t)].long()}, "floating-point weights are wanted"),
    "no template": (lambda _: {"template_vertices": None}, "template_vertices"),
    "a template far away": (lambda t: {"template_vertices": t["template_vertices"] * 1e5}, "vertices: .* beyond"),
    "a template of bfloat16": (lambda t: {"template_vertices": t["template_vertices"][:1].bfloat16()}, "exist"),
    "faces out of range": (lambda t: {"template_faces": t["template_faces"] + 10**6}, "only 0"),
    "faces of parts": (lambda t: {"template_faces": t["template_faces"].double()}, "must be integers"),
    "a body without faces": (lambda _: {"body_vertices": torch.ones(3, 3)}, "body_faces"),
}  # fmt: skip


def _refused(path: Path, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load_model(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fault", HEADERS)
def test_headers_that_cannot_be_true(tmp_path: Path, parts: Parts, fault: str) -> None:
    tensors, header = parts
    change, message = HEADERS[fault]
    changed = json.dumps(header | change(header))
    path = tmp_path / "model.safetensors"
    save_file(tensors, path, metadata={"imgtransfer": changed})
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    _refused(path, message)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # kB


@pytest.mark.parametrize("text", ["[" * 100_000, "{", "1", '"x"', "\x00"])
def test_headers_that_are_no_json(tmp_path: Path, parts: Parts, text: str) -> None:
    path = tmp_path / "model.safetensors"
    save_file(parts[0], path, metadata={"imgtransfer": text})
    _refused(path, "not a readable safetensors file|found None")


@pytest.mark.parametrize("fault", TENSORS)
def test_tensors_that_do_not_fit(tmp_path: Path, parts: Parts, fault: str) -> None:
    tensors, header = parts
    change, message = TENSORS[fault]
    changed = {key: value for key, value in (tensors | change(tensors)).items() if value is not None}
    path = tmp_path / "model.safetensors"
    save_file(
        {key: value.contiguous() for key, value in changed.items()}, path, {"imgtransfer": json.dumps(header)}
    )
    _refused(path, message)


@pytest.mark.parametrize(
    "content",
    [
        b"\xff" * 8,  # a header as long as can be said
        (100).to_bytes(8, "little") + b"{",
        (2).to_bytes(8, "little") + b"{}",
        (60).to_bytes(8, "little") + b'{"a":{"dtype":"F32","shape":[999999999],"data_offsets":[0,4]}}'[:60],
    ],
)
def test_files_that_are_no_safetensors(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "model.safetensors"
    path.write_bytes(content)
    _refused(path, "not a readable safetensors file|found None")


def test_a_pipe_is_no_model(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "model.safetensors")
    _refused(tmp_path / "model.safetensors", "a pipe or a device")


def test_a_training_without_room_is_refused_before_it_takes_any() -> None:
    small = NetworkConfig.model_validate({"encoder": {"dim": 64, "depth": 2, "heads": 2}})
    check_training_memory(small, MapsConfig(), batch_frames=8)
    wide = NetworkConfig.model_validate({"encoder": {"dim": 8192, "depth": 256, "heads": 8}})
    with pytest.raises(InputError, match=r"two networks of \d+ weights .* need \d+\.\d GiB of memory, and"):
        check_training_memory(wide, MapsConfig(), batch_frames=1)
    with pytest.raises(InputError, match=r"batches of 4096 frames of 2048 x 2048 pixels need"):
        check_training_memory(NetworkConfig(), MapsConfig(size=(2048, 2048)), batch_frames=4096)


def test_a_writer_that_is_killed_leaves_nothing_that_the_next_does_not_remove(tmp_path: Path) -> None:
    """safetensors writes to a hidden file of its own, whose name is not ours to know."""
    target = tmp_path / "run" / "state.safetensors"
    program = (
        "import sys, torch; from imgtransfer.training.checkpoint import write_tensors\n"
        "while True: write_tensors(sys.argv[1], {'a': torch.zeros(2**23)}, {})"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(target)], env=os.environ | {"PYTHONPATH": str(ROOT)}
    ) as writer:
        while not any(tmp_path.rglob(".tmp*")) and writer.poll() is None:
            time.sleep(0.001)
        writer.kill()
    write_tensors(target, {"a": torch.zeros(2)}, {})
    assert [path.name for path in target.parent.iterdir()] == [target.name]
    assert target.stat().st_mode & 0o777 == 0o644
