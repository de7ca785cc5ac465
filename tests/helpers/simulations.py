"""Simulations of seconds."""

from imgtransfer.simulation.config import GateConfig, SimulateConfig, SolverConfig


def short(**changes):
    solver = SolverConfig(
        min_substeps=3, max_substeps=3, iterations=2, settle_seconds=0.1, warm_up_seconds=0.1
    )
    # Edges of 5 cm cut through knees and elbows, whatever the solver does.
    gates = {"gates": GateConfig(crossing_percent=10)} | changes
    return SimulateConfig(garment={"edge_length": 0.05}, solver=solver, **gates)
