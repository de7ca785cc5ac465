"""docs/fusion.md says what is: its commands, its Python, its tables."""

import re
import shlex

import pytest

from fusion import FusionConfig
from imgtransfer.cli.main import build_parser
from scripts.examples import fuse_foreign_maps
from tests.helpers.paths import ROOT

PAGE = (ROOT / "docs" / "fusion.md").read_text()


def table_after(mark):
    """Rows of the table that follows a comment, as lists of cells; without its head."""
    lines = PAGE.split(f"<!-- {mark} -->\n", 1)[1].splitlines()
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows[2:]


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def config_rows():
    """What the table of hyper-parameters must hold."""
    return [
        [f"`{name}`", str(field.default), field.description]
        for name, field in FusionConfig.model_fields.items()
    ]


def test_every_hyper_parameter_is_there_with_its_default_and_unit():
    rows = "\n".join(f"| {' | '.join(row)} |" for row in config_rows())
    assert table_after("config") == config_rows(), f"the table in docs/fusion.md must be\n{rows}"


def test_every_option_is_explained():
    parser = build_parser()._subparsers._group_actions[0].choices["fuse"]
    options = {text for action in parser._actions for text in action.option_strings if text.startswith("--")}
    assert {option for option in options - {"--help"} if f"`{option}" not in PAGE} == set()


@pytest.mark.parametrize("block", blocks("bash"))
def test_commands_are_commands(block):
    for line in block.replace("\\\n", " ").splitlines():
        words = shlex.split(line)
        if words[0] == "imgtransfer":
            build_parser().parse_args(words[1:])
        else:
            assert (ROOT / words[1]).is_file()


def test_the_example_and_the_python_run_on_small_maps(tmp_path, monkeypatch, capsys):
    found = fuse_foreign_maps.example(tmp_path, quick=True)
    assert list(found) == list(fuse_foreign_maps.RUNS)
    assert found["+ --body"][2] == found["+ --config"][2] == 0  # none inside
    assert found["+ --config"][0] < found["as they come"][0]
    assert (tmp_path / "example.png").stat().st_size > 10_000
    capsys.readouterr()
    monkeypatch.chdir(tmp_path)
    for block in blocks("python"):
        exec(compile(block, "docs/fusion.md", "exec"), {})
    assert "(1, 1829, 3)" in capsys.readouterr().out


@pytest.mark.long
def test_the_example_gives_the_numbers_of_the_page(tmp_path):
    found = fuse_foreign_maps.example(tmp_path, quick=False)
    written = {row[0]: [float(cell) for cell in row[1:]] for row in table_after("example")}
    assert list(found) == list(written)
    for name, values in found.items():
        assert values == pytest.approx(written[name], rel=0.1, abs=0.3), name
