from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from mvtn_cli.core.reporting.confusion import confusion_layout
from mvtn_cli.core.reporting.gather import gather, read_views, repeat_command
from mvtn_cli.core.reporting.report import write_report
from mvtn_cli.core.reporting.sections import picture_size
from mvtn_cli.errors import DataError

sys.path.insert(0, str(Path(__file__).parent))
from made_up import make_run

VOID = {"meta", "img", "link", "br", "hr", "input"}
CLASSES = ["chair", "sofa", "table", "lamp"]


class Page(HTMLParser):
    """Follows the tags: what is opened must be closed, in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        self.ids += [value for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def report(folder: Path, classes: list[str] = CLASSES, **more) -> tuple[Page, str]:
    text = write_report(make_run(folder, classes, size=24, **more)).read_text(encoding="utf-8")
    return Page(text), text


def test_the_page_is_one_file_that_asks_for_nothing(tmp_path):
    page, text = report(tmp_path / "run")
    assert "http://" not in text and "https://" not in text and "//cdn" not in text
    tags = {tag for tag, _, _ in page.attributes}
    assert not tags & {"link", "iframe", "object"} and "@import" not in text
    policy = [value for tag, name, value in page.attributes if tag == "meta" and name == "content"][1]
    assert policy.startswith("default-src 'none'; img-src data:;"), "a browser lets nothing be asked for"
    sources = [value for _, name, value in page.attributes if name in ("src", "href", "xlink:href", "srcset")]
    assert sources and all(value.startswith(("data:image/png;base64,", "#")) for value in sources)
    assert len(page.ids) == len(set(page.ids)), "two elements of one name"


def test_every_picture_is_described_and_every_name_is_defined(tmp_path):
    page, text = report(tmp_path / "run")
    images = sum(1 for tag, name, value in page.attributes if tag == "img" and name == "alt" and value)
    assert images == sum(1 for tag, name, _ in page.attributes if tag == "img" and name == "src") > 0
    used, defined = set(re.findall(r"var\(--(\w+)\)", text)), set(re.findall(r"--(\w+):", text))
    assert used <= defined
    dark = text[text.index("prefers-color-scheme: dark") :].split("}")[0]
    assert set(re.findall(r"--(\w+):", dark)) == defined - {"w", "c"}, "those two are set where they are used"


def test_names_with_markup_in_them_are_text(tmp_path):
    page, text = report(tmp_path / "run", ['<b>&"x"', "sofa", "<script>alert(1)</script>", "lamp"], skill=1.0)
    assert '<b>&"x"' in "".join(page.text) and "<script>alert" not in text
    assert '<b>&"' not in text and "&lt;b&gt;&amp;&#34;x&#34;" in text


def test_sections_are_there_only_with_their_data(tmp_path):
    ordinary, text = report(tmp_path / "ordinary")
    assert {"curves", "cameras", "viewer", "views", "confusion", "classes", "mistakes", "settings"} <= set(ordinary.ids)
    assert "known side" not in text
    _, text = report(tmp_path / "known", num_views=1, known=True)
    assert "known side" in text and "median view error" in text and "blind views" in text
    bare = make_run(tmp_path / "bare", CLASSES, skill=50.0)
    for name in ("metrics.jsonl", "config.toml", "views_best.npz", "views_start.npz", "views.csv", "shapes.npz"):
        (bare / name).unlink()
    page = Page(write_report(bare).read_text(encoding="utf-8"))
    assert set(page.ids) & {"curves", "cameras", "viewer", "views", "settings"} == set()
    assert "all 40 shapes were recognised" in "".join(page.text)


def test_fixed_views_are_shown_once_and_learned_ones_before_and_after(tmp_path):
    fixed, text = report(tmp_path / "fixed", learned=False, skill=50.0)
    assert "before and after" not in text and "the same for every shape" in text
    learned, _ = report(tmp_path / "learned", skill=50.0)
    pictures = [sum(tag == "img" and name == "src" for tag, name, _ in p.attributes) for p in (fixed, learned)]
    assert pictures == [8 * 6, 2 * 8 * 6]


def test_the_largest_report_stays_small(tmp_path):
    classes = [f"class {i}" for i in range(40)]
    folder = make_run(tmp_path / "run", classes, per_class=62, num_views=20, size=112, skill=2.0, analysis=True)
    noise = np.random.default_rng(0)
    for name in ("views_start.npz", "views_best.npz", "mistakes.npz"):
        with np.load(folder / name) as arrays:
            kept = dict(arrays)
        kept["images"] = noise.integers(0, 255, kept["images"].shape, dtype=np.uint8)  # the worst case of PNG
        np.savez(folder / name, **kept)
    assert len(gather(folder).cameras.names) > 2468, "as many as ModelNet40 has for testing"
    assert write_report(folder).stat().st_size < 6_000_000


def test_numbers_that_are_not_known_are_a_dash(tmp_path):
    folder = make_run(tmp_path / "run", [*CLASSES, "never seen"])
    result = json.loads((folder / "result.json").read_text())
    result["per_class"][-1] |= {"count": 0, "correct": 0, "accuracy": None, "confused_with": None}
    result["accuracy"] = result["class_accuracy"] = result["seconds"] = None
    result["accuracy_interval"] = [None, None]
    (folder / "result.json").write_text(json.dumps(result))
    words = " ".join(Page(write_report(folder).read_text(encoding="utf-8")).text).split()
    assert words.count("–") >= 4 and not {"nan", "None", "NaN", "nan°"} & set(words)


def test_the_same_run_gives_the_same_page(tmp_path):
    folder = make_run(tmp_path / "run", CLASSES, size=24)
    assert write_report(folder).read_bytes() == write_report(folder).read_bytes()


def test_a_run_without_an_evaluation_says_what_to_do(tmp_path):
    with pytest.raises(DataError, match="no evaluation") as caught:
        write_report(tmp_path)
    assert caught.value.hint.startswith("make one first: mvtn eval")


def test_a_cut_off_line_of_numbers_ends_them_and_a_broken_picture_file_is_none(tmp_path):
    folder = make_run(tmp_path / "run", CLASSES, epochs=3)
    with (folder / "metrics.jsonl").open("a") as stream:
        stream.write('{"epoch": 4, "train_lo')
    (folder / "views_best.npz").write_bytes((folder / "views_best.npz").read_bytes()[:200])
    found = gather(folder)
    assert len(found.epochs) == 3 and found.best is None and read_views(folder / "nothing.npz") is None
    Page(write_report(folder).read_text(encoding="utf-8"))


def test_the_command_to_repeat_a_run_names_what_differs_from_the_defaults():
    config = {"dataset": "folder:/a b", "seed": 0, "num_views": 6, "epochs": 7, "allow_no_gradient": True}
    assert repeat_command(config) == "mvtn train 'folder:/a b' --allow-no-gradient --epochs 7 --seed 0"


@pytest.mark.parametrize("count", [2, 12, 24, 40])
def test_the_confusion_matrix_fits_a_page_and_hides_nothing(count):
    matrix = np.random.default_rng(0).poisson(0.3, (count, count)) + 5 * np.eye(count, dtype=int)
    found = confusion_layout(matrix, [f"class {i}" for i in range(count)])
    assert sum(cell["count"] for cell in found["cells"]) == matrix.sum()
    assert found["width"] < 1044 and all(0.1 < cell["strength"] <= 0.9 for cell in found["cells"])
    assert sum(cell["right"] for cell in found["cells"]) == count


def test_a_network_of_points_has_a_report_without_cameras(tmp_path):
    folder = make_run(tmp_path / "run", ["a", "b"], per_class=3)
    for name in ("views.csv", "mistakes.npz", "views_best.npz", "views_start.npz"):
        (folder / name).unlink(missing_ok=True)
    result = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps({**result, "views": None, "known_view": None}))
    with (folder / "config.toml").open("a") as file:
        file.write('network = "dgcnn"\nencoder_points = 1024\n')
    page = write_report(folder).read_text()
    assert "DGCNN on 1024 points, without views" in page
    assert 'id="cameras"' not in page and 'id="views"' not in page


def test_the_report_says_which_turns_rotationnet_tries(tmp_path):
    folder = make_run(tmp_path / "run", ["a", "b"], per_class=3)
    result = json.loads((folder / "result.json").read_text())
    model = {"network": "rotationnet", "candidates": {"count": 6, "layout": "spherical"}}
    (folder / "result.json").write_text(json.dumps({**result, "model": model}))
    assert "RotationNet tries 6 turns of each shape: those of the spherical layout" in write_report(folder).read_text()


def test_the_view_analysis_says_what_was_found(tmp_path):
    page, text = report(tmp_path / "told", analysis=True, class_apart_deg=90, per_class=40)
    assert "view-analysis" in page.ids and "uses the label" in text
    assert "looking at the single shape helps" in text, "mean views were made much worse"
    assert "writes some of the class into its cameras" in text and "tell nothing of the class" not in text
    _, text = report(tmp_path / "blind", analysis=True, per_class=40)
    assert "tell nothing of the class" in text
    page, _ = report(tmp_path / "none")
    assert "view-analysis" not in page.ids


def test_a_view_analysis_that_was_skipped_is_one_sentence(tmp_path):
    folder = make_run(tmp_path / "run", ["a", "b"], per_class=3)
    result = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps({**result, "view_analysis": {"skipped": "There are none."}}))
    page = Page(write_report(folder).read_text())
    assert "view-analysis" in page.ids and "There are none." in "".join(page.text)


def test_a_view_analysis_without_numbers_has_no_nan_in_it(tmp_path):
    folder = make_run(tmp_path / "run", CLASSES, analysis=True, learned=False)
    result = json.loads((folder / "result.json").read_text())
    assert result["view_analysis"]["spread"]["explained"] is None, "fixed views: nothing to explain"
    text = "".join(Page(write_report(folder).read_text()).text)
    assert "all have practically the same ones" in text and "nan" not in text.lower().split()


def test_pictures_are_as_large_as_the_page_allows(tmp_path):
    findings = gather(make_run(tmp_path / "run", CLASSES, size=200, skill=2.0))
    assert picture_size(findings) == 224 and picture_size(replace(findings, best=None)) == 224
    noise = np.random.default_rng(0).integers(0, 255, findings.best.images.shape, dtype=np.uint8)
    assert picture_size(replace(findings, best=replace(findings.best, images=noise))) == 112
    assert picture_size(replace(findings, best=None, mistakes=None)) == 112
