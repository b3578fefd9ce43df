"""Settings of `mvtn presets`, and the option that takes one."""

from __future__ import annotations

from mvtn_cli.fields import Config, option


class PresetConfig(Config):
    """For commands that train."""

    preset: str | None = option(
        None,
        "Settings of a row of the paper's tables, as mvtn presets lists them; all other options win over it",
        "Run",
        metavar="NAME",
        names="presets",
    )


class PresetsConfig(Config):
    """Which presets to show."""

    # Not `preset`: that may stand in mvtn.toml, and a bare `mvtn presets` lists all.
    which: str | None = option(
        None, "Preset whose settings are printed as TOML, each with its source; auto: a list of all", "Data",
        argument=True, names="presets",
    )  # fmt: skip
