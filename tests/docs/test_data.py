"""docs/data.md says what is: its recipe, its commands, its Python."""

import re
import shlex

import pytest
import yaml

from imgtransfer.cli.main import build_parser
from imgtransfer.motions.kinds import KINDS
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.planning.plan import plan
from tests.helpers.paths import ROOT

PAGE = (ROOT / "docs" / "data.md").read_text()
COMMANDS = re.findall(r"^    (imgtransfer .*)$", PAGE, re.MULTILINE)


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_the_recipe_can_be_simulated():
    recipe, drawn = blocks("yaml")
    tasks = plan(SimulateConfig.model_validate(yaml.safe_load(recipe)))
    assert len(tasks) == 2 * 8 + 1  # eight runs in both garments, one kick in the skirt
    assert len({task.config.body for task in tasks}) == 3
    config = SimulateConfig.model_validate(yaml.safe_load(drawn))
    assert [garment.title for garment in config.wardrobe()][-1] == "tshirt-12"
    assert len(config.wearers()) == 25


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_commands(command):
    build_parser().parse_args(shlex.split(command, comments=True)[1:])


def test_every_motion_of_the_library_is_named():
    assert {kind for kind in KINDS if f"`{kind}`" not in PAGE} == set()


def test_the_python_runs(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (program,) = blocks("python")
    exec(compile(program, "docs/data.md", "exec"), {})
    assert "(10, 1703, 3)" in capsys.readouterr().out
