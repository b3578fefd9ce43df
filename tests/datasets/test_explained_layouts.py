"""What `--explain-layout` shows, and that the page about data sets knows each of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from release_writers import core_v2, off_release, put, shapenet_rows, write_list
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.core.datasets import open_dataset
from mvtn_cli.core.datasets.layouts import LAYOUTS
from mvtn_cli.core.datasets.official import OFFICIAL
from mvtn_cli.core.datasets.opening import PREFIXES
from mvtn_cli.core.datasets.scanobjectnn import VARIANTS
from mvtn_cli.errors import DataError

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "datasets.md").read_text(encoding="utf-8")


def explain(*words: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["preprocess", "--explain-layout", *words])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_every_kind_of_data_set_has_a_layout():
    assert set(LAYOUTS) == set(PREFIXES)


def test_without_a_data_set_all_are_explained_and_nothing_is_done(tmp_path):
    for words in ((), ("all",)):
        code, out, err = explain(*words)
        assert code == 0 and "nothing is downloaded" in err
        for layout in LAYOUTS.values():
            assert layout.text() in out
            assert layout.source in out and layout.terms in out
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("spec", ["scanobjectnn", "scanobjectnn:PATH@hardest"])
def test_one_is_explained_by_its_word_whether_it_is_there_or_not(spec):
    code, out, _ = explain(spec)
    assert code == 0 and out == LAYOUTS["scanobjectnn"].text() + "\n"


def test_a_path_is_explained_by_what_is_in_it(tmp_path):
    rows = shapenet_rows()
    write_list(tmp_path / "shapes" / "all.csv", rows)
    core_v2(tmp_path / "shapes", rows)
    off_release(tmp_path / "net", {"bed": (1, 1)})
    put(tmp_path / "own" / "cat" / "1.off")
    words = {"shapes": "shapenet55", "net": "modelnet10", "own": "folder"}
    for name, word in words.items():
        assert explain(str(tmp_path / name))[1] == LAYOUTS[word].text() + "\n"


def test_a_wrong_word_gets_the_nearest_and_programs_get_a_document():
    code, _, err = explain("shapenet")
    assert code == 2 and "did you mean 'shapenet55'" in err
    document = json.loads(explain("modelnet10", "--json")[1])
    assert document["schema"] == "mvtn.layouts/1"
    (layout,) = document["layouts"]
    assert layout["spec"] == "modelnet10:PATH" and len(layout["trees"]) == 3
    assert all(tree.startswith("PATH/") for tree in layout["trees"].values())


@pytest.mark.parametrize("word", ["modelnet40", "modelnet10", "shapenet55", "scanobjectnn"])
def test_an_empty_folder_is_refused_with_where_people_get_the_set(tmp_path, word):
    with pytest.raises(DataError) as error:
        open_dataset(f"{word}:{tmp_path}")
    assert LAYOUTS[word].source in error.value.hint
    assert f"mvtn preprocess {word} --explain-layout" in error.value.hint


def test_layouts_state_the_official_sizes():
    for word in ("modelnet40", "modelnet10", "shapenet55"):
        for count in OFFICIAL[word].totals.values():
            assert f"{count:,}" in LAYOUTS[word].title
    for name in ("with_bg", "hardest"):
        for count in OFFICIAL[f"scanobjectnn-{name}"].totals.values():
            assert f"{count:,}" in LAYOUTS["scanobjectnn"].title


@pytest.mark.parametrize("word", LAYOUTS)
def test_the_page_has_a_section_for_each(word):
    assert f"\n## `{word}:" in PAGE


def test_the_page_states_sizes_variants_and_release_counts():
    for official in OFFICIAL.values():
        for count in official.totals.values():
            assert f"{count:,}" in PAGE
    for variant in VARIANTS:
        assert f"`@{variant}`" in PAGE
