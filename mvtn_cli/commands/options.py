"""From a configuration model to the options of a command, and from a command line to a call.

The options are generated, so that each setting is described in one place (`config.py`). All of them arrive as
text and are None where the command line says nothing: pydantic reads text from options, environment and files
alike, and None tells `resolve` to look further.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import typer
from pydantic.fields import FieldInfo

from mvtn_cli.commands.completing import NAMES, completion
from mvtn_cli.commands.settings import choices_of, in_order, option_name, resolve, to_toml
from mvtn_cli.config import MODELS, Config, SkipConfig
from mvtn_cli.console import Console, Mode, PipeClosed, close_pipes, help_style
from mvtn_cli.errors import ExitCode, Interrupted, UsageError

ConfigT = TypeVar("ConfigT", bound=Config)
Run = Callable[[Any, "Call"], ExitCode | None]

WIDEST_CHOICES = 20  # characters; longer lists of choices go into the help text
DRY_RUN = ("preprocess", "train", "sweep")  # commands that can print their plan


@dataclass(frozen=True)
class Call:
    """What a command gets beside its configuration.

    Attributes:
        command: Its name.
        console: Where it speaks.
        config_file: What `--config` says.
        dry_run: Print the plan and write nothing.
        started: When the command began, monotonic seconds.
    """

    command: str
    console: Console
    config_file: Path | None = None
    dry_run: bool = False
    started: float = field(default_factory=time.monotonic)

    def settings(self, model: type[ConfigT], command: str, **options: Any) -> ConfigT:
        """Resolve the configuration of another command that this one leans on, from environment and file."""
        return resolve(model, options, self.config_file, command)[0]

    @property
    def seconds(self) -> float:
        """How long the command has worked."""
        return time.monotonic() - self.started


def build_command(name: str, run: Run) -> Any:
    """Make the typer command `name` that calls `run` with a configuration and a `Call`."""

    def callback(**given: Any) -> Any:
        try:
            return _invoke(name, run, given)
        except PipeClosed:  # the reader has enough, as in `mvtn predict … | head -1`
            close_pipes()
            return ExitCode.OK
        except KeyboardInterrupt:
            raise Interrupted("interrupted", hint="the same command goes on where it stopped") from None

    callback.__doc__ = run.__doc__
    callback.__signature__ = inspect.Signature(list(_parameters(name)))  # type: ignore[attr-defined]
    app = typer.Typer(add_completion=False, rich_markup_mode=help_style())
    app.command(name)(callback)
    return typer.main.get_command(app)


def _invoke(name: str, run: Run, given: dict[str, Any]) -> ExitCode:
    """Parse, resolve, then either show the configuration or do the work."""
    general = {key: given.pop(key) for key in ("config", "show_config", "json", "jsonl", "quiet", "debug")}
    dry_run = given.pop("dry_run", False)
    for switch in [key for key in given if f"no_{key}" in given]:
        given[switch] = False if given.pop(f"no_{switch}") else given[switch]
    if general["json"] and general["jsonl"]:
        raise UsageError("--json and --jsonl exclude each other", hint="--jsonl gives one object a line")
    mode: Mode = "json" if general["json"] else "jsonl" if general["jsonl"] else "text"
    console = Console(mode=mode, quiet=general["quiet"], debug=general["debug"])
    config, origins = resolve(MODELS[name], given, general["config"], name)
    if general["show_config"]:
        console.result({"config": config.model_dump(), "origins": origins}, to_toml(config, origins))
        return ExitCode.OK
    if isinstance(config, SkipConfig) and config.no_skip:
        from mvtn_cli.core.render.skips import use_skips

        use_skips(config.no_skip)
    code = run(config, Call(name, console, general["config"], dry_run)) or ExitCode.OK
    if isinstance(config, SkipConfig) and config.explain:
        from mvtn_cli.core.render.explaining import explain
        from mvtn_cli.core.render.tally import tally

        for sentence in explain(tally()):
            console.note(sentence)
    return code


def _parameters(command: str) -> Iterator[inspect.Parameter]:
    """All parameters of a command: positional ones, its settings by panel, then the general options."""
    model = MODELS[command]
    for name in in_order(model):
        yield _parameter(name, model.model_fields[name], choices_of(model, name))
        if model.model_fields[name].annotation is bool:  # undoes what a file says; not worth a line of --help
            yield _keyword(f"no_{name}", typer.Option(False, option_name(f"no_{name}"), hidden=True), bool)
    yield from _general(dry_run=command in DRY_RUN)


def _parameter(name: str, info: FieldInfo, choices: list[str]) -> inspect.Parameter:
    extra = _extra(info)
    short_choices = "|".join(choices) if len("|".join(choices)) <= WIDEST_CHOICES else ""
    listed = f": {', '.join(choices)}" if choices and not short_choices else ""
    shown: dict[str, Any] = {
        "help": f"{info.description}{listed}{_default_words(info)}",
        "show_default": False,
        "rich_help_panel": extra["panel"],
    }
    if choices or "names" in extra:
        shown["autocompletion"] = completion(NAMES[extra["names"]] if "names" in extra else lambda: choices)
    if extra.get("argument"):
        shown["metavar"] = ("|".join(choices) or name.upper()) + "..." * (extra["argument"] == "many")
        annotation: Any = list[str] | None if extra["argument"] == "many" else str | None
        return _keyword(name, typer.Argument(None, **{**shown, "rich_help_panel": None}), annotation)
    if info.annotation is bool:
        return _keyword(name, typer.Option(None, option_name(name), **shown), bool | None)
    shown["metavar"] = extra.get("metavar") or short_choices or ("NAME" if choices else _metavar(info))
    annotation = list[str] | None if extra.get("many") else str | None
    return _keyword(name, typer.Option(None, option_name(name), *_short(extra), **shown), annotation)


def _general(*, dry_run: bool) -> Iterator[inspect.Parameter]:
    def flag(name: str, text: str, *short: str) -> inspect.Parameter:
        shown = typer.Option(False, option_name(name), *short, help=text, rich_help_panel="General")
        return _keyword(name, shown, bool)

    if dry_run:
        yield flag("dry_run", "Print the plan and write nothing", "-n")
    yield _keyword(
        "config",
        typer.Option(None, help="Settings in TOML (default ./mvtn.toml)", metavar="FILE", rich_help_panel="General"),
        Path | None,
    )
    yield flag("show_config", "Print what holds and where each value comes from")
    yield flag("json", "Answer with one JSON document")
    yield flag("jsonl", "Answer with one JSON object a line")
    yield flag("quiet", "Only answers, warnings and errors", "-q")
    yield flag("debug", "Show tracebacks")


def _keyword(name: str, shown: Any, annotation: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=shown, annotation=annotation)


def _default_words(info: FieldInfo) -> str:
    if info.default is None or info.default is False or info.default == ():
        return ""
    default = f"{info.default:g}" if isinstance(info.default, float) else info.default
    return f" (default {default})"


def _metavar(info: FieldInfo) -> str:
    kinds = str(info.annotation)
    return "INTEGER" if "int" in kinds else "NUMBER" if "float" in kinds else "TEXT"


def _short(extra: dict[str, Any]) -> tuple[str, ...]:
    return (extra["short"],) if "short" in extra else ()


def _extra(info: FieldInfo) -> dict[str, Any]:
    extra = info.json_schema_extra
    return extra if isinstance(extra, dict) else {}
