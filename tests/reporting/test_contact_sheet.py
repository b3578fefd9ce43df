from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image

from mvtn_cli.core.reporting.images import contact_sheet, png, png_uri, shorten, to_bytes


def opened(content: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))


def colored(rows: int, columns: int, size: int = 96) -> np.ndarray:
    """Each picture has a colour of its own: red tells the row, green the column."""
    images = np.zeros((rows, columns, 3, size, size), np.uint8)
    images[:, :, 0] = 100 + 20 * np.arange(rows)[:, None, None, None]
    images[:, :, 1] = 100 + 20 * np.arange(columns)[None, :, None, None]
    return images


def test_every_picture_stands_in_its_row_and_column():
    sheet = opened(contact_sheet(colored(2, 3), ["first", "second"], ["a", "b", "c"]))
    places = {}
    for i in range(2):
        for j in range(3):
            here = np.argwhere((sheet == [100 + 20 * i, 100 + 20 * j, 0]).all(axis=-1))
            assert len(here) == 94 * 94, "a picture without its border"
            places[i, j] = here.mean(axis=0)
    assert places[0, 0][0] == places[0, 2][0] < places[1, 1][0]
    assert places[0, 0][1] == places[1, 0][1] < places[0, 1][1] < places[0, 2][1]


def test_titles_and_captions_take_room_and_are_drawn():
    plain = opened(contact_sheet(colored(1, 1)))
    worded = opened(contact_sheet(colored(1, 1), ["row"], ["column"], captions=[["12° / −3°"]], title="Title"))
    assert worded.shape[0] > plain.shape[0] + 30 and worded.shape[1] > plain.shape[1] + 15
    assert (worded[:14] == plain[0, 0]).all(), "nothing is drawn outside the margin"


def test_small_pictures_are_enlarged_and_long_names_shortened():
    sheet = opened(contact_sheet(colored(1, 2, size=16), ["a very long name " * 20]))
    assert sheet.shape[0] < 150 and sheet.shape[1] < 520
    short = shorten("chair/a_very_long_name_0001", 90, 12)
    assert short.startswith("chair") and short.endswith("1") and "…" in short
    assert shorten("wide", 1, 12) == "…"


@pytest.mark.parametrize("shape", [(3, 8, 8), (0, 1, 3, 8, 8), (1, 1, 1, 8, 8)])
def test_other_arrays_are_refused_by_their_shape(shape):
    with pytest.raises(ValueError, match=r"\(N, M, 3, H, W\).*got \("):
        contact_sheet(np.zeros(shape, np.uint8))


def test_a_picture_survives_as_png_and_as_an_address():
    image = np.random.default_rng(0).integers(0, 255, (3, 20, 30), dtype=np.uint8)
    assert np.array_equal(opened(png(image)), np.moveaxis(image, 0, -1))
    uri = png_uri(image)
    assert uri.startswith("data:image/png;base64,")
    assert np.array_equal(opened(base64.b64decode(uri.split(",")[1])), np.moveaxis(image, 0, -1))
    assert max(opened(png(image, 10)).shape) == 10
    grey = np.repeat(image[:1], 3, axis=0)
    assert np.array_equal(opened(png(grey)), np.moveaxis(grey, 0, -1))
    assert Image.open(io.BytesIO(png(grey))).mode == "L"


def test_values_outside_the_range_are_cut():
    assert to_bytes(np.array([-1.0, 0.0, 0.5, 1.0, 9.0, np.nan])).tolist() == [0, 0, 128, 255, 255, 0]
