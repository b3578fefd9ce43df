"""The page as a browser shows it: its scripts do what they should, and complain of nothing."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest

from mvtn_cli.core.reporting.report import write_report

sys.path.insert(0, str(Path(__file__).parent))
from browser import needs_browser, try_page
from made_up import make_run

pytestmark = needs_browser

TRY = (Path(__file__).parent / "try_report.js").read_text()


def opened(folder: Path, *flags: str) -> tuple[dict[str, Any], list[str]]:
    """What `try_report.js` found on the page, and the lines of the browser's console."""
    page = write_report(make_run(folder, [f"class {i}" for i in range(12)], size=24, analysis=True, skill=2.0))
    return try_page(page.read_text(), TRY, folder, *flags)


@pytest.fixture(scope="module")
def light(tmp_path_factory) -> tuple[dict[str, Any], list[str]]:
    return opened(tmp_path_factory.mktemp("light") / "run")


def test_the_console_is_silent(light):
    assert light[1] == []


def test_the_shape_turns_with_keys_and_mouse(light):
    found, _ = light
    assert found["mesh_tones"] > 40 and found["point_tones"] > 40, "shaded, not blank"
    assert found["start"] == "Seen from azimuth 28°, elevation 20°"
    assert found["turned"] == "Seen from azimuth 23°, elevation 20°" and found["turned_changes"]
    assert found["dragged"] == "Seen from azimuth 3°, elevation 16°", "and not after the button was let go"
    assert found["zoom_changes"] and found["reset_is_the_same"] and found["start_changes"]


def test_one_can_look_through_a_camera_and_turn_away_from_there(light):
    found, _ = light
    place = re.fullmatch(r"Through camera 2: azimuth (−?\d+)°, elevation (−?\d+)°", found["through"])
    assert place is not None and found["pressed"] == "false true false false false false"
    azimuth = int(place[1].replace("−", "-"))
    assert found["away"] in {f"Seen from azimuth {a}°, elevation {place[2]}°" for a in (azimuth + 5, azimuth + 4)}


def test_tables_sort_by_a_click(light):
    found, _ = light
    shares = [float(text.split("\u202f")[0]) for text in found["by_accuracy"]]
    assert shares == sorted(shares, reverse=True) and len(set(shares)) > 3
    assert found["aria"] == [None, None, None, "descending", None, None]
    assert found["upwards"] == sorted(found["upwards"], key=lambda text: float(text.split("\u202f")[0]))
    assert found["rows"] == found["by_name"] == [f"class {i}" for i in range(12)], "2 stands before 10"


def test_pictures_grow_and_the_keyboard_reaches_them(light):
    found, _ = light
    assert found["modal"], "so that the browser's own Esc closes it"
    assert found["large"] > 400 and found["same_picture"] and found["next_picture"] and found["closed"]
    assert found["next_has_focus"] and found["tab_stops"] == 1 and found["focus_is_back"]
    assert found["wide"] <= 0, "nothing sticks out of the page"


def test_a_dark_page_is_printed_light(tmp_path, light):
    assert light[0]["card"] == light[0]["printed"] == "#ffffff"
    found, console = opened(tmp_path / "run", "--blink-settings=preferredColorScheme=0")
    assert console == [] and found["card"] == "#1c2025" and found["mesh_tones"] > 40
    assert found["printed"] == "#ffffff" and found["printed_tones"] > 40 and found["after"] == found["card"]
