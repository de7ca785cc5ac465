"""One clip to simulate: what it is made of, what it is called, and a fingerprint of it all."""

from __future__ import annotations

from dataclasses import dataclass

from imgtransfer.garments.config import TemplateConfig, garment_fingerprint
from imgtransfer.motions.motion import Motion
from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.simulation.body_motion.body_sequence import BodySequence
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.motion_config import Split
from imgtransfer.simulation.run import simulated_clip_name


@dataclass(frozen=True, eq=False)
class Task:
    """One clip to simulate: a motion of the configuration's body, or a body mesh sequence.

    Args:
        config: of one garment and one body.
        drawn: whether the garment was drawn at random: one that cannot be made is then left out, as a rejected clip.
    """

    motion: Motion | BodySequence
    split: Split
    config: SimulateConfig
    drawn: bool = False

    @property
    def name(self) -> str:
        """Its name in the data set."""
        return simulated_clip_name(self.config, self.motion)

    def fingerprint(self) -> str:
        """A text that changes with whatever decides how the clip comes out; files count by what they hold."""
        motion, config = self.motion, self.config
        left_out = {"clips", "files", "sequences", "title", "licence", "source", "every_garment"}
        if isinstance(motion, BodySequence):
            left_out.add("body")
            settings = motion.settings.model_dump_json(exclude={"body_rest", "speed"})
            content = [settings.encode(), motion.content.encode(), str(motion.frames).encode()]
        else:
            content = [motion.poses.tobytes(), motion.trans.tobytes(), str(motion.fps).encode()]
        # A made garment's name is the clip's, and decides nothing else.
        of_garment = "path" if isinstance(config.garment, TemplateConfig) else "name"
        excluded = dict.fromkeys(left_out, True) | {"garment": {of_garment}}
        settings = config.model_dump_json(exclude=excluded)
        if garment := garment_fingerprint(config.garment):
            content.append(garment.encode())
        return fingerprint([settings, *content])
