"""Settings that make no sense, in configurations and by --set."""

from __future__ import annotations

import random
from pathlib import Path

from tests.bad_inputs.case import Case

SETTINGS = (
    "training.steps=1e400", "training.steps=99999999999999999999", "training.steps=-1", "training.steps=²",
    "training.steps=[", "training.steps", "=3", "training=3", "training.steps.x=1", "training.batch_frames=1000000000",
    "training.learning_rate=.inf", "training.learning_rate=1e300", "training.threads=-1", "training.seed=1e3",
    "training.precision=int4", "training.stored=float8", "training.validate_every_steps=0",
    "network.encoder.dim=1000000000", "network.encoder.dim=17", "network.encoder.depth=100000000",
    "network.encoder.patch=7", "network.encoder.patch=0", "network.encoder.heads=0", "network.blocks=100000000",
    "network.heads=3", "network.target=guess", "network.head.kind=kernel", "network.head.patches=0",
    "maps.size=[32]", "maps.size=[1000000000, 1000000000]",
    "maps.size=[-8, 8]", "maps.size=big", "maps.views=[]", "maps.views=[front, front]", "maps.views={a: 1}",
    "maps.layers=100000", "maps.root=tail", "data.source=[1]", "data.source=", "data.train.split=nothing",
    "data.train.names=[]", "data.train.names=[3]", "data.validation_frames=-1", "data.source=/dev/zero",
    "data.source=&a [*a]", "data.source=!!python/name:os.system", "a.b.c=1", "training.steps=" + "[" * 5000,
    "training.seed=" + "9" * 5000, "data.source='a\0b'",
)  # fmt: skip
FUSION = (
    "collision_margin_m: .nan", "collision_margin_m: 1e300", "edge_iterations: 1000000000000000000000",
    "normal_iterations: -1", "solver: magic", "sdf_every_iterations: 0", "weight_edge: .inf", "weight_edge: 1e300",
    "weight_normal: 1e300", "learning_rate_m: 0", "edge_tolerance: 2", "edge_iterations: true", "edge_iterations: ²",
)  # fmt: skip
SIMULATIONS = (
    "clips: [{motion: walk, seconds: 1e300}]", "clips: [{motion: walk, seconds: .inf}]",
    "clips: [{motion: walk, seconds: 100000000}]", "clips: [{motion: walk, seconds: 1e-30}]",
    "clips: [{motion: walk, seed: 0, last_seed: 1000000000}]", "clips: [{motion: fly}]", "clips: 3", "clips: [3]",
    "clips: [{motion: walk, tempo: 1e300}]", "clips: [{motion: walk, tempo: 1e-300}]", "clips: []", "fps: .inf",
    "fps: 1e300", "fps: 1e-300", "garment: {kind: cape}", "garment: {edge_length: 1e-9}", "garment: {edge_length: 1e9}",
    "garment: {path: /dev/zero}", "garments: []", "solver: {min_substeps: 9999999999, max_substeps: 9999999999}",
    "solver: {settle_seconds: 1e300}", "cloth: {density: 1e300}", "cloth: {fabric: lead}", "body: {kind: robot}",
    "clips: [{motion: walk, seed: 99999999999999999999999999}]", "clips: [{motion: walk, garments: [cape]}]",
    "files: {arms_out: .nan}", "sequences: {scale: 0}", "bodies: 3", "gates: {speed: -1}",
)  # fmt: skip


def _config(name: str, number: int, text: str) -> Case:
    lines = {
        "fuse": ("fuse --maps maps.npz --config fusion.yaml --out out", "fusion.yaml"),
        "simulate": ("simulate simulation.yaml --clip none/none --out out", "simulation.yaml"),
    }
    argv, file = lines[name]
    key = text.split(":", maxsplit=1)[0]
    if name == "simulate" and key != "clips":
        text += "\nclips: [{motion: walk, seconds: 0.2}]"

    def write(path: Path, _: random.Random) -> object:
        return path.write_text(text + "\n")

    named = (file, "none/none", key, "seconds")
    return Case(
        f"{name}-setting-{number}",
        tuple(argv.split()),
        (file,),
        named=named,
        harmless=True,
        file=file,
        spoil=write,
    )


def setting_cases() -> list[Case]:
    """All of them."""
    found = []
    for number, setting in enumerate(SETTINGS):
        key = setting.split("=", maxsplit=1)[0]
        argv = ("train", "run.yaml", "--out", "out", "--set", setting)
        named = (key or "--set", key.split(".")[-1] or "--set", "--set", "/dev/zero")
        found.append(Case(f"train-setting-{number}", argv, ("set",), named=named))
    found += [_config("fuse", number, text) for number, text in enumerate(FUSION)]
    return found + [_config("simulate", number, text) for number, text in enumerate(SIMULATIONS)]
