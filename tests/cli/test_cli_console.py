"""The two streams and the three modes."""

from __future__ import annotations

import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mvtn_cli.console import Console, counted, dumps, duration, plain

COLOUR = re.compile(r"\x1b\[(?:\d+;)*3[0-7]m|\x1b\[(?:\d+;)*38;")


class Terminal(io.StringIO):
    """A stream that a person reads."""

    def isatty(self) -> bool:
        return True


def make(mode: str = "text", terminal: bool = False, quiet: bool = False) -> tuple[Console, io.StringIO, io.StringIO]:
    out, err = io.StringIO(), Terminal() if terminal else io.StringIO()
    return Console(out, err, mode=mode, quiet=quiet), out, err  # type: ignore[arg-type]


def test_answers_go_to_stdout_and_narration_to_stderr():
    console, out, err = make()
    console.note("working")
    console.warn("odd")
    console.record({"a": 1}, "a line")
    console.result({"b": 2}, "the end")
    assert out.getvalue() == "a line\nthe end\n"
    assert err.getvalue() == "working\nwarning: odd\n"


def test_quiet_leaves_answers_and_warnings():
    console, out, err = make(quiet=True)
    console.note("working")
    console.table("t", ["a"], [(1,)])
    with console.progress("p", 2) as ticker:
        ticker.advance(2)
    console.warn("odd")
    console.result({}, "the end")
    assert out.getvalue() == "the end\n"
    assert err.getvalue() == "warning: odd\n"


def test_json_is_one_document_with_records_and_warnings():
    console, out, _ = make("json")
    console.record({"file": "a"}, "a")
    console.warn("odd")
    console.result({"x": 1}, "text", records="files")
    assert json.loads(out.getvalue()) == {"x": 1, "warnings": ["odd"], "files": [{"file": "a"}]}


def test_jsonl_streams_each_record_at_once_and_adds_nothing():
    console, out, _ = make("jsonl")
    console.record({"file": "a"}, "a")
    assert json.loads(out.getvalue()) == {"file": "a"}
    console.record({"file": "b"}, "b")
    console.result({"x": 1}, "text", records="files")
    assert [json.loads(line)["file"] for line in out.getvalue().splitlines()] == ["a", "b"]


def test_jsonl_without_records_is_the_document_on_one_line():
    console, out, _ = make("jsonl")
    console.result({"x": [1, 2]}, "text")
    assert out.getvalue().count("\n") == 1
    assert json.loads(out.getvalue())["x"] == [1, 2]


@pytest.mark.parametrize("mode", ["json", "jsonl"])
def test_json_parses_while_a_progress_bar_is_drawn(mode: str):
    console, out, err = make(mode, terminal=True)
    with console.progress("work", 3) as ticker:
        for _ in range(3):
            ticker.advance()
            ticker.note("loss 1.0")
            console.note("between")
    console.result({"done": True})
    assert json.loads(out.getvalue())["done"] is True
    assert "work" in err.getvalue() and "between" in err.getvalue()


def test_on_one_screen_an_answer_stands_above_the_bar_and_in_a_pipe_on_stdout():
    out, err = Terminal(), Terminal()
    console = Console(out, err)
    with console.progress("work", 2):
        console.record({}, "an answer")
    assert "an answer" in err.getvalue() and out.getvalue() == ""
    console, out, err = make(terminal=True)
    with console.progress("work", 2):
        console.record({}, "an answer")
    assert out.getvalue() == "an answer\n" and "an answer" not in err.getvalue()


def test_without_a_terminal_progress_is_a_line_every_thirty_seconds():
    console, _, err = make()
    now = [0.0]
    console.clock = lambda: now[0]
    with console.progress("work", 100) as ticker:
        ticker.note("loss 0.5")
        for _ in range(65):
            now[0] += 1.0
            ticker.advance()
    assert err.getvalue().splitlines() == [
        "work: 30/100 (30 %), 1.0/s, 1 min 10 s left, loss 0.5",
        "work: 60/100 (60 %), 1.0/s, 40 s left, loss 0.5",
    ]


def test_progress_without_a_total_and_without_progress_says_no_time_left():
    console, _, err = make()
    now = [0.0]
    console.clock = lambda: now[0]
    with console.progress("work") as ticker:
        now[0] = 40.0
        ticker.advance(0)
    with console.progress("other", 10) as ticker:
        now[0] = 80.0
        ticker.advance(0)
    assert err.getvalue().splitlines() == ["work: 0, 0.0/s", "other: 0/10 (0 %), 0.0/s"]


def test_a_table_in_a_pipe_is_tab_separated_with_one_record_a_line():
    console, out, err = make()
    rows = [("chair\tof\nwood", 3), ("table", 0.5)]
    console.table("found", ["class", "count"], rows, stream="out")
    console.table("found", ["class", "count"], rows)
    assert out.getvalue().splitlines() == ["class\tcount", "chair of wood\t3", "table\t0.5"]
    assert err.getvalue().splitlines()[0] == "found"


def test_a_table_on_stdout_gives_way_to_the_document():
    console, out, _ = make("json")
    console.table("found", ["class"], [("chair",)], stream="out")
    console.result({"x": 1})
    assert json.loads(out.getvalue())["x"] == 1


def test_a_table_fits_a_narrow_terminal_and_loses_nothing(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("COLUMNS", "40")
    console, _, err = make(terminal=True)
    console.table("found", ["name", "what"], [("a" * 30, "b" * 30)])
    lines = err.getvalue().splitlines()
    assert max(len(re.sub(r"\x1b\[[\d;]*m", "", line)) for line in lines) <= 40
    assert err.getvalue().count("a") >= 30 and err.getvalue().count("b") >= 30


def test_markup_in_a_file_name_is_shown_as_it_is():
    console, _, err = make(terminal=True)
    console.note("[red]a.off[/red]")
    console.table("found", ["name"], [("[bold]b.off",)])
    assert "[red]a.off[/red]" in err.getvalue() and "[bold]b.off" in err.getvalue()


@pytest.mark.parametrize("no_color", [False, True])
def test_no_color_takes_the_colour_away(no_color: bool, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    if no_color:
        monkeypatch.setenv("NO_COLOR", "1")
    console, _, err = make(terminal=True)
    with console.progress("work", 2) as ticker:
        ticker.advance(2)
    assert bool(COLOUR.search(err.getvalue())) is not no_color


def test_a_dumb_terminal_gets_lines(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "dumb")
    console, _, err = make(terminal=True)
    with console.progress("work", 2) as ticker:
        ticker.advance(2)
    console.note("done")
    assert err.getvalue() == "done\n"


def test_words_that_the_stream_cannot_encode_are_escaped_and_do_not_crash():
    raw = io.BytesIO()
    console = Console(io.TextIOWrapper(raw, encoding="ascii"), io.StringIO())
    console.result({}, "Stühle \udcff")
    assert raw.getvalue() == b"St\\xfchle \\udcff\n"


def test_json_is_strict():
    document = {
        "nan": math.nan,
        "inf": -math.inf,
        "array": np.array([1.5, np.nan]),
        "path": Path("a"),
        "n": np.int64(3),
    }
    assert json.loads(dumps(document)) == {
        "nan": None,
        "inf": None,
        "array": [1.5, None],
        "path": "a",
        "n": 3,
    }


def test_what_json_does_not_know_is_refused():
    with pytest.raises(TypeError, match="object can't be written"):
        plain({"a": object()})


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    )
)
def test_every_plain_document_comes_back_from_json(document: object):
    assert json.loads(dumps(document)) == plain(document)


def test_durations_read_like_speech():
    assert [duration(x) for x in (0.04, 9.96, 59.4, 59.6, 252, 3600 * 2 + 300)] == [
        *("0.0 s", "10 s", "59 s", "1 min 0 s", "4 min 12 s", "2 h 5 min")
    ]
    assert [counted(n, "file") for n in (0, 1, 2)] == ["0 files", "1 file", "2 files"]
