"""The pages' templates, and how numbers are written in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvtn_cli.core.reporting import words

if TYPE_CHECKING:
    from jinja2 import Template


def template(name: str) -> Template:
    """Load a template; in it everything is escaped, and a name that is not there is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("mvtn_cli.core.reporting", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    for filter_name in ("percent", "span", "degrees", "number", "count", "duration"):
        environment.filters[filter_name] = getattr(words, filter_name)
    return environment.get_template(name)
