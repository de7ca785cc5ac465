"""Simulations of seconds."""

from imgtransfer.simulation.config import SimulateConfig, SolverConfig


def short(**changes):
    solver = SolverConfig(
        min_substeps=3, max_substeps=3, iterations=2, settle_seconds=0.1, warm_up_seconds=0.1
    )
    return SimulateConfig(garment={"edge_length": 0.05}, solver=solver, **changes)
