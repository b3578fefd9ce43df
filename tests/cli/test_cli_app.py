"""The front door: help, options, errors and exit codes."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from running import Outcome

from mvtn_cli import __version__
from mvtn_cli.app import COMMANDS, load_command
from mvtn_cli.commands.options import Call
from mvtn_cli.errors import DataError, ExitCode, Interrupted, MvtnError

Mvtn = Callable[..., Outcome]
FakeCommand = Callable[[Callable[[Any, Call], Any]], None]

FROZEN = Path(__file__).with_name("options.json")
HEAVY = (
    "torch",
    "torchvision",
    "numpy",
    "numba",
    "trimesh",
    "sklearn",
    "scipy",
    "matplotlib",
    "mvtn_cli.core",
)


def all_options() -> dict[str, list[str]]:
    """Every name that a command line may contain, by command."""
    found = {}
    for name in COMMANDS:
        params = load_command(name).params
        found[name] = sorted(option for param in params for option in (*param.opts, *param.secondary_opts))
    return found


def python(*words: str, **more: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=60, **more)


def help_and_modules(*words: str) -> tuple[str, list[str]]:
    """What `mvtn WORDS` prints, and the modules that it imports."""
    script = "import sys, mvtn_cli.app as a; a.app(sys.argv[1:], standalone_mode=False); print(*sys.modules)"
    text, _, modules = python("-c", script, *words).stdout.rstrip().rpartition("\n")
    return text, modules.split()


def test_the_set_of_options_is_frozen():
    """Names are promises: options are added, never silently changed or dropped.

    After an intended change: FREEZE_OPTIONS=1 python -m pytest tests/cli -k frozen
    """
    if os.environ.get("FREEZE_OPTIONS"):
        FROZEN.write_text(json.dumps(all_options(), indent=2) + "\n")
    assert all_options() == json.loads(FROZEN.read_text())


def test_help_imports_nothing_heavy_and_names_every_command():
    help_text, loaded = help_and_modules("--help")
    assert "mvtn_cli.app" in loaded  # the check sees something
    assert not [name for name in loaded if name.startswith((*HEAVY, "pydantic", "mvtn_cli.commands"))]
    assert all(command in help_text for command in COMMANDS)


def test_the_help_of_a_command_imports_nothing_heavy():
    _, loaded = help_and_modules("train", "--help")
    assert "mvtn_cli.commands.train" in loaded
    assert not [name for name in loaded if name.startswith(HEAVY)]


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_each_command_has_an_example_and_every_option(command: str, mvtn: Mvtn):
    result = mvtn(command, "--help")
    assert result.code == 0
    assert f"Example: mvtn {command}" in result.out or f"| mvtn {command}" in result.out
    for param in load_command(command).params:
        if not param.hidden and param.opts[0].startswith("--"):
            assert param.opts[0] in result.out, param.opts[0]


def test_help_on_a_narrow_terminal_cuts_no_option_short():
    environment = {**os.environ, "COLUMNS": "40"}
    result = python("-m", "mvtn_cli", "train", "--help", env=environment)
    assert result.returncode == 0
    assert max(map(len, result.stdout.splitlines())) <= 50
    assert "--allow-no-gradient" in result.stdout and "--backbone-lr-scale" in result.stdout


def test_a_bare_mvtn_shows_help(mvtn: Mvtn):
    assert mvtn().out == mvtn("--help").out != ""


def test_the_version_is_an_answer(mvtn: Mvtn):
    result = mvtn("--version")
    assert (result.code, result.out, result.err) == (0, f"mvtn {__version__}\n", "")


@pytest.mark.parametrize(
    ("words", "message", "hint"),
    [
        (["trian"], "unknown command 'trian'; did you mean 'train'?", "see mvtn --help"),
        (["qqqq"], "unknown command 'qqqq'", "see mvtn --help"),
        (
            ["train", "--epoch", "3"],
            "unknown option '--epoch'; did you mean '--epochs'?",
            "see mvtn train --help",
        ),
        (["train", "--epochs"], "option '--epochs' requires an argument", "see mvtn train --help"),
        (["eval", "a", "b"], "got unexpected extra argument(s) (b)", "see mvtn eval --help"),
        (["cache", "cler"], "unknown action 'cler'; did you mean 'clear'?", "action is one of: show, clear"),
        (["train", "--epochs", "0"], "--epochs must be at least 1, got 0", ""),
        (
            ["cache", "--json", "--jsonl"],
            "--json and --jsonl exclude each other",
            "--jsonl gives one object a line",
        ),
        (["--qqqq"], "unknown option '--qqqq'", "see mvtn --help"),
    ],
)
def test_wrong_use_exits_with_2_and_names_the_right_word(words: list[str], message: str, hint: str, mvtn: Mvtn):
    result = mvtn(*words)
    assert result.code == ExitCode.USAGE
    assert result.out == ""
    assert result.err.splitlines()[0] == f"error: {message}"
    assert not hint or f"  {hint}" in result.err.splitlines()


@pytest.mark.parametrize("words", [["trian", "--json"], ["cache", "--epochs", "--json"], ["cache", "cler", "--jsonl"]])
def test_with_json_the_last_line_on_stderr_is_the_error_for_machines(words: list[str], mvtn: Mvtn):
    result = mvtn(*words)
    assert result.out == ""
    assert set(result.error) == {"type", "code", "exit", "message", "hint"}
    assert result.error["type"] == "error" and result.error["exit"] == result.code == 2
    assert result.err.startswith(f"error: {result.error['message']}\n")


def raising(error: BaseException) -> Callable[[Any, Call], None]:
    def work(config: Any, call: Call) -> None:
        raise error

    return work


def test_exit_code_0_is_for_work_that_is_done(mvtn: Mvtn, fake_command: FakeCommand):
    fake_command(lambda config, call: call.console.result({"x": 1}, "answer"))
    assert mvtn("cache") == Outcome(ExitCode.OK, "answer\n", "")


def test_exit_code_1_is_for_work_that_failed(mvtn: Mvtn, fake_command: FakeCommand):
    fake_command(raising(DataError("no meshes in a", hint="look in b", code="dataset.empty")))
    result = mvtn("cache", "--json")
    assert result.code == ExitCode.FAILED
    assert result.err.startswith("error: no meshes in a\n  look in b\n")
    assert result.error == {
        "type": "error", "code": "dataset.empty", "exit": 1, "message": "no meshes in a", "hint": "look in b",
    }  # fmt: skip


@pytest.mark.parametrize("error", [KeyboardInterrupt(), Interrupted("stopped at step 3", hint="mvtn train")])
def test_exit_code_130_is_for_an_interruption_and_says_how_to_go_on(
    error: BaseException, mvtn: Mvtn, fake_command: FakeCommand
):
    fake_command(raising(error))
    result = mvtn("cache", "--json")
    assert result.code == result.error["exit"] == ExitCode.INTERRUPTED
    assert result.error["hint"]


def test_a_bug_is_one_line_and_a_traceback_only_with_debug(mvtn: Mvtn, fake_command: FakeCommand):
    fake_command(raising(ValueError("two\nlines")))
    result = mvtn("cache")
    assert result.code == ExitCode.FAILED
    assert result.err == "error: internal error: ValueError: two lines\n  run again with --debug\n"
    assert "Traceback" in mvtn("cache", "--debug").err


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (PermissionError(errno.EACCES, "Permission denied", "/root/x"), "/root/x: Permission denied"),
        (NotADirectoryError(errno.ENOTDIR, "Not a directory", "file/run"), "file/run: Not a directory"),
        (FileExistsError(errno.EEXIST, "File exists", "runs"), "runs: File exists"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "xxx"), "xxx: File name too long"),
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device"),
        (RuntimeError("CUDA out of memory. Tried to allocate"), "out of memory"),
        (
            RuntimeError("[enforce fail at alloc_cpu.cpp:127] DefaultCPUAllocator: can't allocate memory"),
            "out of memory",
        ),
        (MemoryError(), "out of memory"),
    ],
)
def test_what_the_machine_refuses_is_no_bug(error: Exception, words: str, mvtn: Mvtn, fake_command: FakeCommand):
    fake_command(raising(error))
    result = mvtn("cache")
    assert words in result.err and "internal" not in result.err
    assert result.code == 1 and len(result.err.splitlines()) == 2


def test_errors_stay_outside_stdout_and_survive_quiet(mvtn: Mvtn, fake_command: FakeCommand):
    fake_command(raising(MvtnError("it broke")))
    result = mvtn("cache", "-q")
    assert (result.out, result.err) == ("", "error: it broke\n")


def test_a_command_gets_what_the_command_line_says(mvtn: Mvtn, fake_command: FakeCommand):
    calls: list[tuple[Any, Call]] = []
    fake_command(lambda config, call: calls.append((config, call)))
    mvtn("cache", "clear", "--yes", "--quiet", "--jsonl", "--cache", "there")
    mvtn("cache", "--yes", "--no-yes")
    (config, call), (second, _) = calls
    assert (config.action, config.yes, config.cache) == ("clear", True, Path("there"))
    assert (call.command, call.console.mode, call.console.quiet, call.dry_run) == (
        "cache",
        "jsonl",
        True,
        False,
    )
    assert second.yes is False


def test_a_closed_pipe_ends_a_command_quietly():
    reader, writer = os.pipe()
    os.close(reader)
    result = subprocess.run(
        [sys.executable, "-m", "mvtn_cli", "cache", "-q"], stdout=writer, stderr=subprocess.PIPE, timeout=60
    )
    os.close(writer)
    assert (result.returncode, result.stderr) == (0, b"")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_polite_kill_is_treated_like_ctrl_c(number: signal.Signals):
    script = """
import time, mvtn_cli.app as app, mvtn_cli.commands.cache as command
def work(config, call):
    call.console.note("ready")
    time.sleep(50)
command.cache = work
app.main()
"""
    process = subprocess.Popen(
        [sys.executable, "-c", script, "cache"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "ready\n"
    process.send_signal(number)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert err == "error: interrupted\n  the same command goes on where it stopped\n"


def test_completion_knows_commands_options_choices_presets_and_runs(own_folder: Path):
    for name in ("one", "two", "group/three"):
        (own_folder / "runs" / name).mkdir(parents=True)
        (own_folder / "runs" / name / "run.json").touch()
    (own_folder / "runs" / "other").mkdir()

    def complete(words: str) -> set[str]:
        environment = {
            **os.environ,
            "_MVTN_COMPLETE": "complete_bash",
            "COMP_WORDS": words,
            "COMP_CWORD": str(len(words.split(" ")) - 1),
        }
        return set(python("-m", "mvtn_cli", env=environment).stdout.split())

    assert complete("mvtn tr") == {"train"}
    assert complete("mvtn train --layout s") == {"spherical"}
    assert complete("mvtn cache cl") == {"clear"}
    assert "modelnet40-dgcnn" in complete("mvtn train --preset modelnet40-d")
    assert complete("mvtn presets scanobjectnn-hardest-d") == {"scanobjectnn-hardest-dgcnn"}
    assert complete("mvtn eval o") == {"one"}
    assert complete("mvtn report one g") == {"group/three"}
    assert complete("mvtn predict --run runs/t") == {"runs/two"}
