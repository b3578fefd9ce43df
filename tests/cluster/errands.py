"""What workers are sent in tests; they import this by name."""

from __future__ import annotations

import time

from mvtn_cli.errors import MvtnError


def square(number: int) -> int:
    return number * number


def square_slowly(number: int) -> int:
    time.sleep(0.02)
    return number * number


def refuse_seven(number: int) -> int:
    if number == 7:
        raise MvtnError("seven is refused", hint="take another", code="test.seven")
    return number
