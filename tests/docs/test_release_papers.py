"""What a release and its users go by: the citation, templates of issues, pinned packages, and what the sdist holds."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.helpers.paths import ROOT

PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]


def canonical(requirement: str) -> str:
    """A package's name as indexes compare it."""
    name = re.match(r"[\w.-]+", requirement)
    assert name is not None, requirement
    return re.sub(r"[-_.]+", "-", name.group()).lower()


def pins() -> dict[str, str]:
    lines = [
        line for line in (ROOT / "constraints.txt").read_text().splitlines() if line[:1] not in ("#", "")
    ]
    assert all(re.fullmatch(r"[\w.-]+==\S+", line) for line in lines)
    found = {canonical(line): line.partition("==")[2] for line in lines}
    assert len(found) == len(lines)  # each once
    return found


# pinned packages


@pytest.mark.parametrize("extra", ["", *EXTRAS])
def test_every_package_of_an_extra_is_pinned(extra: str) -> None:
    needed = EXTRAS[extra] if extra else PROJECT["dependencies"]
    assert not {canonical(one) for one in needed} - set(pins())


@pytest.mark.long
@pytest.mark.parametrize("extra", [""] + [name for name in EXTRAS if name != "dev"])
def test_an_extra_resolves_to_the_pinned_versions(extra: str, tmp_path: Path) -> None:
    """Against the index of this machine, with nothing installed; torch's build is the index's own affair."""
    pip = [sys.executable, "-m", "pip"]
    if subprocess.run([*pip, "--version"], capture_output=True, check=False).returncode != 0:
        python = shutil.which("python3")
        assert python is not None
        pip = [python, "-m", "pip"]
    needed = EXTRAS[extra] if extra else PROJECT["dependencies"]
    options = ["--dry-run", "--ignore-installed", "--quiet", "--constraint", str(ROOT / "constraints.txt")]
    done = subprocess.run(
        [*pip, "install", *options, *needed], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]


# what is there


def test_the_citation_is_complete_and_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    # Required by version 1.2.0 of the format: these four; `type` is one of two words, an author has a name.
    assert cited["cff-version"] == "1.2.0"
    assert cited["message"]
    assert cited["title"]
    assert cited["authors"]
    assert all(set(author) & {"name", "family-names"} for author in cited["authors"])
    assert cited["type"] == "software"
    known = {
        "cff-version",
        "message",
        "type",
        "title",
        "abstract",
        "authors",
        "version",
        "license",
        "keywords",
    }
    assert set(cited) <= known | {"date-released", "repository-code", "url", "doi", "preferred-citation"}
    assert (cited["version"], cited["license"]) == (PROJECT["version"], PROJECT["license"])


@pytest.mark.parametrize("name", ["bug", "feature"])
def test_a_template_of_issues_has_what_forms_need(name: str) -> None:
    form = yaml.safe_load((ROOT / f".github/ISSUE_TEMPLATE/{name}.yml").read_text())
    assert form["name"]
    assert form["description"]
    kinds = {"markdown", "textarea", "input", "dropdown", "checkboxes"}
    assert all(part["type"] in kinds for part in form["body"])
    asked = [part for part in form["body"] if part["type"] != "markdown"]
    assert len({part["id"] for part in asked}) == len(asked) >= 2
    assert all(part["attributes"]["label"] for part in asked)
    if name == "bug":
        assert "`imgtransfer doctor --report`" in str(form)


@pytest.mark.long
def test_the_source_distribution_holds_what_a_clone_does(tmp_path: Path) -> None:
    """Built from the files that git knows, so that nothing that lies about gets in."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout
    files = [Path(name) for name in listed.decode().split("\0") if name]
    clone = tmp_path / "clone"
    for file in files:
        if (ROOT / file).is_file():
            (clone / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / file, clone / file)
    command = [
        sys.executable,
        "-m",
        "build",
        "--sdist",
        "--no-isolation",
        "--outdir",
        str(tmp_path / "dist"),
        str(clone),
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    (archive,) = (tmp_path / "dist").iterdir()
    with tarfile.open(archive) as opened:
        held = {str(Path(name).relative_to(Path(name).parts[0])) for name in opened.getnames()}
    folders = {"imgtransfer", "render", "fusion", "configs", "docs", "scripts", "tests"}
    wanted = {str(file) for file in files if file.parts[0] in folders and (clone / file).is_file()}
    papers = {"README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "constraints.txt"}
    assert not (wanted | papers) - held
    assert not {name for name in held if "__pycache__" in name or name.endswith(".pyc")}
