"""`mvtn bench` from the command line, at tiny sizes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from mvtn_cli.app import app
from mvtn_cli.bench_config import WHATS, BenchConfig
from mvtn_cli.commands.bench import COLUMNS, command_words
from mvtn_cli.core.bench import measure as measure_module
from mvtn_cli.core.bench.outcome import Outcome
from mvtn_cli.core.bench.plan import QUICK
from mvtn_cli.errors import UsageError

TETRAHEDRON = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    return tmp_path


def mvtn(*words: object) -> Result:
    return CliRunner().invoke(app, ["bench", *map(str, words)])


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Callable[[Outcome], list[Any]]:
    """Let `measure` answer at once; what it was asked is kept."""
    import mvtn_cli.core.bench as room

    asked: list[Any] = []

    def use(outcome: Outcome) -> list[Any]:
        def measure(what: str, meshes: Any, plan: Any, console: Any, *, threads: Any = None) -> Outcome:
            asked.append((what, [subject.name for subject in meshes], plan, threads))
            return outcome

        monkeypatch.setattr(room, "measure", measure)
        return asked

    return use


def test_image_answers_with_one_document_a_csv_and_a_plot(own_folder: Path):
    (own_folder / "a.off").write_text(TETRAHEDRON)
    words = ("image", "--mesh", "a.off", "--image-size", 16, "--num-views", 2, "--quick")
    result = mvtn(*words, "--json", "--csv", "rows.csv", "--plot", "plot.svg")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert set(document) >= {*("schema", "what", "command", "seed", "machine", "versions", "rows", "summary")}
    assert document["command"] == "mvtn bench image --mesh a.off --quick --image-size 16 --num-views 2 --seed 0"
    assert set(document["summary"]) == {"rmse_1", "rmse_2", "rmse_4"}
    assert len((own_folder / "rows.csv").read_text().splitlines()) == 1 + len(document["rows"])
    assert "RMSE" in (own_folder / "plot.svg").read_text()
    assert "reduced: pixels along each side: 16 (full: 224)" in result.stderr
    assert [omitted["what"] for omitted in document["omitted"]] == ["pytorch3d", "mitsuba", "nvdiffrast"]


def test_a_pipe_gets_a_table_with_the_columns_of_the_benchmark(stub):
    stub(Outcome([{"mesh": "chair", "mode": "fd", "median_deg": 0.123456}], {"within_1deg": 1, "of": 1}))
    result = mvtn("pose")
    header, row = result.stdout.splitlines()
    assert header.split("\t") == list(COLUMNS["pose"])
    assert row.split("\t") == ["chair", "", "", "fd", "", "", "0.1235", "", ""]
    assert "summary: within_1deg 1, of 1" in result.stderr


def test_meshes_may_follow_mesh_repeat_it_or_stand_alone(stub, own_folder: Path):
    for name in "abc":
        (own_folder / f"{name}.off").write_text(TETRAHEDRON.replace("0 0 1\n", f"0 0 {ord(name) - 95}\n", 1))
    asked = stub(Outcome([], {}))
    for words in (("--mesh", "a.off", "b.off"), ("--mesh", "a.off", "--mesh", "b.off"), ("a.off", "b.off")):
        assert mvtn("pose", *words).exit_code == 0
    assert [names for _, names, _, _ in asked] == [["a", "b"]] * 3


def test_a_bare_bench_measures_the_gradient_of_built_in_meshes(stub):
    asked = stub(Outcome([], {}))
    assert mvtn().exit_code == 0
    assert mvtn("render", "--threads", 1, "--seed", 7).exit_code == 0
    (what, names, plan, threads), (other, _, seeded, one) = asked
    assert (what, names, plan.seed, threads) == ("gradient", [], 0, None)
    assert (other, seeded.seed, one) == ("render", 7, 1)


def test_failing_stiff_cases_end_with_an_error_after_the_answer(stub):
    stub(Outcome([{"code": "T1", "problem": "bent"}], {"cases": 2, "failed": 1}))
    result = mvtn("stiff", "--json")
    assert result.exit_code == 1 and json.loads(result.stdout)["summary"]["failed"] == 1
    assert "error: 1 of 2 stiff cases fail" in result.stderr


def test_a_file_that_can_t_be_measured_is_named(own_folder: Path):
    (own_folder / "bad.off").write_text("OFF\n3 1 0\n0 0 0\n")
    (own_folder / "points.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n")
    assert "error: bad.off can't be measured" in mvtn("pose", "--mesh", "bad.off").stderr
    assert "has no faces" in mvtn("pose", "--mesh", "points.xyz").stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("gradent",), "unknown what 'gradent'; did you mean 'gradient'?"),
        (("render", "--plot", "a.svg"), "`bench render` measures no error that could be plotted against time"),
        (("pose", "--plot", "a.pdf"), "--plot a.pdf must end in .svg or .png"),
        (("stiff", "--mesh", "a.off"), "the stiff set brings its own meshes"),
        (("--compare", "a.json"), "--compare takes two answers of mvtn bench --json"),
        (("--compare", "a.json", "b.json", "c.json"), "--compare takes two answers of mvtn bench --json"),
        (("pose", "--num-views", "0"), "--num-views must be at least 1, got 0"),
    ],
)
def test_wrong_use_is_refused_in_one_sentence(words: tuple[str, ...], message: str):
    result = mvtn(*words)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.splitlines()[0] == f"error: {message}"


def test_compare_shows_both_and_their_ratio(stub, own_folder: Path):
    for name, median in (("a", 0.2), ("b", 0.1)):
        row = {"mesh": "chair", "mode": "fd", "within_1deg": 12, "median_deg": median, "seconds": 1.0}
        stub(Outcome([row], {"of": 12}))
        (own_folder / f"{name}.json").write_text(mvtn("pose", "--json", "-q").stdout)
    result = mvtn("--compare", "a.json", "b.json")
    assert result.exit_code == 0, result.stderr
    lines = [line.split("\t") for line in result.stdout.splitlines()]
    assert lines[0] == ["row", "figure", "A", "B", "B/A"]
    assert ["chair fd", "median_deg", "0.2", "0.1", "0.5"] in lines
    assert ["summary", "of", "12", "12", "1"] in lines
    document = json.loads(mvtn("--compare", "a.json", "b.json", "--json").stdout)
    assert document["what"] == "pose" and {"row", "figure", "a", "b", "ratio"} == set(document["rows"][0])
    assert mvtn("--compare", "a.json", "missing.json").exit_code == 1


def test_the_words_of_a_command_measure_the_same_again():
    config = BenchConfig(what="pose", mesh=("a b.off",), files=("c.off",), up="z", threads=2, quick=True, seed=5)
    words = command_words(config)
    assert words == "mvtn bench pose --mesh 'a b.off' c.off --quick --up z --threads 2 --seed 5"


def test_every_benchmark_has_columns_a_quick_plan_and_an_entry():
    assert set(WHATS) == set(COLUMNS) == set(QUICK)
    with pytest.raises(ValueError, match="no benchmark"):
        measure_module("x", [object()], None, None)  # type: ignore[arg-type, list-item]


def test_compare_in_a_file_is_a_comparison_too():
    assert BenchConfig(compare="a.json", files=("b.json",)).what == "gradient"
    with pytest.raises(UsageError):
        BenchConfig(compare="a.json")
