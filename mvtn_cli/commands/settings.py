"""Where each setting comes from: option > environment > file > preset > default.

A file is `--config FILE`, else `./mvtn.toml`. Its top level holds for all commands, a table named after a
command for that one. `auto` means the default of a setting that is worked out later.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from mvtn_cli.config import MODELS, Config
from mvtn_cli.errors import UsageError, nearest
from mvtn_cli.fields import is_number

PROJECT_FILE = Path("mvtn.toml")
PANELS = (  # in the order of --help
    *("Data", "Run", "Views", "Pictures", "Network", "Training"),
    *("Compare", "Measure", "Answer", "Cache", "Machine", "General"),
)
ConfigT = TypeVar("ConfigT", bound=Config)


def resolve(
    model: type[ConfigT], options: Mapping[str, Any], config_file: Path | None, command: str
) -> tuple[ConfigT, dict[str, str]]:
    """Build a command's configuration.

    Args:
        model: The command's configuration class.
        options: What the command line says; None where it says nothing.
        config_file: A TOML file; `./mvtn.toml`, if there is one, when None.
        command: Which table of the file holds.

    Returns:
        The configuration, and of each field its origin: `--epochs`, `MVTN_EPOCHS`, `mvtn.toml`, `preset NAME` or
        `default`.

    Raises:
        UsageError: An unknown key, or a value outside its limits; the message names the origin.
    """
    tables, file_name = read_config_file(config_file)
    values: dict[str, Any] = {}
    origins: dict[str, str] = {}
    for name, field in model.model_fields.items():
        origins[name] = "default"
        variable = f"MVTN_{name.upper()}"
        if options.get(name) is not None:
            values[name] = options[name]
            origins[name] = "argument" if _extra(field).get("argument") else option_name(name)
        elif os.environ.get(variable):
            values[name], origins[name] = os.environ[variable], variable
        elif name in tables.get(command, {}):
            values[name], origins[name] = tables[command][name], f"{file_name} [{command}]"
        elif name in tables[""]:
            values[name], origins[name] = tables[""][name], file_name
    if values.get("preset") not in (None, "auto"):
        from mvtn_cli.presets import settings_beside

        beside = settings_beside(str(values["preset"]), values)
        values |= beside
        origins |= dict.fromkeys(beside, f"preset {values['preset']}")
    try:
        return model.model_validate(values), origins
    except ValidationError as error:
        raise usage_error(error, model, origins) from None


def option_name(field: str) -> str:
    """The option of a field: `num_views` is `--num-views`."""
    return "--" + field.replace("_", "-")


def to_toml(config: Config, origins: Mapping[str, str] | None = None) -> str:
    """Write a configuration as TOML that `--config` reads; with origins, as a comment behind each value."""
    import tomli_w

    lines = []
    for name in in_order(type(config)):
        value = getattr(config, name)
        value = "auto" if value is None else str(value) if isinstance(value, Path) else value
        value = list(value) if isinstance(value, tuple) else value
        line = tomli_w.dumps({name: value}).strip().replace("\n", "")
        lines.append(f"{line}  # {origins[name]}" if origins else line)
    return "\n".join(lines)


def in_order(model: type[Config]) -> list[str]:
    """The fields as a person reads them: arguments first, then panel by panel."""
    fields = model.model_fields
    by_panel = sorted(fields, key=lambda name: PANELS.index(_extra(fields[name])["panel"]))
    return sorted(by_panel, key=lambda name: not _extra(fields[name]).get("argument"))


def read_config_file(path: Path | None) -> tuple[dict[str, dict[str, Any]], str]:
    """Read and check a configuration file.

    Returns:
        The tables by command, with the top level under the empty name, and the file's name for messages.
    """
    file = path or PROJECT_FILE
    if path is None and not file.is_file():
        return {"": {}}, ""
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"--config {file} can't be read: {error.strerror}", code="config.file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(
            f"{file} is not valid TOML: {error}", hint="a line looks like: epochs = 30", code="config.file"
        ) from None
    tables: dict[str, dict[str, Any]] = {"": {}}
    for key, value in content.items():
        if isinstance(value, dict) and key in MODELS:
            tables[key] = {_field(name): item for name, item in value.items()}
        else:
            tables[""][_field(key)] = value
    for command, table in tables.items():
        _check_keys(table, command, str(file))
    return tables, str(file)


def _field(key: str) -> str:
    return key.replace("-", "_")


def _check_keys(table: Mapping[str, Any], command: str, file: str) -> None:
    """Refuse a key that no command (or not this one) knows, with the nearest right one."""
    models = [MODELS[command]] if command else MODELS.values()
    known = {name for model in models for name in model.model_fields}
    for key in table:
        if key in known:
            continue
        close = nearest(key, [*known, *([] if command else MODELS)])
        raise UsageError(
            f"unknown key '{key}' in {file}" + (f" [{command}]" if command else ""),
            hint=f"did you mean '{close}'?" if close else "keys are option names: num_views for --num-views",
            code="config.unknown-key",
        )


def usage_error(error: ValidationError, model: type[Config], origins: Mapping[str, str]) -> UsageError:
    """Say the first thing pydantic found in one sentence that names the option, variable or file."""
    first = error.errors()[0]
    field = str(first["loc"][0])
    extra = _extra(model.model_fields[field])
    where = _where(field, origins[field], argument=bool(extra.get("argument")))
    got = first["input"]
    shown = f"'{got}'" if isinstance(got, str) and not is_number(got) else f"{got}"
    if first["type"] == "literal_error":
        return _unknown_choice(field, str(got), origins[field], model)
    more = "" if origins[field].startswith("--") else f"{field} is the option {option_name(field)}"
    return UsageError(f"{where} must be {_wanted(first, extra)}, got {shown}", hint=more, code="config.value")


def _where(field: str, origin: str, *, argument: bool) -> str:
    if origin == "argument" or (argument and origin == "default"):
        return field.upper()
    return origin if origin.startswith(("--", "MVTN_")) else f"{field} in {origin}"


def _wanted(error: Any, extra: Mapping[str, Any]) -> str:
    """What pydantic expected, in words."""
    limits = error.get("ctx", {})
    match error["type"]:
        case "greater_than_equal":
            return f"at least {_limit(limits['ge'])}"
        case "less_than_equal":
            return f"at most {_limit(limits['le'])}"
        case "greater_than":
            return f"more than {_limit(limits['gt'])}"
        case "less_than":
            return f"less than {_limit(limits['lt'])}"
        case "int_parsing" | "int_type" | "int_from_float" | "int_parsing_size":
            return "a whole number or auto" if "auto" in extra else "a whole number"
        case "float_parsing" | "float_type" | "finite_number":
            return "a number"
        case "bool_parsing" | "bool_type":
            return "true or false"
        case "string_type" | "path_type":
            return "a text"
        case "string_pattern_mismatch":
            return str(extra.get("words", "of another form"))
        case _:
            message = str(error["msg"])
            return message[0].lower() + message[1:]


def _limit(value: float) -> str:
    return f"{int(value)}" if float(value).is_integer() else f"{value}"


def _unknown_choice(field: str, got: str, origin: str, model: type[Config]) -> UsageError:
    choices = choices_of(model, field)
    close = nearest(got, choices)
    place = "" if origin == "argument" or origin.startswith("--") else f" ({origin})"
    return UsageError(
        f"unknown {field.replace('_', ' ')} '{got}'{place}" + (f"; did you mean '{close}'?" if close else ""),
        hint=f"{option_name(field) if origin.startswith('--') else field} is one of: {', '.join(choices)}",
        code=f"unknown-{field.replace('_', '-')}",
    )


def choices_of(model: type[Config], field: str) -> list[str]:
    """The words that a field takes, in order; empty if it is not a choice."""
    from typing import Literal, get_args, get_origin

    annotation = model.model_fields[field].annotation
    for part in (annotation, *get_args(annotation)):
        if get_origin(part) is Literal:
            return [*map(str, get_args(part)), *_extra(model.model_fields[field]).get("also", ())]
    return []


def _extra(field: Any) -> dict[str, Any]:
    return field.json_schema_extra or {}
