"""The rules of SHREC'17 on cases worked out by hand."""

from __future__ import annotations

import csv
import gzip
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mvtn_cli.core.datasets.shapenet import CLASSES, SYNSETS
from mvtn_cli.core.retrieval.shrec17 import (
    Truth,
    gains,
    read_lists,
    read_truth,
    score_lists,
    write_lists,
    write_truth,
)
from mvtn_cli.core.retrieval.shrec17_run import identifiers, truth_of, variant
from mvtn_cli.errors import DataError

# Chairs: 1 and 2 are armchairs, 3 a stool, 4 known as a chair only. 5 and 6 are tables.
TRUTH = Truth(
    ids=("000001", "000002", "000003", "000004", "000005", "000006"),
    synsets=("chair", "chair", "chair", "chair", "table", "table"),
    subsynsets=("arm", "arm", "stool", "chair", "desk", "desk"),
)


def ranked(*numbers: int) -> list[tuple[str, float]]:
    return [(f"{number:06d}", 0.1 * place) for place, number in enumerate(numbers)]


def per_query(lists: dict[str, list[tuple[str, float]]], query: str) -> dict[str, float]:
    """Scores of one query: of a truth in which all others have classes of their own, weightless here."""
    (row,) = [row for row in score_lists(TRUTH, {query: lists[query]})["per_class"] if row["name"] == "chair"]
    return {name: value * 4 for name, value in row.items() if name not in ("name", "queries")}


def test_a_list_by_hand():
    """Query 1, list 1 5 4 3: gains 3 0 2 1; hits at 1, 3, 4 of 4 relevant."""
    found = per_query({"000001": ranked(1, 5, 4, 3)}, "000001")
    assert found["P@N"] == pytest.approx(3 / 4) and found["R@N"] == pytest.approx(3 / 4)
    assert found["F1@N"] == pytest.approx(3 / 4)
    assert found["mAP"] == pytest.approx((1 + 2 / 3 + 3 / 4) / 4)
    dcg = 3 + 0 + 2 / math.log2(3) + 1 / 2
    ideal = 3 + 3 + 2 / math.log2(3) + 1 / 2  # itself and 2, then 4, then 3; no discount at the second place
    assert found["NDCG"] == pytest.approx(dcg / ideal)


def test_precision_against_recall_by_hand():
    """Query 1, list 1 5 4 3: precision 1, 2/3, 3/4 at recall 1/4, 2/4, 3/4 of 4 relevant; the fourth is not found."""
    curves = score_lists(TRUTH, {"000001": ranked(1, 5, 4, 3), "000005": ranked(5, 6)})["precision_recall"]
    chair = np.array([1.0] * 6 + [3 / 4] * 10 + [0.0] * 5)  # at recall 0 to .25, to .75, to 1
    assert np.allclose(curves["classes"]["chair"], chair / 4) and np.allclose(curves["classes"]["table"], 1 / 2)
    assert np.allclose(curves["micro"], (chair + 1) / 6) and np.allclose(curves["macro"], (chair / 4 + 1 / 2) / 2)


def test_the_worth_of_parents_is_not_symmetric():
    """To 4, known as a chair only, armchairs are another kind (1); to an armchair, 4 is the parent (2)."""
    found = per_query({"000004": ranked(4, 1)}, "000004")
    assert found["NDCG"] == pytest.approx((3 + 1) / (3 + 1 + 1 / math.log2(3) + 1 / 2))
    assert per_query({"000001": ranked(4)}, "000001")["NDCG"] == pytest.approx(2 / (3 + 3 + 2 / math.log2(3) + 1 / 2))


def test_perfect_lists_are_1_and_missing_ones_0():
    perfect = {
        "000001": ranked(1, 2, 4, 3),
        "000002": ranked(2, 1, 4, 3),
        "000003": ranked(3, 4, 1, 2),
        "000004": ranked(4, 1, 2, 3),
        "000005": ranked(5, 6),
        "000006": ranked(6, 5),
    }
    whole = score_lists(TRUTH, perfect)
    assert whole["micro"] == whole["macro"] == dict.fromkeys(("P@N", "R@N", "F1@N", "mAP", "NDCG"), 1.0)
    del perfect["000006"]
    less = score_lists(TRUTH, perfect)
    assert less["unanswered"] == 1
    assert less["micro"]["mAP"] == pytest.approx(5 / 6) and less["macro"]["mAP"] == pytest.approx((1 + 1 / 2) / 2)
    assert less["mean"]["mAP"] == pytest.approx((5 / 6 + 3 / 4) / 2)
    assert score_lists(TRUTH, {})["micro"]["NDCG"] == 0


def test_strangers_and_repetitions_are_dropped_and_short_names_filled_up():
    plain = per_query({"000001": ranked(1, 5, 4)}, "000001")
    messy = [("1", 0.0), ("1", 0.0), ("777777", 0.1), ("5", 0.2), ("000001", 0.3), ("000004", 9.0)]
    assert per_query({"000001": messy}, "000001") == plain


def test_a_thousand_results_are_read_and_recall_knows_it():
    ids = tuple(f"{n:06d}" for n in range(1500))
    truth = Truth(ids, ("a",) * 1500, ("a",) * 1500)
    found = score_lists(truth, {name: [(other, 0.0) for other in ids] for name in ids[:3]})
    assert found["micro"]["R@N"] * 500 == pytest.approx(1) and found["micro"]["NDCG"] * 500 == pytest.approx(1)
    assert found["micro"]["mAP"] * 500 == pytest.approx(1000 / 1500)


def test_files_say_the_same(tmp_path):
    lists = {"000001": ranked(1, 5, 4, 3), "000005": ranked(6, 1), "000006": []}
    write_lists(tmp_path / "test_normal", lists)
    write_truth(tmp_path / "all.csv", TRUTH, list("abcdef"), "test")
    assert read_truth(tmp_path / "all.csv", "test") == TRUTH and read_truth(tmp_path / "all.csv", "val").ids == ()
    read = read_lists(tmp_path / "test_normal")
    assert score_lists(TRUTH, read) == score_lists(TRUTH, lists)
    assert (tmp_path / "test_normal" / "000005").read_text() == "000006 0\n000001 0.1\n"
    (tmp_path / "test_normal" / "000009").write_text("000001 0.5\n000002\n")
    with pytest.raises(DataError, match="000009, line 2: expected an identifier and a distance, got '000002'"):
        read_lists(tmp_path / "test_normal")


def test_on_the_official_list_the_best_order_is_1_and_an_own_class_alone_is_not(real_data: Path):
    listed = real_data / "shapenet" / "all.csv.gz"
    if not listed.is_file():
        pytest.skip(f"SHREC'17's list not found: {listed}")
    with gzip.open(listed, "rt") as stream:
        rows = [row for row in csv.DictReader(stream) if row["split"] == "test"][::15]
    truth = Truth(*(tuple(row[column] for row in rows) for column in ("id", "synsetId", "subSynsetId")))
    synsets, finer = np.array(truth.synsets), np.array(truth.subsynsets)
    best, shuffled = {}, {}
    for query, name in enumerate(truth.ids):
        worth = gains(synsets, finer, query)
        order = np.argsort(-worth, kind="stable")[: int((worth > 0).sum())]
        best[name] = [(truth.ids[k], 0.0) for k in order]
        shuffled[name] = best[name][::-1]
    whole, turned = score_lists(truth, best), score_lists(truth, shuffled)
    assert len(rows) == 685 and len(whole["per_class"]) > 40
    assert all(value == pytest.approx(1) for kind in ("micro", "macro") for value in whole[kind].values())
    assert turned["micro"]["mAP"] == pytest.approx(1) and turned["micro"]["NDCG"] < 0.95  # finer classes in NDCG alone


def made_up(names: list[str], classes: tuple[str, ...], finer: list[str], spec: str) -> SimpleNamespace:
    return SimpleNamespace(
        spec=spec,
        classes=classes,
        records=[SimpleNamespace(name=name, label=classes.index(name.split("/")[0])) for name in names],
        items=[SimpleNamespace(subclass=word) for word in finer],
    )


def test_shapenet_keeps_its_identifiers_and_synsets_and_others_get_numbers():
    chair, car = CLASSES.index("chair"), CLASSES.index("car")
    shapenet = made_up(["chair/000123", "car/000007"], CLASSES, ["03002210", ""], "shapenet55:/data@perturbed")
    ids = identifiers(shapenet, [0, 1])
    assert ids == ["000123", "000007"] and variant(shapenet) == "perturbed"
    assert truth_of(shapenet, [0, 1], ids).synsets == (SYNSETS[chair], SYNSETS[car])
    assert truth_of(shapenet, [0, 1], ids).subsynsets == ("03002210", SYNSETS[car])
    other = made_up(["b/2", "a/1", "b/1"], ("a", "b"), ["", "", ""], "folder:/x")
    assert identifiers(other, [0, 1, 2]) == ["000002", "000000", "000001"] and variant(other) == "normal"
    assert truth_of(other, [1, 2], ["000000", "000001"]) == Truth(("000000", "000001"), ("a", "b"), ("a", "b"))
