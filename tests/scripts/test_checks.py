"""The checks at a commit are those of scripts/test."""

from __future__ import annotations

import yaml

from tests.helpers.paths import ROOT


def test_the_hooks_run_what_the_test_script_checks() -> None:
    script = (ROOT / "scripts" / "test").read_text(encoding="utf-8")
    checks = script.partition('say "Style and types"')[2].partition("\n# ")[0]
    commands = [line.partition(" || ")[0] for line in checks.strip().splitlines()]
    assert [command.split()[0] for command in commands] == [
        ".venv/bin/ruff",
        ".venv/bin/ruff",
        ".venv/bin/mypy",
        ".venv/bin/lint-imports",
    ]
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    hooks = [hook for repository in config["repos"] for hook in repository["hooks"]]
    assert [hook["entry"] for hook in hooks] == commands
    for hook in hooks:
        assert hook["language"] == "system"
        assert hook["pass_filenames"] is False
