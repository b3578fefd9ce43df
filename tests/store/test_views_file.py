"""Files of views: back bit for bit, and no damaged byte, foreign file or full disk goes unnoticed."""

from __future__ import annotations

from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mvtn_cli.core.store import Store, digest, views_file
from mvtn_cli.core.store.shape_file import DamagedFile
from mvtn_cli.core.store.views_file import decode, encode, read_views, views_path, write_views
from mvtn_cli.errors import MvtnError

ADDRESS, OTHER = digest("one"), digest("two")
ARRAYS = {
    "normals": np.array([[0.1, -0.0, np.nan], [1e-42, np.inf, 3.0]], np.float32),
    "covered": np.arange(7, dtype=np.uint8),
    "none": np.zeros((0, 3), np.float32),
    "rts": np.array([1.0, np.pi]),
}


def test_arrays_come_back_bit_for_bit_with_type_and_shape(tmp_path: Path):
    store = Store(tmp_path)
    write_views(store, ADDRESS, ARRAYS)
    back = read_views(store, ADDRESS)
    assert back is not None and back.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert (back[name].dtype, back[name].shape) == (array.dtype, array.shape)
        assert back[name].tobytes() == array.tobytes()


def test_a_missing_file_is_none(tmp_path: Path):
    assert read_views(Store(tmp_path), ADDRESS) is None


def test_the_same_arrays_give_the_same_bytes():
    assert encode(ADDRESS, ARRAYS) == encode(ADDRESS, ARRAYS)


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_every_changed_byte_is_noticed(data):
    whole = bytearray(encode(ADDRESS, ARRAYS))
    at = data.draw(st.integers(0, len(whole) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    with pytest.raises(DamagedFile):
        decode(ADDRESS, bytes(whole))


@settings(deadline=None, max_examples=30)
@given(st.floats(0, 0.999))
def test_a_file_that_is_cut_short_is_noticed(share):
    whole = encode(ADDRESS, ARRAYS)
    with pytest.raises(DamagedFile):
        decode(ADDRESS, whole[: int(share * len(whole))])


@pytest.mark.parametrize("foreign", [b"", b"hello", encode(OTHER, ARRAYS)], ids=["empty", "text", "of another address"])
def test_a_foreign_file_is_noticed(foreign, tmp_path: Path):
    store = Store(tmp_path)
    path = views_path(store, ADDRESS)
    path.parent.mkdir(parents=True)
    path.write_bytes(foreign)
    with pytest.raises(DamagedFile):
        read_views(store, ADDRESS)


def test_a_folder_in_the_place_of_a_file_is_noticed_and_not_written_over(tmp_path: Path):
    store = Store(tmp_path)
    views_path(store, ADDRESS).mkdir(parents=True)
    with pytest.raises(DamagedFile):
        read_views(store, ADDRESS)
    with pytest.raises(MvtnError, match="can't write"):
        write_views(store, ADDRESS, ARRAYS)


def test_views_are_counted_and_cleared_as_a_kind_of_their_own(tmp_path: Path):
    store = Store(tmp_path)
    write_views(store, ADDRESS, ARRAYS)
    assert store.sizes()["views"] == (1, len(encode(ADDRESS, ARRAYS)))
    assert store.clear("views")["views"].files == 1
    assert read_views(store, ADDRESS) is None and store.sizes()["views"].files == 0


def test_a_nearly_full_disk_is_left_alone(tmp_path: Path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(views_file.shutil, "disk_usage", lambda _: usage(1, 1, views_file.LEAVE_FREE))
    with pytest.raises(MvtnError, match="nearly full"):
        write_views(Store(tmp_path / "not there yet"), ADDRESS, ARRAYS)
    assert not list(tmp_path.rglob("*.npz"))
