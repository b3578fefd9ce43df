"""What is stored is made once, comes out the same in any order and process, and counts are honest."""

from __future__ import annotations

import io
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toys import QUIET, SETTINGS, ReadBox, reads, toys, tree_bytes

from mvtn_cli.config import PreprocessConfig
from mvtn_cli.console import Console
from mvtn_cli.core.datasets import Dataset, open_dataset
from mvtn_cli.core.preprocess import Settings, mapping, prepare, preprocess
from mvtn_cli.core.shapes import Shape
from mvtn_cli.core.store import Store

TETRAHEDRON = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 2 0\n0 0 {height}\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"


def folder(root: Path, count: int = 6) -> Path:
    for number in range(count):
        path = root / ("ant", "bee")[number % 2] / ("train", "test")[number % 3 == 2] / f"{number}.off"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(TETRAHEDRON.format(height=number + 3))
    return root


def no_children_after(seconds: float) -> bool:
    """Wait for worker processes of this one to end; whatever else it started (resource trackers) may stay."""
    children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
    deadline = time.monotonic() + seconds
    while children.exists() and time.monotonic() < deadline:
        commands = [Path(f"/proc/{pid}/cmdline") for pid in children.read_text().split()]
        if not any(b"popen_loky" in path.read_bytes() for path in commands if path.exists()):
            return True
        time.sleep(0.05)
    return not children.exists()


def counts(summary) -> dict[str, int]:
    names = ("kept", "simplified", "mended", "rejected", "reused", "remade")
    return {name: getattr(summary, name) for name in names}


def test_a_stored_shape_is_normalised_and_can_be_taken_back_to_file_units(tmp_path):
    dataset = open_dataset(str(folder(tmp_path / "set")))
    prepared, _ = prepare(dataset, SETTINGS, Store(tmp_path / "s"), QUIET, workers=1)
    for index, record in enumerate(prepared.records):
        shape, original = prepared.load(index), dataset.items[index].read()
        assert np.abs(np.linalg.norm(shape.vertices, axis=1).max() - 1) < 1e-6
        assert np.abs(shape.vertices.max(axis=0) + shape.vertices.min(axis=0)).max() < 1e-6
        triangles = shape.vertices[shape.faces] * shape.radius + shape.center
        assert np.allclose(triangles, original.vertices[original.faces], atol=1e-5)
        assert np.allclose(np.linalg.norm(shape.normals, axis=1), 1, atol=1e-5)
        assert shape.points.shape == (32, 3)
        assert shape.points.dtype == shape.vertices.dtype == np.float32
        assert (np.abs(shape.points) <= np.abs(shape.vertices).max(axis=0) + 1e-6).all()
        assert np.isnan(record.known_azimuth_deg)
    assert prepared.split("train") + prepared.split("test") == sorted(
        range(6), key=lambda index: (prepared.records[index].split != "train", index)
    )


def test_a_second_run_reads_nothing_and_says_so(tmp_path, monkeypatch):
    dataset = open_dataset(str(folder(tmp_path / "set")))
    config = PreprocessConfig(cache=tmp_path / "cache", workers=1)
    first, summary = preprocess(dataset, config, QUIET)
    assert summary.reused == 0

    def forbidden(*_args, **_options):
        raise AssertionError("a file was opened")

    monkeypatch.setattr("mvtn_cli.core.datasets.files.read_shape", forbidden)
    monkeypatch.setattr("mvtn_cli.core.datasets.files.Path.read_bytes", forbidden)
    err = io.StringIO()
    monkeypatch.setattr("mvtn_cli.core.store.Store.read_with_notes", forbidden)
    monkeypatch.setattr("mvtn_cli.core.store.Store.read_index", _read_index)
    second, again = preprocess(open_dataset(str(tmp_path / "set")), config, Console(out=io.StringIO(), err=err))
    assert "nothing to do: 6 shapes are up to date" in err.getvalue()
    assert counts(again) == counts(summary) | {"reused": 6}
    assert repr(second.records) == repr(first.records)  # NaN is not equal to NaN
    assert second.address == first.address


def _read_index(self, name):
    import json

    path = self.index_path(name)
    return json.loads(path.open("rb").read()) if path.exists() else None


def test_without_its_index_the_store_alone_saves_the_work(tmp_path):
    dataset, log = toys(5, tmp_path / "log"), tmp_path / "log"
    store = Store(tmp_path / "s")
    first, _ = prepare(dataset, SETTINGS, store, QUIET, workers=1)
    for damage in (lambda: store.clear("datasets"), lambda: _spoil_index(store)):
        damage()
        second, summary = prepare(dataset, SETTINGS, store, QUIET, workers=1)
        assert reads(log) == 5
        assert summary.reused == 5
        assert second.address == first.address


def _spoil_index(store: Store) -> None:
    index = next((store.root / "datasets").glob("*.json"))
    index.write_text('{"entries": {"toy/0": 7, "toy/1": {"address": "x", "stored": null}, "toy/2": {}}}')


def test_one_worker_and_two_give_identical_bytes_in_the_same_order(tmp_path, monkeypatch):
    monkeypatch.setattr(mapping, "START_UP_S", 0.0)
    results = {}
    for workers in (1, 2):
        log = tmp_path / f"log{workers}"
        store = Store(tmp_path / f"s{workers}")
        prepared, summary = prepare(toys(40, log), SETTINGS, store, QUIET, workers=workers)
        assert reads(log) == 40
        results[workers] = (
            tree_bytes(store.root),
            repr(prepared.records),
            prepared.address,
            replace(summary, seconds=0),
        )
    assert results[1] == results[2]
    assert no_children_after(10), "worker processes were left behind"
    assert len(results[1][0]) == 40


def test_the_address_follows_content_and_settings_only(tmp_path):
    def address(**changed: int) -> str:
        return Settings(**(SETTINGS.as_dict() | changed)).address(b"content")

    others = [address(max_vertices=99), address(num_points=31), address(seed=1), SETTINGS.address(b"Content")]
    assert len({address(), *others}) == 5
    assert Settings.from_dict(SETTINGS.as_dict()) == SETTINGS


def test_equal_files_share_one_stored_shape(tmp_path):
    root = folder(tmp_path / "set")
    (root / "ant" / "train" / "copy.off").write_bytes((root / "ant" / "train" / "0.off").read_bytes())
    store = Store(tmp_path / "s")
    prepared, summary = prepare(open_dataset(str(root)), SETTINGS, store, QUIET, workers=1)
    assert (summary.kept, summary.reused) == (7, 1)
    assert len(tree_bytes(store.root)) == 6
    assert len({record.name for record in prepared.records}) == 7


def test_only_a_changed_file_is_made_again(tmp_path):
    root = folder(tmp_path / "set")
    store = Store(tmp_path / "s")
    before, _ = prepare(open_dataset(str(root)), SETTINGS, store, QUIET, workers=1)
    changed = root / "ant" / "train" / "0.off"
    changed.write_text(TETRAHEDRON.format(height=50))
    after, summary = prepare(open_dataset(str(root)), SETTINGS, store, QUIET, workers=1)
    assert summary.made == 1
    different = [one.name for one, other in zip(before.records, after.records, strict=True) if repr(one) != repr(other)]
    assert different == ["ant/0"]
    assert after.address != before.address
    os.utime(changed)  # a new time, the same bytes
    _, summary = prepare(open_dataset(str(root)), SETTINGS, store, QUIET, workers=1)
    assert summary.made == 0


@pytest.mark.parametrize("damage", ["cut", "flip", "delete"])
def test_a_damaged_stored_shape_is_made_again_and_said_so(tmp_path, damage):
    dataset, log = toys(4, tmp_path / "log"), tmp_path / "log"
    store = Store(tmp_path / "s")
    prepared, _ = prepare(dataset, SETTINGS, store, QUIET, workers=1)
    whole = tree_bytes(store.root)
    _damage(store.shape_path(prepared.records[2].address), damage)
    console = Console(quiet=True, err=io.StringIO())
    _, summary = prepare(dataset, SETTINGS, store, console, workers=1)
    assert tree_bytes(store.root) == whole
    assert reads(log) == 5
    assert (summary.kept, summary.reused) == (4, 3)
    assert summary.remade == len(console.warnings) == (0 if damage == "delete" else 1)


def _damage(path: Path, how: str) -> None:
    data = bytearray(path.read_bytes())
    if how == "delete":
        path.unlink()
        return
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data[:-30] if how == "cut" else data)


def test_a_shape_damaged_after_preprocessing_is_made_again_when_it_is_loaded(tmp_path):
    console = Console(quiet=True, err=io.StringIO())
    store = Store(tmp_path / "s")
    prepared, _ = prepare(toys(3, tmp_path / "log"), SETTINGS, store, console, workers=1)
    path = store.shape_path(prepared.records[1].address)
    whole = path.read_bytes()
    _damage(path, "flip")
    assert prepared.load(1).has_mesh
    assert path.read_bytes() == whole
    assert "toy/1" in console.warnings[0]
    assert prepared.load(1) is prepared.load(1)


@pytest.mark.parametrize("workers", [1, 2])
def test_bad_files_are_counted_named_and_never_stop_the_others(tmp_path, monkeypatch, workers):
    monkeypatch.setattr(mapping, "START_UP_S", 0.0)
    root = folder(tmp_path / "set")
    bad = {"empty": "", "text": "this is no mesh", "far": TETRAHEDRON.replace("3 1 2 3", "3 1 2 9")}
    bad |= {"nan": TETRAHEDRON.format(height="nan"), "flat": "OFF\n3 1 0\n0 0 0\n0 0 0\n0 0 0\n3 0 1 2\n"}
    for name, text in bad.items():
        (root / "ant" / "train" / f"{name}.off").write_text(text.format(height=3))
    dataset, store = open_dataset(str(root)), Store(tmp_path / "s")
    prepared, summary = prepare(dataset, SETTINGS, store, QUIET, workers=workers)
    rejected = {Path(found["file"]).stem for found in summary.findings if found["fatal"]}
    assert summary.kept + summary.rejected == len(dataset.items) == 11
    assert {"empty", "text", "flat"} <= rejected <= set(bad)
    assert summary.rejected == len(rejected)
    assert {record.name for record in prepared.records} == {
        item.name for item in dataset.items if Path(item.source).stem not in rejected
    }
    assert all("\n" not in found["finding"] and ": " in found["finding"] for found in summary.findings)
    _, again = prepare(dataset, SETTINGS, store, QUIET, workers=workers)
    assert counts(again) == counts(summary) | {"reused": summary.kept}
    assert again.findings == summary.findings


class Explode(ReadBox):
    """Fails as no reader should."""

    def __call__(self) -> Shape:
        if self.number == 1:
            raise ZeroDivisionError("a bug\nof two lines")
        return super().__call__()


def test_the_reason_names_the_line_and_a_set_of_bad_files_alone_is_called_that(tmp_path):
    (tmp_path / "bad.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 x\n3 0 1 2\n")
    err = io.StringIO()
    config = PreprocessConfig(cache=tmp_path / "cache", workers=1)
    for _ in range(2):
        _, summary = preprocess(open_dataset(str(tmp_path / "bad.off")), config, Console(out=io.StringIO(), err=err))
        assert [found["finding"] for found in summary.findings] == [
            "unreadable: line 5: 'x' is not a number; expected a vertex"
        ]
    assert err.getvalue() == "not one shape can be used: 1 rejected\n" * 2


def test_a_bug_in_a_reader_costs_one_file(tmp_path):
    prepared, summary = prepare(
        toys(3, tmp_path / "log", read=Explode), SETTINGS, Store(tmp_path / "s"), QUIET, workers=1
    )
    assert [record.name for record in prepared.records] == ["toy/0", "toy/2"]
    assert summary.findings == [
        {"file": "toy 1", "finding": "unexpected-error: ZeroDivisionError a bug of two lines", "fatal": True}
    ]


class Known(ReadBox):
    """Knows its best view."""

    def __call__(self) -> Shape:
        return replace(super().__call__(), known_azimuth_deg=10.0 * self.number)


def test_the_known_view_is_kept_also_when_nothing_is_made(tmp_path):
    dataset: Dataset = replace(toys(3, tmp_path / "log", read=Known), known_view=True)
    for _ in range(2):
        prepared, _ = prepare(dataset, SETTINGS, Store(tmp_path / "s"), QUIET, workers=1)
        assert [record.known_azimuth_deg for record in prepared.records] == [0.0, 10.0, 20.0]
        assert [prepared.load(index).known_azimuth_deg for index in range(3)] == [0.0, 10.0, 20.0]
        assert prepared.known_view


def test_a_simplified_mesh_is_reported_with_its_error_the_second_time_too(tmp_path, real_data):
    spec = str(real_data / "modelnet_off" / "bathtub_0003.off")
    store = Store(tmp_path / "s")
    settings = replace(SETTINGS, max_vertices=2000)
    for reused in (0, 1):
        prepared, summary = prepare(open_dataset(spec), settings, store, QUIET, workers=1)
        (row,) = summary.simplifications
        assert (summary.kept, summary.simplified, summary.reused) == (1, 1, reused)
        assert row["name"] == "bathtub_0003"
        places = np.unique(prepared.load(0).vertices, axis=0)  # at a crease there are several vertices at one place
        assert row["vertices_before"] > 2000 >= row["vertices_after"] == len(places)
        assert 0 < row["error_percent"] < 5
        assert row["seconds"] > 0
