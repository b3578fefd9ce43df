"""A preset between what the user says and the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mvtn_cli.errors import choose_error
from mvtn_cli.presets.preset import Preset
from mvtn_cli.presets.tables import PRESETS
from mvtn_cli.shared_config import SOLIDS


def find_preset(name: str) -> Preset:
    """The preset of a name.

    Raises:
        UsageError: There is none; the nearest one is named.
    """
    if name not in PRESETS:
        raise choose_error("preset", name, PRESETS)
    return PRESETS[name]


def settings_beside(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """What a preset sets beside settings that were given: those win, and what hangs on them follows.

    With fewer epochs the first stage keeps its share of them; what belongs to a selection of views, or to a layout
    with a number of views of its own, goes with it.

    Args:
        name: Of the preset.
        given: By field; values may still be text.

    Raises:
        UsageError: There is no such preset.
    """
    preset = find_preset(name).values
    values = {field: value for field, value in preset.items() if field not in given}
    if "first_stage_epochs" in values and "epochs" in given:
        values["first_stage_epochs"] = _share(preset["first_stage_epochs"], preset["epochs"], given["epochs"])
    for field in foreign(values, given):
        values.pop(field, None)
    return values


def foreign(values: Mapping[str, Any], given: Mapping[str, Any]) -> set[str]:
    """Those of some settings that don't go with others which were given."""
    found: set[str] = set()
    views = str(given.get("compare") or given.get("views") or "learned-direct")
    if "learned-direct" not in views:
        found.add("angles")
    if "learned" not in views:
        found |= {"learn_distance", "learn_light"}
    if values.get("layout") in SOLIDS and "num_views" in given:
        found.add("layout")
    if given.get("layout") in SOLIDS:
        found.add("num_views")
    return found


def _share(stage: int, of: int, epochs: Any) -> int:
    try:
        return round(stage * int(epochs) / of)
    except (TypeError, ValueError):
        return stage  # no number: said when the settings are checked
