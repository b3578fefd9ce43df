from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from mvtn_cli.core.reporting import plots


def parse(svg: str) -> ET.Element:
    """An inline SVG needs no namespace in a page, but a parser of XML wants the one of xlink."""
    return ET.fromstring(svg.replace("<svg ", '<svg xmlns:xlink="x" ', 1))


ALL = {
    "curves": lambda: plots.curves([("training", [2, 1, 0.5]), ("validation", [2, None, 0.7])], label="loss"),
    "one epoch": lambda: plots.curves([("validation", [0.4])], label="accuracy", percent=True, best_epoch=0),
    "reference": lambda: plots.curves([("validation", [80.0, 9.0])], label="error", reference=(90.0, "blind")),
    "nothing known": lambda: plots.curves([("validation", [None, float("nan")])], label="loss", best_epoch=1),
    "histogram": lambda: plots.azimuth_histogram([0.0, -10.0, np.nan, 179.0], [90.0, 91.0, 0.0, 0.0]),
    "sphere": lambda: plots.sphere_map(np.zeros((3, 2)), np.full((3, 2), 100.0), ([0, 90], [0, 90])),
    "forty views": lambda: plots.sphere_map(np.arange(80.0).reshape(2, 40), np.zeros((2, 40))),
    "no shapes": lambda: plots.sphere_map(np.zeros((0, 2)), np.zeros((0, 2))),
}


@pytest.mark.parametrize("draw", ALL.values(), ids=ALL.keys())
def test_a_plot_is_an_svg_without_addresses_whose_colours_are_the_pages(draw):
    svg = draw()
    assert parse(svg).attrib["role"] == "img"
    assert "http" not in svg and "xmlns" not in svg and "<style" not in svg and "font-family" not in svg
    assert not re.search(r"#0000[0-9a-f]{2}\b", svg), "a stand-in colour was left over"
    assert {v.removeprefix("--") for v in re.findall(r"--\w+", svg)} <= set(plots.VARIABLES.values())


def test_the_same_numbers_give_the_same_bytes():
    assert ALL["sphere"]() == ALL["sphere"]() and ALL["curves"]() == ALL["curves"]()


def test_names_inside_different_plots_do_not_clash():
    def ids(svg: str) -> set[str]:
        return set(re.findall(r' id="([^"]+)"', svg))

    first, second = ids(ALL["reference"]()), ids(ALL["sphere"]())
    assert first and second and not first & second
    assert all(re.fullmatch(r"[mp][0-9a-f]+", name) for name in first | second)


def test_the_map_draws_a_dot_a_camera_until_there_are_too_many():
    few, many = np.zeros((20, 3)), np.zeros((5000, 3))
    dots = len(parse(plots.sphere_map(few, few)).findall(".//use"))
    assert dots == 60
    dots = len(parse(plots.sphere_map(many, many)).findall(".//use"))
    assert 0.9 * plots.MAX_DOTS <= dots <= plots.MAX_DOTS


def test_names_of_curves_that_end_together_are_moved_apart():
    svg = parse(plots.curves([("training", [1.0, 0.5]), ("validation", [1.0, 0.5])], label="loss"))
    heights = [float(t.attrib["y"]) for t in svg.iter("text") if t.text in ("training", "validation")]
    assert len(heights) == 2 and abs(heights[0] - heights[1]) > 8
