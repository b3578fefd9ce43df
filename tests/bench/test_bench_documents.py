"""What is written, compared and plotted, from made-up rows."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import pytest

from mvtn_cli.console import plain
from mvtn_cli.core.bench.compare import FIGURES, KEYS, compare, ratio, read_document
from mvtn_cli.core.bench.document import SCHEMA, cpu_name, document, write_csv
from mvtn_cli.core.bench.outcome import Outcome
from mvtn_cli.core.bench.peers import why_omitted
from mvtn_cli.core.bench.plan import QUICK, WORDS, Plan, departures, plan_for
from mvtn_cli.core.bench.plot import Point, check_plot, draw_plot, points_of
from mvtn_cli.core.bench.timing import interleaved
from mvtn_cli.errors import DataError, UsageError


def row(mode: str = "edge-flow", l2: float = 0.05, **more: Any) -> dict[str, Any]:
    return {
        "mesh": "mean",
        "faces": None,
        "shading": "smooth",
        "weights": "smooth",
        "mode": mode,
        "cosine": 0.99,
        "G": 0.99,
        "l2": l2,
        "seconds": 0.1,
        "truth_cosine": 1.0,
        "truth_l2": 0.01,
        **more,
    }


def written(path: Path, **changes: Any) -> Path:
    content = {"schema": SCHEMA, "what": "gradient", "command": "mvtn bench", "rows": [row()], "summary": {}} | changes
    path.write_text(json.dumps(content))
    return path


def test_a_document_says_what_was_measured_where_and_with_what():
    outcome = Outcome([row()], {"cosine_mean": 0.99}, {"truth": "fine"}, ({"what": "x", "reason": "y"},))
    whole = document("gradient", outcome, plan_for("gradient", quick=True, seed=3), "mvtn bench gradient", 1.5)
    assert set(whole) >= {*("schema", "what", "command", "seed", "machine", "versions", "rows", "summary", "reduced")}
    assert (whole["schema"], whole["what"], whole["seed"], whole["truth"]) == (SCHEMA, "gradient", 3, "fine")
    assert set(whole["machine"]) >= {"cpu", "cores", "threads"} and whole["machine"]["cores"] >= 1
    assert set(whole["versions"]) >= {"mvtn", "python", "torch", "numba"}
    named = [omitted["what"] for omitted in whole["omitted"]]
    assert named == ["x", "pytorch3d", "mitsuba", "nvdiffrast"] and all(o["reason"] for o in whole["omitted"])
    assert json.loads(json.dumps(plain(whole)))["rows"] == [row()]


def test_a_quick_plan_says_all_that_it_reduces_and_the_full_one_nothing():
    for what, changes in QUICK.items():
        assert departures(what, plan_for(what)) == []
        assert len(departures(what, plan_for(what, quick=True))) == len(changes)
    assert departures("pose", plan_for("pose", image_size=32)) == ["pixels along each side: 32 (full: 224)"]
    assert set(WORDS) | {"look", "seed", "work"} == set(Plan.__dataclass_fields__)


def test_csv_has_one_header_and_empty_cells_for_what_is_missing(tmp_path):
    path = tmp_path / "new" / "rows.csv"
    write_csv(path, [{"mesh": "a, b", "l2": 0.5, "faces": None}, {"mesh": "c", "l2": math.nan, "more": True}])
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["mesh", "l2", "faces", "more"]
    assert rows == [["a, b", "0.5", "", ""], ["c", "", "", "true"]]


def test_the_processor_is_read_from_its_listing(tmp_path):
    listing = tmp_path / "cpuinfo"
    listing.write_text("processor\t: 0\nmodel name\t: Abacus 9 @ 2 beads\n")
    assert cpu_name(listing) == "Abacus 9 @ 2 beads"
    assert cpu_name(tmp_path / "missing")


def test_a_peer_is_omitted_with_its_reason(tmp_path, monkeypatch):
    (tmp_path / "peer_that_breaks.py").write_text("raise RuntimeError('built for another torch')")
    (tmp_path / "peer_that_works.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    assert why_omitted("peer_that_is_missing") == "can't be imported: No module named 'peer_that_is_missing'"
    assert "built for another torch" in why_omitted("peer_that_breaks")
    assert "can't drive it yet" in why_omitted("peer_that_works")


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [(2, 3, 1.5), (0, 0, 1.0), (0, 1, None), (None, 1, None), (1, math.nan, None), (True, 1, None), (2, 0, 0.0)],
)
def test_a_ratio_is_b_over_a_where_there_is_one(a, b, expected):
    assert ratio(a, b) == expected


def test_comparison_joins_rows_by_name_and_keeps_those_of_one_side():
    a = {"what": "gradient", "rows": [row(), row("fd", 0.2)], "summary": {"l2_mean": 0.05, "default_mode": "fd"}}
    b = {"what": "gradient", "rows": [row(l2=0.1), row("new")], "summary": {"l2_mean": 0.1}}
    found = {(line["row"], line["figure"]): (line["a"], line["b"], line["ratio"]) for line in compare(a, b)}
    assert found["mean smooth smooth edge-flow", "l2"] == (0.05, 0.1, 2.0)
    assert found["mean smooth smooth fd", "l2"] == (0.2, None, None)
    assert found["mean smooth smooth new", "l2"] == (None, 0.05, None)
    assert found["summary", "l2_mean"] == (0.05, 0.1, 2.0)
    assert ("summary", "default_mode") not in found
    assert len(found) == 3 * len(FIGURES["gradient"]) + 1


def test_every_benchmark_can_be_compared():
    assert set(KEYS) == set(FIGURES) == set(QUICK)


def test_comparison_refuses_different_benchmarks():
    with pytest.raises(DataError, match="one is about gradient, the other about pose"):
        compare({"what": "gradient", "rows": []}, {"what": "pose", "rows": []})


@pytest.mark.parametrize("content", ["", "[]", '{"schema": "mvtn.eval/1"}', "\xff", '{"schema": "mvtn.bench/1"}'])
def test_comparison_refuses_files_that_are_something_else(content, tmp_path):
    path = tmp_path / "x.json"
    path.write_text(content, encoding="latin-1")
    with pytest.raises(DataError) as caught:
        read_document(path)
    assert str(path) in caught.value.message and caught.value.hint


def test_comparison_reads_what_was_written(tmp_path):
    assert read_document(written(tmp_path / "a.json"))["rows"] == [row()]
    with pytest.raises(DataError, match="can't be read"):
        read_document(tmp_path / "missing.json")


def test_a_plot_of_something_without_error_or_of_an_unknown_kind_is_refused_before_the_work():
    check_plot("gradient", Path("a.svg"))
    for what, name in (("render", "a.svg"), ("stiff", "a.png"), ("gradient", "a.gif"), ("pose", "a")):
        with pytest.raises(UsageError):
            check_plot(what, Path(name))


def test_points_of_a_gradient_are_the_means_with_failures_named_and_the_widest_band():
    rows = [row(), row("fd", 1.2, truth_l2=0.03), row("shading", math.nan), row(mesh="chair")]
    points, bands, error = points_of("gradient", rows)
    assert [(point.setting, bool(point.failed)) for point in points] == [
        *(("edge-flow", False), ("fd", True), ("shading", True))
    ]
    assert bands == {"smooth weights": 0.03} and "L2" in error


def test_clouds_are_plotted_by_radius_with_a_band_of_their_own():
    rows = [row(), row("exact", shading="points 0.03", truth_l2=0.5), row("exact", shading="points 0.006")]
    points, bands, _ = points_of("gradient", rows)
    assert [(point.group, point.setting) for point in points] == [
        ("smooth weights", "edge-flow"),
        ("smooth weights, points", "points 0.03"),
        ("smooth weights, points", "points 0.006"),
    ]
    assert bands == {"smooth weights": 0.01, "smooth weights, points": 0.5}


def test_points_of_a_pose_fail_where_a_view_was_missed():
    base = {"mode": "fd", "seconds": 1.0, "median_deg": 0.2, "of": 12}
    points, bands, _ = points_of(
        "pose", [base | {"mesh": "a", "within_1deg": 12}, base | {"mesh": "b", "within_1deg": 10}]
    )
    assert [point.failed for point in points] == ["", "2 missed"] and bands == {}


@pytest.mark.parametrize("suffix", [".svg", ".png"])
def test_a_plot_names_each_setting_and_each_failing_point(suffix, tmp_path):
    points = [
        Point("smooth", "edge-flow", 0.1, 0.05),
        Point("smooth", "fd", 0.4, 0.2, hollow=True),
        Point("white", "shading", 0.1, math.nan, failed="no better than no gradient"),
    ]
    path = tmp_path / f"plot{suffix}"
    draw_plot(path, points, {"smooth": 0.01, "white": math.nan}, "relative L2", "a title")
    data = path.read_bytes()
    assert data.startswith(b"\x89PNG" if suffix == ".png" else b"<?xml")
    if suffix == ".svg":
        text = data.decode()
        for words in ("edge-flow", "fd", "white shading: no better than no gradient", "a title", "relative L2"):
            assert words in text
        draw_plot(path, points, {"smooth": 0.01, "white": math.nan}, "relative L2", "a title")
        assert path.read_bytes() == data


def test_interleaved_timing_goes_round_and_keeps_the_first_call_apart():
    calls: list[str] = []
    timings = interleaved({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, repeats=3)
    assert calls == ["a", "b"] * 4
    assert all(len(timing.seconds) == 3 and timing.median > 0 and timing.first > 0 for timing in timings.values())
