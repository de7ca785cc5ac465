"""The virtual bones of a garment, decomposed from the training clips once, and kept in the fit's folder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from imgtransfer.config.schema import Section
from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.common.bone_skinning import BoneSkinning, bones_about
from imgtransfer.deformers.common.carriers import Carried, carriers
from imgtransfer.deformers.common.descent_config import Frames
from imgtransfer.deformers.common.rigid_bones import first_bones, refine_bones
from imgtransfer.deformers.common.sequence import FitClips, Given
from imgtransfer.deformers.common.ssdr import decompose
from imgtransfer.training.checkpoint import FORMAT_VERSION, read_tensors, write_tensors
from render import InputError, Option, one_blas_thread

_FORMAT, _FILE = "imgtransfer-virtual-bones", "bones.safetensors"
_NAMES = ("weights", "turn", "offset", "carrier_turn", "carrier_offset")
_SWEEPS = 4  # over the bones of each clip, with the weights as they are


class RigConfig(Section):
    """The decomposition of the training clips into virtual bones (section 3.1 of JointNet; SSDR, Le and Deng 2012)."""

    bones: int = Field(
        80, ge=1, le=2000, description="Virtual bones, |V|; fewer for a template of fewer vertices."
    )
    influences: int = Field(4, ge=1, le=8, description="Bones that move a vertex, at most.")
    follow: Literal["root", "body"] = Field(
        "root",
        description="What networks predict the bones' motion against: the body's root (the papers), or the part of the "
        "body's surface that is nearest to a bone at rest, which few training clips teach more of.",
    )
    frames: Frames = Field(
        400, ge=2, le=10**6, description="Frames, spread evenly over the clips, that weights are solved from."
    )
    clustering_rounds: int = Field(
        10, ge=0, le=1000, description="Rounds of the clustering that it begins with."
    )
    rounds: int = Field(15, ge=0, le=1000, description="Rounds of weights and bones in turns.")


@dataclass(frozen=True, eq=False)
class Rig:
    """Virtual bones in the motion of the training clips.

    Args:
        weights: W, (N, V) float32.
        turn: (S, V, 3, 3) float32, offset: (S, V, 3) float32, metres; of all frames against the carriers, see
            `BoneSkinning`.
        carried: by what, in all frames.
    """

    weights: Tensor
    turn: Tensor
    offset: Tensor
    carried: Carried

    def skinning(self) -> BoneSkinning:
        """The skinning by these bones, which knows how they move on average."""
        skinning = BoneSkinning(self.weights)
        skinning.standardise(self.turn, self.offset)
        return skinning


def virtual_rig(clips: FitClips, config: RigConfig, folder: FitFolder) -> Rig:
    """Decompose clips, or read what was decomposed here before.

    Clips of other bodies' templates are moved by the difference to the first one before the weights are solved for.

    Raises:
        InputError: a file in the folder that is damaged, or of other settings or clips.
    """
    path = folder.path / _FILE
    settings = config.model_dump(mode="json")
    if path.exists():
        tensors, header = read_tensors(path, _FORMAT)
        same = header.get("rig") == settings and set(_NAMES) <= tensors.keys()
        shape = (len(clips.root), clips.positions.shape[1])
        if not same or (len(tensors["turn"]), len(tensors["weights"])) != shape:
            raise InputError(
                f"{path}: of other clips or settings than this run's; choose another {Option('out')} for a new run"
            )
        weights, turn, offset, *carried = (tensors[name] for name in _NAMES)
        return Rig(weights, turn, offset, Carried(*carried))
    rig = _decompose(clips, config)
    parts = (rig.weights, rig.turn, rig.offset, rig.carried.turn, rig.carried.offset)
    tensors = dict(zip(_NAMES, parts, strict=True))
    write_tensors(path, tensors, {"format": _FORMAT, "format_version": FORMAT_VERSION, "rig": settings})
    return rig


@one_blas_thread()
def _decompose(clips: FitClips, config: RigConfig) -> Rig:
    count = len(clips.root)
    chosen = np.unique(np.linspace(0, count - 1, min(count, config.frames)).round().astype(np.int64))
    reference = clips.templates[0]
    moved = clips.positions[chosen] + reference - clips.templates[clips.clip_of[chosen]]
    found = decompose(
        reference.numpy(),
        moved.numpy(),
        bones=config.bones,
        influences=config.influences,
        clustering_rounds=config.clustering_rounds,
        rounds=config.rounds,
    )
    weights = found.weights.astype(np.float32)
    exact = weights.astype(np.float64)
    skinning = BoneSkinning(torch.from_numpy(weights)).double()
    parts, carried = [], []
    for number, positions in enumerate(clips.positions.split(list(clips.lengths))):
        rest = clips.templates[number].double()
        moves = np.ascontiguousarray(positions.numpy().swapaxes(0, 1), np.float64)
        bones = first_bones(rest.numpy(), moves, exact)
        for _ in range(_SWEEPS):
            bones = refine_bones(rest.numpy(), moves, exact, bones)
        places = skinning.places(rest)
        carried.append(carried_by(config, clips.given[number], places.float()))
        parts.append(carried[-1].without(*bones_about(bones, places.numpy())))
    turn, offset = (torch.cat([part[number] for part in parts]) for number in range(2))
    return Rig(torch.from_numpy(weights), turn, offset, Carried.cat(carried))


def carried_by(config: RigConfig, given: Given, places: Tensor) -> Carried:
    """What carries bones that rest at places (V, 3), in the frames of a clip."""
    if config.follow == "body":
        return carriers(given.body_rest, given.body(), places.numpy())
    return Carried.nothing(len(given.root), len(places))
