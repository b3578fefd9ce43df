"""The door for every other command: a named data set, the last one, or the built-in one; and single files."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from toys import QUIET

from mvtn_cli.config import PreprocessConfig
from mvtn_cli.console import Console
from mvtn_cli.core.datasets import open_dataset
from mvtn_cli.core.preprocess import choose_dataset, open_prepared, prepare_files, preprocess
from mvtn_cli.core.preprocess.prepared import ShapeMemory
from mvtn_cli.errors import DataError, UsageError

TETRAHEDRON = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 2 0\n0 0 3\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"


class AnyConfig:
    """A config of another command, which knows nothing of preprocessing."""

    cache = None
    workers = 1


def tiny_set(root: Path, *extra: str) -> str:
    for name in ("ant/train/1", "ant/test/2", "bee/train/3", "bee/test/4", *extra):
        path = root / f"{name}.off"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(TETRAHEDRON + f"# {name}\n")
    return str(root)


def listening() -> Console:
    return Console(out=io.StringIO(), err=io.StringIO())


def test_the_last_set_preprocessed_in_a_folder_is_taken_with_its_settings_and_said(tmp_path, monkeypatch):
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    one, two = tiny_set(tmp_path / "one"), tiny_set(tmp_path / "two")
    monkeypatch.chdir(tmp_path / "here")
    preprocess(open_dataset(one), PreprocessConfig(num_points=16, workers=1), QUIET)
    monkeypatch.chdir(tmp_path / "there")
    preprocess(open_dataset(two), PreprocessConfig(num_points=17, workers=1), QUIET)
    for folder, spec, points in (("here", one, 16), ("there", two, 17)):
        monkeypatch.chdir(tmp_path / folder)
        console = listening()
        prepared = open_prepared(None, AnyConfig(), console)
        assert prepared.spec == open_dataset(spec).spec
        assert prepared.load(0).points.shape == (points, 3)
        assert f"{prepared.spec} (the last one" in console.err.getvalue()
    assert open_prepared(one, AnyConfig(), QUIET).load(0).points.shape == (2048, 3)  # not this folder's last
    assert open_prepared(one, PreprocessConfig(num_points=18), QUIET).load(0).points.shape == (18, 3)


def test_without_any_the_built_in_set_is_taken_and_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    console = listening()
    assert choose_dataset(None, AnyConfig(), console) == "builtin:shapes"
    assert "none was named" in console.err.getvalue()
    assert choose_dataset("folder:x", AnyConfig(), console) == "folder:x"


def test_a_set_that_is_not_stored_yet_is_preprocessed_and_said(tmp_path):
    spec, console = tiny_set(tmp_path / "set"), listening()
    first = open_prepared(spec, AnyConfig(), console)
    assert "4 shapes made" in console.err.getvalue()
    silent = listening()
    second = open_prepared(spec, AnyConfig(), silent)
    assert silent.err.getvalue() == ""
    assert second.address == first.address
    assert second.classes == ("ant", "bee")


def test_a_spec_relative_to_this_folder_opens_from_any_other(tmp_path, monkeypatch):
    tiny_set(tmp_path / "set")
    monkeypatch.chdir(tmp_path)
    here = open_prepared("set", AnyConfig(), QUIET)
    monkeypatch.chdir(tmp_path / "set")
    assert open_prepared(here.spec, AnyConfig(), QUIET).address == here.address


def test_bad_shapes_are_left_out_with_a_warning_and_a_set_of_bad_ones_is_refused(tmp_path):
    spec = tiny_set(tmp_path / "set")
    (tmp_path / "set" / "ant" / "train" / "bad.off").write_text("nonsense")
    console = Console(quiet=True, err=io.StringIO())
    assert len(open_prepared(spec, AnyConfig(), console)) == 4
    assert "1 of 5 shapes can't be used" in console.warnings[0]
    for path in (tmp_path / "set").rglob("*.off"):
        path.write_text("nonsense")
    with pytest.raises(DataError, match=r"none of the 5 shapes .*2\.off: unreadable: "):
        open_prepared(spec, AnyConfig(), QUIET)


def test_single_files_are_prepared_without_labels_and_bad_ones_reported(tmp_path):
    tiny_set(tmp_path / "set")
    bad = tmp_path / "bad.off"
    bad.write_text("nonsense")
    files = [tmp_path / "set" / "bee" / "test" / "4.off", bad, tmp_path / "set" / "ant" / "train" / "1.off"]
    prepared, summary = prepare_files(files, AnyConfig(), QUIET)
    assert [record.source for record in prepared.records] == [str(files[0]), str(files[2])]
    assert {record.label for record in prepared.records} == {-1}
    assert (summary.kept, summary.rejected) == (2, 1)
    assert summary.findings[0]["file"] == str(bad)
    assert prepare_files(files, AnyConfig(), QUIET)[1].reused == 2
    with pytest.raises(DataError, match="no such file"):
        prepare_files([tmp_path / "set" / "none.off"], AnyConfig(), QUIET)
    with pytest.raises(UsageError, match="no file"):
        prepare_files([], AnyConfig(), QUIET)


def test_loaded_shapes_are_kept_up_to_a_budget(tmp_path):
    prepared = open_prepared(tiny_set(tmp_path / "set"), AnyConfig(), QUIET)
    shapes = [prepared.load(index) for index in range(4)]
    assert all(prepared.load(index) is shape for index, shape in enumerate(shapes))
    memory = ShapeMemory(budget=2 * shapes[0].nbytes)
    for number, shape in enumerate(shapes):
        memory.keep(str(number), shape)
    assert list(memory.shapes) == ["0", "1"]
    assert memory.used <= memory.budget
