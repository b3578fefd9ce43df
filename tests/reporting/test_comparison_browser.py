"""A comparison as a browser shows it: its tables sort, its plots have colours, and the console is silent."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from mvtn_cli.core.reporting.comparison import write_comparison

sys.path.insert(0, str(Path(__file__).parent))
from browser import needs_browser, try_page
from made_up_runs import small_run

pytestmark = needs_browser
TRY = (Path(__file__).parent / "try_comparison.js").read_text()
SECONDS = {"slow": 900.0, "quick": 0.5, "middling": 9.0}  # an epoch of eight


def opened(folder: Path, *flags: str) -> tuple[dict[str, Any], list[str]]:
    """What `try_comparison.js` found on the page, and the lines of the browser's console."""
    runs = [small_run(folder / name, seconds=s, lr=s, seed=int(s), skill=2 + s / 300) for name, s in SECONDS.items()]
    (runs[0] / "report.html").write_text("one")
    page = folder / "comparison.html"
    write_comparison(runs, page, "mvtn report " + "a-long-name/" * 12)
    return try_page(page.read_text(), TRY, folder, *flags)


@pytest.fixture(scope="module")
def light(tmp_path_factory) -> tuple[dict[str, Any], list[str]]:
    return opened(tmp_path_factory.mktemp("light"))


def test_the_console_is_silent(light):
    assert light[1] == []


def test_tables_sort_by_what_their_cells_mean(light):
    found, _ = light
    times = ["2 h 0 min", "4.0 s", "1 min 12 s"]
    assert found["before"] == times
    assert found["slowest_first"] == [times[0], times[2], times[1]], "by seconds, not by the first number"
    assert found["fastest_first"] == found["slowest_first"][::-1] and found["aria"] == "ascending"
    assert found["as_named"] == ["1", "2", "3"]
    assert found["differences"] == sorted(found["differences"], reverse=True) and found["differences"][0] > 0
    assert found["p_down"] == sorted(found["p_down"], reverse=True) and len(set(found["p_down"])) == 3


def test_the_keyboard_reaches_everything(light):
    found, _ = light
    assert found["region_has_focus"] and found["unreachable"] == 0


def test_plots_are_not_blank_and_have_the_colours_of_the_tables(light):
    found, _ = light
    by_time, by_epoch, dots = found["plots"]
    for plot in (by_time, by_epoch, dots):
        assert plot["colors"] >= 4 and plot["width"] > 300 and plot["height"] > 80, "three runs and the grid"
    assert {"1", "2", "3", "time of training", "10 s", "1 h"} <= set(by_time["texts"])
    assert {"epoch", "8"} <= set(by_epoch["texts"]) and "test accuracy (%)" in dots["texts"]
    assert found["stroke_is_chip"]


def test_a_dark_narrow_page_fits_and_is_printed_light(tmp_path, light):
    bright, _ = light
    assert bright["card"] == bright["printed"] == "#ffffff" and bright["wide"] <= 0
    found, console = opened(tmp_path, "--blink-settings=preferredColorScheme=0", "--window-size=500,800")
    assert console == [] and found["wide"] <= 0, "nothing sticks out of the page"
    assert found["region_scrolls"] > 0
    assert found["card"] == found["after"] == "#1c2025" and found["printed"] == "#ffffff"
    assert found["stroke_is_chip"] and found["chip"] != bright["chip"]
