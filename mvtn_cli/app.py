"""The front door: which commands there are, and how each error leaves the house.

Commands are loaded when they are called: `mvtn --help` must not wait for pydantic, numpy or torch.
"""

from __future__ import annotations

import contextlib
import errno
import json
import re
import signal
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from mvtn_cli import __version__
from mvtn_cli.console import help_style
from mvtn_cli.errors import ExitCode, MvtnError, UsageError, nearest


class Door(NamedTuple):
    """A command that has not been loaded."""

    function: str  # in the module of the same name
    panel: str
    summary: str


COMMANDS = {
    "preprocess": Door("preprocess", "Train", "Read, repair and store a data set's shapes."),
    "train": Door("train", "Train", "Train a multi-view classifier, with cameras that it learns to place."),
    "sweep": Door("sweep", "Train", "Train with several settings each, into one table and plot."),
    "presets": Door("presets", "Train", "List the paper's settings, row by row, with its figures."),
    "eval": Door("evaluate", "Use", "Measure a trained classifier and write its report."),
    "report": Door("report", "Use", "Write the report of a run again, or compare several."),
    "robustness": Door("robustness", "Use", "Measure runs on shapes that are turned, cut or noisy."),
    "render-views": Door("render_views", "Use", "Draw what cameras see of shapes, and write the cameras down."),
    "retrieve": Door("retrieve", "Use", "Find shapes that are alike, and measure how well that works."),
    "predict": Door("predict", "Use", "Name the class of each file."),
    "export": Door("export", "Use", "Write a run as ONNX, weights and a model card."),
    "bench": Door("bench", "Look after", "Measure the renderer: error against run time."),
    "cache": Door("cache", "Look after", "Show or clear the stored shapes."),
    "doctor": Door("doctor", "Look after", "Say what this machine can do, or what is wrong with a data set."),
}


MACHINE_ERRORS = {  # what an operating system refuses that is nobody's bug
    errno.ENOSPC: "make room: mvtn cache clear, or another --cache or --runs",
    errno.EDQUOT: "make room: mvtn cache clear, or another --cache or --runs",
    errno.EACCES: "give a folder of your own: --cache, --runs or --out",
    errno.EPERM: "give a folder of your own: --cache, --runs or --out",
    errno.ENOTDIR: "a file is in the way: give another folder with --cache, --runs or --out",
    errno.EEXIST: "a file is in the way: give another folder with --cache, --runs or --out",
    errno.ENAMETOOLONG: "give a shorter name or folder: --name, --cache, --runs or --out",
    errno.EROFS: "give a folder that can be written: --cache, --runs or --out",
}


def load_command(name: str) -> Any:
    """Import a command and build its options."""
    from mvtn_cli.commands.options import build_command

    module = import_module(f"mvtn_cli.commands.{name.replace('-', '_')}")
    return build_command(name, getattr(module, COMMANDS[name].function))


class LazyGroup(TyperGroup):
    """Lists commands by name and summary, and loads the one that is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        door = COMMANDS.get(cmd_name)
        return door and TyperCommand(cmd_name, help=door.summary, rich_help_panel=door.panel)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args[0] not in COMMANDS and not args[0].startswith("-") and not ctx.resilient_parsing:
            raise _no_such("command", args[0], list(COMMANDS), "mvtn --help")
        name, _, rest = super().resolve_command(ctx, args)
        return name, name and load_command(name), rest

    def main(self, args: Sequence[str] | None = None, standalone_mode: bool = True, **extra: Any) -> Any:  # type: ignore[override]
        """Run the command line; every way out goes through here."""
        words = list(sys.argv[1:] if args is None else args)
        extra["prog_name"] = "mvtn"
        try:
            code = super().main(words or ["--help"], standalone_mode=False, **extra)
        except Exception as error:
            code = report_error(error, words)
        if standalone_mode:
            sys.exit(int(code or 0))
        return code


def report_error(error: BaseException, words: Sequence[str]) -> ExitCode:
    """Say what went wrong on stderr, as the command line wants it, and return the exit code."""
    known = _as_mvtn_error(error, words)
    if "--debug" in words:
        traceback.print_exception(error, file=sys.stderr)
    hint = f"\n  {known.hint}" if known.hint else ""
    lines = [f"error: {known.message}{hint}"]
    if "--json" in words or "--jsonl" in words:
        document = {
            "type": "error",
            "code": known.code,
            "exit": int(known.exit_code),
            "message": known.message,
            "hint": known.hint,
        }
        lines.append(json.dumps(document, ensure_ascii=False))
    with contextlib.suppress(BrokenPipeError):
        encoding = sys.stderr.encoding or "utf-8"
        sys.stderr.write("\n".join(lines).encode(encoding, "backslashreplace").decode(encoding) + "\n")
        sys.stderr.flush()
    return known.exit_code


def _as_mvtn_error(error: BaseException, words: Sequence[str]) -> MvtnError:
    """Give every exception the four parts of an error: message, hint, code, exit code."""
    if isinstance(error, MvtnError):
        return error
    if hasattr(error, "format_message"):  # typer's own, whose class moved from click to typer in 0.26
        return _as_usage_error(error, words)
    told = " ".join(str(error).split()) or "no words"
    if isinstance(error, MemoryError) or re.search("out of memory|not enough memory|can't allocate memory", told):
        hint = "try --batch-size auto, a smaller one, or a smaller --image-size"
        return MvtnError("out of memory", hint=hint, code="memory")
    if isinstance(error, OSError) and error.errno in MACHINE_ERRORS:
        message = f"{error.filename or 'a file'}: {error.strerror}"
        return MvtnError(message, hint=MACHINE_ERRORS[error.errno], code="machine")
    message = f"internal error: {type(error).__name__}: {told}"
    return MvtnError(message, hint="run again with --debug", code="internal")


def _as_usage_error(error: Any, words: Sequence[str]) -> UsageError:
    help_command = " ".join(["mvtn", *words[:1], "--help"] if words[0] in COMMANDS else ["mvtn", "--help"])
    name = getattr(error, "option_name", None)
    if name and type(error).__name__ == "NoSuchOption":
        params = error.ctx.command.get_params(error.ctx)
        known = [option for param in params for option in (*param.opts, *param.secondary_opts)]
        return _no_such("option", name, [option for option in known if option.startswith("--")], help_command)
    message = error.format_message().rstrip(".")
    return UsageError(message[0].lower() + message[1:], hint=f"see {help_command}")


def _no_such(what: str, name: str, known: Sequence[str], help_command: str) -> UsageError:
    close = nearest(name, known)
    guess = f"; did you mean '{close}'?" if close else ""
    return UsageError(f"unknown {what} '{name}'{guess}", hint=f"see {help_command}", code=f"unknown-{what}")


def _version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"mvtn {__version__}\n")
        raise typer.Exit


app = typer.Typer(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=help_style(),
)


@app.callback()
def root(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    """Recognise 3D shapes from views that the network chooses itself.

    Example: mvtn preprocess && mvtn train && mvtn eval
    """


def main() -> None:
    """The `mvtn` command. A polite kill is treated like Ctrl-C: save, say how to go on, leave."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    app()
