"""One clip's task: its name in the data set, and what its fingerprint hangs on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from imgtransfer.bodies.config import AnnyConfig
from imgtransfer.garments.config import TemplateConfig
from imgtransfer.motions.library import make_motion
from imgtransfer.simulation.config import SimulateConfig, SolverConfig
from imgtransfer.simulation.planning.task import Task

MOTION = make_motion("walk", seed=1, seconds=0.2)


def task(**changes: object) -> Task:
    return Task(MOTION, "train", SimulateConfig.model_validate(changes))


def test_a_clip_is_named_after_garment_motion_and_body() -> None:
    assert task().name == "tshirt/walk_s1"
    assert task(body=AnnyConfig(seed=4)).name == "tshirt/walk_s1_anny4"


def test_what_only_says_something_about_a_data_set_does_not_count() -> None:
    told = task(title="Walks", licence="CC-BY-4.0", source="here", clips=({"motion": "run"},))
    assert told.fingerprint() == task().fingerprint()
    assert replace(task(), split="test").fingerprint() == task().fingerprint()
    assert task(garment={"name": "vest"}).fingerprint() == task().fingerprint()


def test_motion_body_garment_cloth_and_solver_count() -> None:
    moved = replace(task(), motion=make_motion("walk", seed=2, seconds=0.2))
    tasks = [
        task(),
        moved,
        task(body=AnnyConfig(seed=4)),
        task(garment={"kind": "skirt"}),
        task(cloth={"fabric": "silk"}),
        task(solver=SolverConfig(iterations=5)),
    ]
    assert len({each.fingerprint() for each in tasks}) == len(tasks)


def test_a_garment_s_file_counts_by_what_it_holds(tmp_path: Path) -> None:
    one, same, other = (tmp_path / f"{name}.obj" for name in ("one", "same", "other"))
    for path, text in ((one, "v 0 0 0"), (same, "v 0 0 0"), (other, "v 1 0 0")):
        path.write_text(text)
    prints = [
        task(garment=TemplateConfig(path=path, name="vest")).fingerprint() for path in (one, same, other)
    ]
    assert prints[0] == prints[1] != prints[2]
