"""`mvtn predict`: the class of each file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import expand, find_run, judge_bad_files, names_given, open_files, up_axis
from mvtn_cli.config import PredictConfig
from mvtn_cli.console import counted, duration

if TYPE_CHECKING:
    from mvtn_cli.core.networks.recogniser import Recogniser
    from mvtn_cli.core.preprocess import Prepared
    from mvtn_cli.core.training.run import Run


def predict(config: PredictConfig, call: Call) -> None:
    """Name the class of each file, and how probable it is. Bad files don't stop the others.

    Example: find . -name '*.off' -print0 | mvtn predict - --jsonl
    """
    files = list(expand(names_given(config.files)))
    run = find_run(config.run, config.runs, call)
    from mvtn_cli.core.training.device import use_threads
    from mvtn_cli.core.training.predict import load_model

    use_threads(config.threads)
    model = load_model(run, config.checkpoint, config.device)
    up = up_axis(config.up, run)
    bad = 0
    with call.console.progress("predict", len(files)) as ticker:
        for batch in _batches(files, config.shapes_a_step(run.config.batch_size)):
            prepared, failed = open_files(batch, up, run, config, call)
            bad += len(failed)
            for answer in _answers(run, model, prepared, batch, config):
                call.console.record(answer, _line(answer))
            ticker.advance(len(batch))
    call.console.result(
        {
            "schema": "mvtn.predict/1",
            "run": str(run.path),
            "bad": bad,
            "seconds": call.seconds,
        },
        records="predictions",
    )
    judge_bad_files(bad, len(files), config.on_bad)
    call.console.note(f"{counted(len(files) - bad, 'file')} classified by {run.path} in {duration(call.seconds)}")


def _answers(
    run: Run, model: Recogniser, prepared: Prepared | None, batch: Sequence[str], config: PredictConfig
) -> Iterator[dict[str, Any]]:
    """The answers for a batch, in the order in which the files were given."""
    from mvtn_cli.core.evaluation.classification import probabilities
    from mvtn_cli.core.training.predict import predict as classify

    if prepared is None:
        return
    found = classify(model, prepared, range(len(prepared)), run.config, batch_size=len(batch))
    rows = dict(zip((record.source for record in prepared.records), probabilities(found.logits), strict=True))
    for file in batch:
        if (row := rows.get(str(Path(file).absolute()))) is None:
            continue
        likeliest = sorted(zip(row.tolist(), run.classes, strict=True), key=lambda pair: -pair[0])[: config.top]
        answer = {"file": file, "class": likeliest[0][1], "probability": likeliest[0][0]}
        yield answer | {"top": [{"class": name, "probability": share} for share, name in likeliest]}


def _line(answer: dict[str, Any]) -> str:
    return "\t".join([answer["file"], *(f"{top['class']}\t{top['probability']:.2f}" for top in answer["top"])])


def _batches(files: Sequence[str], size: int) -> Iterator[list[str]]:
    rest = iter(files)
    while batch := list(islice(rest, size)):
        yield batch
