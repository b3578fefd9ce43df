"""What the configuration models are made of: described fields, and types that read text."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from pydantic.fields import FieldInfo

OWN = ("metavar", "short", "argument", "many", "also", "words", "auto", "names")


def option(default: Any, description: str, panel: str, **more: Any) -> Any:
    """Describe one field.

    Args:
        default: The value without any wish; None is written `auto` in files and options.
        description: The help text.
        panel: Under which heading `--help` shows it.
        more: Limits for pydantic (`ge`, `le`, `gt`, `lt`, `pattern`), or for the command line `metavar`,
            `short`, `argument` (positional; "many" takes several), `many` (an option that may be repeated), `also`
            (further words that the field takes), `words` (says what a pattern allows), `auto` (None can be wished
            for, by this word, though it is not the default), and `names` (what a shell offers: "runs" or "presets").
    """
    own: dict[str, Any] = {"panel": panel}
    own |= {key: more.pop(key) for key in OWN if key in more}
    return Field(default, description=description, json_schema_extra=own, **more)


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, str) and value.strip().isdecimal() else value


def is_number(text: str) -> bool:
    """Whether a text says a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def several(value: Any) -> Any:
    """Read a comma-separated text, or one number, as a list."""
    if isinstance(value, str):
        return [part.strip() for part in value.split(",")]
    return [value] if isinstance(value, int | float) else value


Supersample = Annotated[Literal[1, 2, 4], BeforeValidator(_whole)]
Degrees = Annotated[float, Field(ge=-360, le=360)]
Angles = Annotated[tuple[Degrees, ...], BeforeValidator(several), Field(min_length=1, max_length=100)]


class Config(BaseModel):
    """What all commands' settings have in common: no unknown keys, no change afterwards, no NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _auto_is_none(cls, values: Any) -> Any:
        """Read `auto` as None where None is the default: so a file can say it and an option undo a file."""
        if not isinstance(values, dict):
            return values
        return {
            key: None if value == "auto" and _takes_auto(cls.model_fields.get(key)) else value
            for key, value in values.items()
        }


def _takes_auto(field: FieldInfo | None) -> bool:
    if field is None:
        return False
    extra = field.json_schema_extra
    return field.default is None or (isinstance(extra, dict) and "auto" in extra)
