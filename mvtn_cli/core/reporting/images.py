"""Pictures of views: as files, inside a page, and many on one sheet."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

Bytes = NDArray[np.uint8]
LARGE = 12_000  # bytes of one picture inside a page

PAPER, INK, MUTED, LINE = (252, 252, 250), (32, 36, 40), (110, 118, 126), (222, 222, 216)


def to_bytes(images: NDArray[np.floating[Any]]) -> Bytes:
    """Turn values in [0, 1] into 0..255, rounded; what lies outside is cut, NaN is black."""
    return (np.clip(np.nan_to_num(images), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def png(image: Bytes, max_size: int | None = None) -> bytes:
    """Encode one picture (3, H, W); grey ones take a third. Larger than `max_size` is scaled down to it."""
    picture = _picture(image)
    if max_size is not None and max(picture.size) > max_size:
        picture.thumbnail((max_size, max_size), Image.Resampling.LANCZOS)
    return encode(picture)


def png_uri(image: Bytes, max_size: int | None = None) -> str:
    """Give one picture (3, H, W) as an address that holds the picture itself."""
    content = png(image, max_size)
    if len(content) > LARGE:  # noise or many colours: 256 of them do, in a third of the bytes
        picture = Image.open(io.BytesIO(content)).convert("RGB")
        content = encode(picture.quantize(256, Image.Quantize.FASTOCTREE))
    return "data:image/png;base64," + base64.b64encode(content).decode("ascii")


def contact_sheet(
    images: Bytes,
    row_titles: Sequence[str] = (),
    column_titles: Sequence[str] = (),
    *,
    captions: Sequence[Sequence[str]] = (),
    title: str = "",
    size: int | None = None,
) -> bytes:
    """Lay pictures out in a grid and return it as PNG.

    Args:
        images: (N, M, 3, H, W): a row a shape, a column a view.
        row_titles: N texts, written to the left; one that is too long is shortened in its middle.
        column_titles: M texts, written above.
        captions: N rows of M texts, written under the pictures; a row without words takes no room for them.
        title: Written over everything.
        size: Side of a cell in pixels; None keeps the pictures' own, but at least 96.

    Raises:
        ValueError: If `images` has another shape or there is nothing in it.
    """
    if images.ndim != 5 or images.shape[2] != 3 or 0 in images.shape:
        raise ValueError(f"images must have shape (N, M, 3, H, W) with N, M >= 1, got {images.shape}")
    rows, columns, _, height, width = images.shape
    cell = size or max(96, height, width)
    text = 12 if cell <= 128 else min(28, max(14, cell // 18))
    line, gap, margin = round(text * 1.5), 4, 14
    left = min(260, max((_width(title, text) for title in row_titles), default=-10) + 10)
    head = round(line * 1.4) if title else 0
    top = head + (line if column_titles else 0)
    below = [line if captions and any(captions[i]) else 0 for i in range(rows)]
    tops = [margin + top + i * (cell + gap) + sum(below[:i]) for i in range(rows)]
    lefts = [margin + left + j * (cell + gap) for j in range(columns)]
    wide, high = lefts[-1] + cell + margin, tops[-1] + cell + below[-1] + margin
    sheet = Image.new("RGB", (wide, high), PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((margin, margin), shorten(title, wide - 2 * margin, text + 1), INK, font=font(text + 1), anchor="lt")
    for x, title in zip(lefts, column_titles, strict=False):
        place = x + cell / 2, margin + top - 6
        draw.text(place, shorten(title, cell, text), MUTED, font=font(text), anchor="ms")
    for i, y in enumerate(tops):
        if i < len(row_titles):
            title = shorten(row_titles[i], left - 10, text)
            draw.text((margin + left - 10, y + cell / 2), title, INK, font=font(text), anchor="rm")
        for j, x in enumerate(lefts):
            sheet.paste(_fit(images[i, j], cell), (x, y))
            draw.rectangle((x, y, x + cell - 1, y + cell - 1), outline=LINE)
            if below[i]:
                caption = shorten(captions[i][j], cell, text)
                draw.text((x + cell / 2, y + cell + line - 6), caption, MUTED, font=font(text), anchor="ms")
    return encode(sheet)


def reduced(image: Bytes, size: int) -> Bytes:
    """Scale a square picture (3, H, W) down to a side of `size`; a smaller one comes back as it is."""
    if image.shape[-1] <= size:
        return image
    picture = _picture(image).convert("RGB").resize((size, size), Image.Resampling.LANCZOS)
    return np.moveaxis(np.asarray(picture), -1, 0)


def shorten(title: str, width: float, size: int) -> str:
    """Take characters out of the middle of a text until it is not wider than `width` pixels."""
    if _width(title, size) <= width:
        return title
    for kept in range(len(title) - 1, 1, -1):
        short = title[: (kept + 1) // 2] + "…" + title[len(title) - kept // 2 :]
        if _width(short, size) <= width:
            return short
    return "…"


def _picture(image: Bytes) -> Image.Image:
    pixels = np.ascontiguousarray(np.moveaxis(image, 0, -1))
    grey = (pixels == pixels[..., :1]).all()
    return Image.fromarray(pixels[..., 0] if grey else pixels)


def _fit(image: Bytes, cell: int) -> Image.Image:
    """Scale a picture into a square cell; whole multiples keep the pixels sharp."""
    picture = _picture(image).convert("RGB")
    scale = cell / max(picture.size)
    if scale == 1:
        return picture
    smooth = Image.Resampling.LANCZOS if scale < 1 else Image.Resampling.BICUBIC
    method = Image.Resampling.NEAREST if scale >= 2 and scale == int(scale) else smooth
    return picture.resize((round(picture.width * scale), round(picture.height * scale)), method)


def encode(picture: Image.Image, words: PngInfo | None = None) -> bytes:
    """Turn a picture into PNG; `words` are texts that the file carries along."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", optimize=True, pnginfo=words)
    return buffer.getvalue()


@cache
def font(size: int) -> ImageFont.FreeTypeFont:
    """The font that matplotlib brings along: it has the degree sign, Greek and Cyrillic, on every machine."""
    import matplotlib

    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)


def _width(title: str, size: int) -> int:
    return int(np.ceil(font(size).getlength(title)))
