"""The store keeps shapes bit for bit, notices every damaged byte, and survives many writers."""

from __future__ import annotations

import multiprocessing
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mvtn_cli.core.store import KINDS, Store, StoredShape, cache_root, digest, shape_file
from mvtn_cli.errors import MvtnError, UsageError

ADDRESS = digest("one")


def stored(seed: int = 0, *, vertices: int = 5, colors: bool = True) -> StoredShape:
    rng = np.random.default_rng(seed)
    return StoredShape(
        vertices=rng.normal(size=(vertices, 3)).astype(np.float32),
        faces=rng.integers(0, max(vertices, 1), size=(vertices, 3)).astype(np.int32),
        normals=rng.normal(size=(vertices, 3)).astype(np.float32),
        colors=rng.random((vertices, 3), dtype=np.float32) if colors else None,
        points=rng.normal(size=(7, 3)).astype(np.float32),
        point_colors=None,
        center=rng.normal(size=3) * 1e8,
        radius=float(rng.random()),
    )


def same(one: StoredShape, other: StoredShape) -> bool:
    for field in fields(StoredShape):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if (a is None) != (b is None):
            return False
        if a is not None and (np.asarray(a).dtype != np.asarray(b).dtype or np.shape(a) != np.shape(b)):
            return False
        if a is not None and np.asarray(a).tobytes() != np.asarray(b).tobytes():
            return False
    return True


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32), st.integers(0, 20), st.booleans(), st.dictionaries(st.text(), st.integers()))
def test_a_shape_and_its_notes_come_back_bit_for_bit(seed, vertices, colors, notes):
    shape = stored(seed, vertices=vertices, colors=colors)
    back, notes_back = shape_file.decode(ADDRESS, shape_file.encode(ADDRESS, shape, notes))
    assert same(back, shape)
    assert notes_back == notes


def test_a_point_cloud_has_no_mesh_and_a_missing_shape_is_none(tmp_path):
    store = Store(tmp_path)
    assert store.read(ADDRESS) is None
    store.write(ADDRESS, stored(vertices=0, colors=False))
    cloud = store.read(ADDRESS)
    assert cloud is not None
    assert not cloud.has_mesh
    assert cloud.vertices.shape == (0, 3)


def test_every_flipped_byte_and_every_cut_is_noticed(tmp_path):
    store = Store(tmp_path)
    store.write(ADDRESS, stored())
    path = store.shape_path(ADDRESS)
    whole = path.read_bytes()
    for position in range(0, len(whole), 7):
        damaged = bytearray(whole)
        damaged[position] ^= 0x10
        path.write_bytes(damaged)
        assert store.read(ADDRESS) is None, position
    for length in range(0, len(whole), 97):
        path.write_bytes(whole[:length])
        assert store.read(ADDRESS) is None, length


def test_a_stored_shape_is_a_plain_npz_for_everybody_else(tmp_path):
    store, shape = Store(tmp_path), stored()
    store.write(ADDRESS, shape)
    with np.load(store.shape_path(ADDRESS)) as archive:
        assert np.array_equal(archive["vertices"], shape.vertices)


def test_a_whole_file_under_the_address_of_another_does_not_verify(tmp_path):
    store, other = Store(tmp_path), digest("two")
    store.write(ADDRESS, stored())
    store.shape_path(other).parent.mkdir(parents=True)
    store.shape_path(ADDRESS).rename(store.shape_path(other))
    assert store.read(other) is None


def test_addresses_depend_on_every_part_and_on_where_one_ends():
    parts = [("ab", "c"), ("a", "bc"), ("abc",), ("abc", ""), ("", "abc"), ("ab", b"d")]
    assert len({digest(*part) for part in parts}) == len(parts)
    assert digest("ab", "c") == digest(b"ab", b"c")


def test_the_same_shape_gives_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        Store(tmp_path / name).write(ADDRESS, stored(), {"b": 1, "a": 2})
    one, two = (Store(tmp_path / name).shape_path(ADDRESS).read_bytes() for name in ("one", "two"))
    assert one == two


def test_writing_leaves_nothing_else_behind(tmp_path):
    store = Store(tmp_path)
    store.write(ADDRESS, stored())
    assert [path.name for path in store.shape_path(ADDRESS).parent.iterdir()] == [f"{ADDRESS}.npz"]


def _write_many(root: Path, seed: int) -> None:
    store = Store(root)
    for _ in range(30):
        for number in range(3):
            address = digest(str(number))
            store.write(address, replace(stored(number), known_azimuth_deg=float(number)))
            found = store.read(address)
            assert found is not None
            assert found.known_azimuth_deg == number


def test_writers_in_several_processes_never_show_each_other_half_a_file(tmp_path):
    context = multiprocessing.get_context("fork")
    writers = [context.Process(target=_write_many, args=(tmp_path, seed)) for seed in range(3)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0, 0]


def test_a_lock_keeps_a_second_process_out_until_the_first_is_done(tmp_path):
    store, context = Store(tmp_path), multiprocessing.get_context("fork")
    entered = context.Event()
    second = context.Process(target=_enter, args=(tmp_path, entered))
    with store.lock(ADDRESS):
        second.start()
        assert not entered.wait(0.3)
    assert entered.wait(10)
    second.join()


def _enter(root: Path, entered) -> None:
    with Store(root).lock(ADDRESS):
        entered.set()


def test_an_index_that_is_not_json_is_as_good_as_none(tmp_path):
    store = Store(tmp_path)
    store.write_index("last/abc", {"spec": "folder:/Ж"})
    assert store.read_index("last/abc") == {"spec": "folder:/Ж"}
    for text in (b"", b"{", b"[1]", b"\xff\xfe", b"null"):
        store.index_path("last/abc").write_bytes(text)
        assert store.read_index("last/abc") is None


def test_sizes_count_files_and_bytes_and_clear_removes_one_kind_only(tmp_path):
    store = Store(tmp_path)
    store.write(ADDRESS, stored())
    store.write_index("abc", {"a": 1})
    sizes = store.sizes()
    assert set(sizes) == set(KINDS)
    assert sizes["shapes"] == (1, store.shape_path(ADDRESS).stat().st_size)
    assert sizes["datasets"] == (1, len(b'{"a": 1}'))
    assert store.clear("shapes") == {"shapes": sizes["shapes"]}
    assert store.read(ADDRESS) is None
    assert store.read_index("abc") == {"a": 1}
    store.clear()
    assert all(size == (0, 0) for size in store.sizes().values())


def test_an_unknown_kind_gets_the_nearest_one(tmp_path):
    with pytest.raises(UsageError, match="did you mean 'shapes'"):
        Store(tmp_path).clear("shape")


def test_a_store_that_cannot_be_written_says_so(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(MvtnError, match="can't write") as error:
        Store(blocked).write(ADDRESS, stored())
    assert "--cache" in error.value.hint


def test_the_option_beats_the_environment_which_beats_the_users_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("MVTN_CACHE", str(tmp_path / "env"))
    assert cache_root(tmp_path / "option") == tmp_path / "option"
    assert cache_root(None) == tmp_path / "env"
    monkeypatch.delenv("MVTN_CACHE")
    assert cache_root(None).is_absolute()
    assert "mvtn" in cache_root(None).parts[-1]
