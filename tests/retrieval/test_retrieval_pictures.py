"""Sheets of queries and hits: what is framed, and where the pictures are."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from mvtn_cli.core.retrieval.pictures import MOST, RED, TILE, Found, found_sheet, framed


def row(count: int, wrong: list[int]) -> Found:
    """Hits in shades of grey, none of them red."""
    hits = np.stack([np.full((3, TILE, TILE), 60 + k, np.uint8) for k in range(count)])
    return Found(
        np.full((3, TILE, TILE), 200, np.uint8), "chair", hits, ["a"] * count, [k in wrong for k in range(count)]
    )


def red_spots(sheet: bytes) -> list[tuple[int, int]]:
    """Grey levels that are framed: what a step inside of each frame's upper left corner shows."""
    pixels = np.asarray(Image.open(io.BytesIO(sheet)).convert("RGB")).astype(int)
    red = (pixels == RED).all(axis=2)
    corners = red & ~np.roll(red, 1, axis=0) & ~np.roll(red, 1, axis=1)
    return [int(pixels[y + 20, x + 20, 0]) for y, x in np.argwhere(corners)]


def test_a_frame_is_red_and_leaves_the_inside_alone():
    image = np.arange(3 * TILE * TILE, dtype=np.uint32).reshape(3, TILE, TILE).astype(np.uint8)
    found = framed(image)
    assert tuple(found[:, 0, 0]) == tuple(found[:, -1, TILE // 2]) == RED
    assert np.array_equal(found[:, 8:-8, 8:-8], image[:, 8:-8, 8:-8]) and image[0, 0, 1] == 1


def test_the_wrong_hits_are_framed_and_no_others():
    assert sorted(red_spots(found_sheet([row(10, [2, 7])]))) == [62, 67]
    assert red_spots(found_sheet([row(10, [])])) == []
    assert sorted(red_spots(found_sheet([row(3, [0]), row(2, [1])], "both"))) == [60, 61]


def test_more_than_ten_hits_go_into_further_lines_up_to_fifty():
    heights = []
    for count in (1, 10, 11, 25, 50, 90):
        sheet = found_sheet([row(count, list(range(count)))])
        heights.append(Image.open(io.BytesIO(sheet)).height)
        assert sorted(red_spots(sheet)) == [60 + k for k in range(min(count, MOST))]
    assert heights[0] == heights[1] < heights[2] < heights[3] < heights[4] == heights[5]
