"""One clip to simulate."""

from __future__ import annotations

from dataclasses import dataclass

from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.body_motion.body_sequence import MeshSequence
from imgtransfer.simulation.config import SimulateConfig, Split
from imgtransfer.simulation.run import clip_name


@dataclass(frozen=True, eq=False)
class Task:
    """One clip to simulate: a motion of the configuration's body, or a body mesh sequence."""

    motion: Motion | MeshSequence
    split: Split
    config: SimulateConfig

    @property
    def name(self) -> str:
        """Its name in the data set."""
        return clip_name(self.config, self.motion)
