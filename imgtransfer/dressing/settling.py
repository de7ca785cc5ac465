"""A garment that does not ship, cut for its body and left to hang there, as every simulation begins."""

from __future__ import annotations

import numpy as np

from imgtransfer.data.grid import round_to_grid
from imgtransfer.garments.config import garment_fingerprint
from imgtransfer.simulation.body_motion.dressed_body import settled
from imgtransfer.simulation.body_motion.skinned import dressed_body
from imgtransfer.simulation.config import SimulateConfig, SolverConfig
from render.mesh.mesh import Mesh

#: As the general checkpoint's garments hang: cloth that collides with itself.
SOLVER = SolverConfig(self_contact=True)


def settled_garment(config: SimulateConfig) -> tuple[Mesh, np.ndarray]:
    """The configuration's garment as it is put on its resting body, and (N, 3) float32 how it hangs there.

    Raises:
        InputError: the extra `simulate` is not installed, or the garment cannot be made on the body.
    """
    dressed = dressed_body(config.body, config.garment, garment_fingerprint(config.garment))[0]
    hangs = settled(dressed, config.cloth, config.solver, config.fps)
    return dressed.garment.mesh, round_to_grid(hangs)
