"""docs/cli.md says what the command line does."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from mvtn_cli.app import COMMANDS, load_command
from mvtn_cli.errors import ExitCode

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "cli.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```\n(.*?)```", TEXT, re.DOTALL)
EXAMPLES = [line for block in BLOCKS for line in block.splitlines() if re.search(r"(^|[$|] *)mvtn ", line)]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_a_section_with_an_example(command: str):
    section = re.search(rf"### `mvtn {command}[ `].*?(?=\n### |\Z)", TEXT, re.DOTALL)
    assert section, command
    assert re.search(rf"```\n.*mvtn {command}\b.*```", section[0], re.DOTALL)


def test_no_other_command_is_described():
    assert set(re.findall(r"### `mvtn ([\w-]+)", TEXT)) == set(COMMANDS)


@pytest.mark.parametrize("code", ExitCode)
def test_every_exit_code_is_in_the_table(code: ExitCode):
    assert re.search(rf"^\| {code.value} \| {code.name} \|", TEXT, re.MULTILINE)


def test_the_table_has_no_other_exit_codes():
    assert len(re.findall(r"^\| \d+ \|", TEXT, re.MULTILINE)) == len(ExitCode)


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_uses_options_that_there_are(example: str):
    for part in re.findall(r"(?<!\w)mvtn ([^|&]+)", example):
        command, *words = shlex.split(part.replace(">", " "))
        assert command in COMMANDS
        known = {option for param in load_command(command).params for option in (*param.opts, *param.secondary_opts)}
        assert {word for word in words if word.startswith("-") and word != "-"} <= known


def test_every_option_that_is_mentioned_exists():
    known = {"--install-completion", "--help", "--no-"}
    for command in COMMANDS:
        known |= {option for param in load_command(command).params for option in (*param.opts, *param.secondary_opts)}
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", TEXT)) <= known
