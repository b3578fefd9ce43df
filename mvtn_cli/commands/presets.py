"""`mvtn presets`: the rows of the paper's tables as settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.settings import in_order
from mvtn_cli.config import TrainConfig
from mvtn_cli.console import counted
from mvtn_cli.presets import PRESETS, Figure, Preset, Setting, find_preset
from mvtn_cli.presets_config import PresetsConfig

SCHEMA = "mvtn.presets/1"
NAMED_BY = ("network", "backbone", "views", "layout", "num_views", "render", "epochs")  # what a list shows of settings


def presets(config: PresetsConfig, call: Call) -> None:
    """List the settings of the paper's tables with the paper's figures, or print those of one with their sources.

    Example: mvtn presets modelnet40-mvtn-viewgcn-12 > own.toml
    """
    if config.which is None:
        return _list(call)
    preset = find_preset(config.which)
    call.console.result({"schema": SCHEMA, "presets": [_entry(preset)]}, to_toml(preset))
    call.console.note(f"next: mvtn train {preset.data} --preset {preset.name}")
    return None


def _list(call: Call) -> None:
    rows = [
        (preset.name, preset.table, preset.row, "; ".join(_figures(preset)), _what_it_sets(preset))
        for preset in PRESETS.values()
    ]
    call.console.table("presets", ["preset", "table", "row", "paper", "sets"], rows, stream="out")
    call.console.result({"schema": SCHEMA, "presets": [_entry(preset) for preset in PRESETS.values()]})
    call.console.note(f"{counted(len(rows), 'preset')}; next: mvtn presets NAME, or mvtn train DATASET --preset NAME")


def _figures(preset: Preset) -> list[str]:
    return list(dict.fromkeys(figure.words for figure in preset.figures if figure.percent is not None))


def _what_it_sets(preset: Preset) -> str:
    shown = [f"{key}={preset.values[key]}" for key in NAMED_BY if key in preset.settings]
    rest = len(preset.settings) - len(shown)
    return " ".join(shown) + (f" and {rest} more" if rest else "")


def _entry(preset: Preset) -> dict[str, Any]:
    return {
        "name": preset.name,
        "data": preset.data,
        "figures": [vars(figure) for figure in preset.figures],
        "settings": preset.values,
        "sources": {field: setting.source for field, setting in preset.settings.items()},
        "notes": preset.notes,
    }


def to_toml(preset: Preset) -> str:
    """The settings as TOML that `mvtn train --config` reads, each with its source as a comment."""
    lines = [f"# {preset.name}, for {preset.data}"]
    lines += [f"# {_figure_line(figure)}" for figure in preset.figures]
    lines += ["", *_setting_lines(preset.settings, in_order(TrainConfig)), ""]
    lines += ["# Where the paper, the released code and this program differ besides:"]
    lines += [f"# - {note}" for note in preset.notes]
    return "\n".join(lines)


def _figure_line(figure: Figure) -> str:
    known = f"{figure.words} ({figure.source})" if figure.percent is not None else "no figure that could be checked"
    return f"{figure.table}; {figure.row}: {known}"


def _setting_lines(settings: Mapping[str, Setting], order: Sequence[str]) -> list[str]:
    import tomli_w

    lines = []
    for field in order:
        if field in settings:
            written = tomli_w.dumps({field: settings[field].value}).strip()
            lines.append(f"{written}  # {settings[field].source}")
    return lines
