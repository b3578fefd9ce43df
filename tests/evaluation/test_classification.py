from __future__ import annotations

import json

import numpy as np
import pytest
from sklearn.metrics import balanced_accuracy_score, confusion_matrix

from mvtn_cli.console import dumps
from mvtn_cli.core.evaluation.classification import metrics, probabilities, top_confusions


def one_hot(predicted: list[int], num_classes: int) -> np.ndarray:
    return np.eye(num_classes)[predicted] * 4.0


def test_accuracies_and_confusions_agree_with_scikit_learn():
    random = np.random.default_rng(0)
    labels = random.integers(0, 7, 300)
    labels[labels == 3] = 2  # class 3 never occurs: it must not count in the mean over classes
    logits = random.normal(size=(300, 7)) + 2 * np.eye(7)[labels]
    predicted = logits.argmax(axis=1)
    found = metrics(labels, logits, list("abcdefg"))
    assert found["accuracy"] == pytest.approx((predicted == labels).mean(), abs=1e-12)
    kept = np.isin(predicted, labels)  # scikit-learn warns about predicted classes without shapes
    assert not kept.all()
    recalls = [(predicted[labels == c] == c).mean() for c in np.unique(labels)]
    assert found["class_accuracy"] == pytest.approx(np.mean(recalls), abs=1e-12)
    assert np.array_equal(found["confusion"], confusion_matrix(labels, predicted, labels=range(7)))


def test_class_accuracy_is_scikit_learns_balanced_accuracy_when_every_class_occurs():
    labels = np.array([0, 0, 0, 0, 1, 1, 2])
    predicted = np.array([0, 0, 0, 1, 1, 0, 2])
    found = metrics(labels, one_hot(predicted, 3), "abc")
    assert found["class_accuracy"] == pytest.approx(balanced_accuracy_score(labels, predicted))


def test_the_table_of_classes_says_what_each_is_taken_for():
    found = metrics([0, 0, 0, 0, 1, 1], one_hot([0, 2, 2, 1, 1, 1], 3), ["chair", "sofa", "stool"])
    chair, sofa, stool = found["per_class"]
    assert (chair["name"], chair["count"], chair["correct"], chair["accuracy"]) == ("chair", 4, 1, 0.25)
    assert (chair["confused_with"], chair["confused_count"]) == ("stool", 2)
    assert sofa["accuracy"] == 1.0 and sofa["confused_with"] is None
    assert stool["count"] == 0 and np.isnan(stool["accuracy"])
    assert found["top_confusions"][0] == {"label": "chair", "predicted": "stool", "count": 2}


def test_shapes_without_a_label_are_left_out():
    found = metrics([-1, 0, -1, 1], one_hot([1, 0, 0, 0], 2), "ab")
    assert (found["count"], found["correct"], found["accuracy"]) == (2, 1, 0.5)


def test_a_logit_that_is_not_finite_counts_as_wrong_and_is_counted():
    logits = one_hot([0, 0, 1], 2)
    logits[0, 1] = np.nan  # argmax would call this class 1, or 0: neither is an answer
    found = metrics([0, 0, 1], logits, "ab")
    assert found["accuracy"] == pytest.approx(2 / 3) and found["not_finite"] == 1
    assert np.sum(found["confusion"]) == 2


def test_no_shapes_give_nan_that_becomes_null():
    document = json.loads(dumps(metrics([], np.zeros((0, 2)), "ab")))
    assert document["accuracy"] is None and document["class_accuracy"] is None and document["count"] == 0


def test_probabilities_survive_large_logits():
    found = probabilities([[1000.0, 1000.0], [-1e4, 0.0]])
    assert np.allclose(found, [[0.5, 0.5], [0.0, 1.0]])


def test_top_confusions_never_list_what_was_right_or_did_not_happen():
    assert top_confusions([[9, 0], [0, 9]], "ab") == []


def test_the_interval_is_wilsons():
    # 81 of 263: the worked example of Newcombe, Statistics in Medicine 17 (1998), table I, method 3.
    assert metrics([0] * 263, one_hot([0] * 81 + [1] * 182, 2), "ab")["accuracy_interval"] == pytest.approx(
        [0.2553, 0.3662], abs=5e-5
    )
    low, high = metrics([0] * 20, one_hot([0] * 20, 2), "ab")["accuracy_interval"]
    assert 0.8 < low < 0.9 and high == 1.0
