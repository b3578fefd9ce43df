"""`mvtn bench skips`: what it counts and whether it says truly that nothing changes, at tiny sizes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from mvtn_cli.app import app
from mvtn_cli.console import Console
from mvtn_cli.core.bench import skips as room
from mvtn_cli.core.bench.plan import Plan, departures, plan_for
from mvtn_cli.core.bench.skips import SKIPS, extra_subjects, layers, measure_skips, stage_for
from mvtn_cli.core.bench.subjects import Subject, builtin_subjects
from mvtn_cli.core.render.skips import EVERYTHING, without
from mvtn_cli.core.render.tally import tally

TINY = Plan(image_size=32, num_views=4, repeats=1)
BOX = """OFF
8 12 0
0 0 0
1 0 0
1 1 0
0 1 0
0 0 2
1 0 2
1 1 2
0 1 2
3 0 2 1
3 0 3 2
3 4 5 6
3 4 6 7
3 0 1 5
3 0 5 4
3 2 3 7
3 2 7 6
3 0 4 7
3 0 7 3
3 1 2 6
3 1 6 5
"""


@pytest.fixture(scope="module")
def chair() -> Subject:
    return builtin_subjects(2)[1]


@pytest.fixture(scope="module")
def rows(chair: Subject) -> dict[str, room.Row]:
    return {row["skip"]: row for row in measure_skips([chair], TINY, Console(quiet=True)).rows}


def test_each_skip_has_a_row(rows, chair):
    assert tuple(rows) == SKIPS
    assert all((row["mesh"], row["faces"]) == ("chair", chair.faces) for row in rows.values())


def test_shares_are_of_what_there_is_and_ratios_are_of_the_seconds(rows):
    for row in rows.values():
        assert row["ratio"] == row["seconds"] / row["seconds_off"] > 0
        if row["left_out"] is None:
            assert row["of"] is row["share"] is None
        else:
            assert row["share"] == row["left_out"] / row["of"] and 0 <= row["share"] <= 1


def test_the_scene_of_a_skip_gives_it_something_to_leave_out(rows, chair):
    for name in ("frustum", "background", "near-clip"):
        assert rows[name]["left_out"] > 0, name
    assert rows["near-clip"]["of"] == 4 * chair.faces and rows["background"]["of"] == 4 * 32 * 32
    assert (rows["same-view"]["left_out"], rows["same-view"]["of"]) == (2, 4)
    assert (rows["no-gradient"]["left_out"], rows["no-gradient"]["of"]) == (2, 4)
    assert (rows["fixed-views"]["left_out"], rows["fixed-views"]["of"]) == (4, 4)


def test_counts_are_those_of_one_call_whatever_was_counted_before(chair):
    plan = replace(TINY, repeats=2)
    tally().count("near-clip", 7, 1000)
    again = {row["skip"]: row for row in measure_skips([chair], plan, Console(quiet=True)).rows}
    assert again["near-clip"]["of"] == 4 * chair.faces


def test_what_changes_is_said_and_counted(monkeypatch, chair):
    """A skip that leaves out what is needed: here the whole shape."""
    step = room.Stage.step

    def spoiled(self: room.Stage, skips: int):
        images, gradient = step(self, skips)
        return (images * 0, gradient) if skips == without(["frustum"]) else (images, gradient)

    monkeypatch.setattr(room.Stage, "step", spoiled)
    outcome = measure_skips([chair], TINY, Console(quiet=True))
    row = next(row for row in outcome.rows if row["skip"] == "frustum")
    covered = (step(stage_for("frustum", chair, TINY), EVERYTHING)[0] != 0).any(dim=2).sum()
    assert not row["identical"] and row["pixels_differ"] == covered > 0
    others = {row["skip"] for row in outcome.rows if not row["identical"]} - {"frustum"}
    assert others <= {"backface"}
    assert outcome.summary == {"skips": len(SKIPS), "identical": len(SKIPS) - 1 - len(others)}


def test_one_view_is_enough(chair):
    outcome = measure_skips([chair], replace(TINY, num_views=1), Console(quiet=True))
    found = {row["skip"]: row for row in outcome.rows}
    assert found["same-view"]["left_out"] == 0 and found["no-gradient"]["left_out"] == 1


def test_views_that_occur_twice_are_bit_equal_cameras(chair):
    azimuth = stage_for("same-view", chair, replace(TINY, num_views=5)).cameras.azimuth_deg[0]
    assert len(azimuth) == 5 and len(torch.unique(azimuth)) == 3


def test_the_extra_meshes_give_backface_and_occluded_something_to_leave_out():
    ball, sheets = extra_subjects()
    for subject, name in ((ball, "backface"), (sheets, "occluded")):
        before = tally().left_out[name]
        stage_for(name, subject, replace(TINY, image_size=128)).step(EVERYTHING)
        assert tally().left_out[name] > before
    assert sheets.faces == 36_982


def test_layers_are_as_many_sheets_of_as_many_squares():
    subject = layers(count=2, side=3)
    assert subject.faces == 2 * 4 * 2
    assert np.isfinite(subject.shape.vertices).all()


def test_a_quick_plan_says_what_it_reduces():
    assert departures("skips", plan_for("skips")) == []
    assert "views: 4 (full: 12)" in departures("skips", plan_for("skips", quick=True))


def mvtn(*words: object):
    return CliRunner().invoke(app, ["bench", "skips", *map(str, words)])


def test_the_command_answers_with_a_document(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.off").write_text(BOX)
    result = mvtn("--mesh", "box.off", "--quick", "--image-size", 32, "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["summary"]["skips"] == len(SKIPS) == len(document["rows"])
    assert 0 <= document["summary"]["identical"] <= len(SKIPS)
    backface = next(row for row in document["rows"] if row["skip"] == "backface")
    assert backface["left_out"] > 0  # a closed box, read from a file


def test_a_plot_is_refused_in_one_sentence():
    result = mvtn("--plot", "a.svg")
    assert (result.exit_code, result.stdout) == (2, "")
    message = "error: `bench skips` measures no error that could be plotted against time"
    assert result.stderr.splitlines()[0] == message
