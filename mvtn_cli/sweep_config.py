"""What `mvtn sweep` adds to the settings of a training."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator

from mvtn_cli.errors import UsageError
from mvtn_cli.fields import Config, option

EXAMPLE = "for example --vary num-views=1,3,6 --vary views=fixed,learned"


def _listed(value: Any) -> Any:
    """One text, as a file or the environment gives it, is a list separated by spaces."""
    return value.split() if isinstance(value, str) else value


class VaryConfig(Config):
    """Which settings are varied, and how."""

    vary: Annotated[tuple[str, ...], BeforeValidator(_listed)] = option(
        (), "A setting and its values, as num-views=1,3,6; may be repeated", "Compare",
        metavar="SETTING=LIST", many=True,
    )  # fmt: skip
    one_at_a_time: bool = option(
        False, "Change one setting at a time from the others' plain values, instead of all combinations", "Compare"
    )
    seeds: int = option(1, "Trainings of each combination", "Compare", ge=1, le=100)

    def varied(self) -> dict[str, list[str]]:
        """The values of each field that is varied, as text, in the order that they were given.

        Raises:
            UsageError: Nothing is varied, or an entry does not look like `setting=value,value`.
        """
        found: dict[str, list[str]] = {}
        for entry in self.vary:
            name, equals, listed = entry.partition("=")
            values = [value.strip() for value in listed.split(",") if value.strip()]
            if not name.strip() or not equals or not values:
                raise UsageError(f"--vary {entry} names no setting and values", hint=EXAMPLE, code="sweep.vary")
            own = found.setdefault(name.strip().lstrip("-").replace("-", "_"), [])
            own += [value for value in values if value not in own]
        if not found:
            raise UsageError("there is nothing to vary", hint=EXAMPLE, code="sweep.vary")
        return found
