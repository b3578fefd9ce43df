"""Settings by the row of the paper's tables that they belong to; no torch here."""

from mvtn_cli.presets.preset import Figure, Preset, Setting
from mvtn_cli.presets.resolving import find_preset, foreign, settings_beside
from mvtn_cli.presets.tables import PRESETS

__all__ = ["PRESETS", "Figure", "Preset", "Setting", "find_preset", "foreign", "settings_beside"]
