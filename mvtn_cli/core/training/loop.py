"""The one training loop."""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import torch

from mvtn_cli.config import TrainConfig
from mvtn_cli.console import Console
from mvtn_cli.core.networks.recogniser import Recogniser, build_recogniser
from mvtn_cli.core.render.warming import compile_renderer
from mvtn_cli.core.training import judge, learner, schedules, tracking, watch
from mvtn_cli.core.training.ahead import one_ahead
from mvtn_cli.core.training.device import use_mixed, use_threads
from mvtn_cli.core.training.find import find_or_create_run
from mvtn_cli.core.training.fixed_views import with_kept_views
from mvtn_cli.core.training.position import Position, restore, save
from mvtn_cli.core.training.randomness import epoch_batches, step_seed
from mvtn_cli.core.training.ready import ReadyMaker
from mvtn_cli.core.training.run import Run
from mvtn_cli.core.training.settle import settle_batch_norm
from mvtn_cli.core.training.shapes import drawn_kind
from mvtn_cli.core.training.signals import StopNow, StopRequest
from mvtn_cli.core.training.split import Indices, shown_indices, training_indices
from mvtn_cli.core.training.team import Team
from mvtn_cli.errors import Interrupted, MvtnError

SAVE_EVERY_SECONDS = 60.0
SHOWN_SHAPES = 8


def train(
    config: TrainConfig,
    prepared: Any,
    console: Console,
    *,
    stop: Callable[[], bool] | None = None,
    name: str | None = None,
    reuse_finished: bool = False,
) -> Run:
    """Train a recogniser, or go on with a training that was interrupted.

    Args:
        config: The settings.
        prepared: The data set.
        console: Where progress, one line an epoch and warnings go.
        stop: Asked after each step; True has the effect of Ctrl-C.
        name: The run's folder in `config.runs`; None is `config.name`, or else made from the settings.
        reuse_finished: Give back a finished run of the same settings instead of beginning another.

    Returns:
        The finished run.

    Raises:
        Interrupted: Ctrl-C or a terminate signal; everything is saved, the hint says how to go on.
        UsageError: A named run was begun with other settings; nothing can be seen in the pictures; the views
            can't learn.
        MvtnError: Too many steps in a row without finite numbers; another process trains this run.
    """
    team = Team.join(config.device)
    console = team.console(console)

    def prepare() -> tuple[Indices, Recogniser]:
        watch.check_views_can_learn(config)
        tracking.require(config.log)
        return training_indices(config, prepared), build_recogniser(config, len(prepared.classes))

    def find() -> tuple[Run, bool]:
        wanted = name or config.name
        run = find_or_create_run(config, prepared, config.runs, wanted, console, reuse_finished=reuse_finished)
        return run, run.finished

    with team.watched(), ExitStack() as open_files:
        # Built before the run's folder: a wrong backbone or weights file leaves nothing behind.
        indices, model = team.together(prepare)
        run, finished = team.alone(find)
        if finished:
            return run
        for warning in model.warnings():
            console.warn(warning)
        team.alone(lambda: open_files.enter_context(run.lock()))
        stopping = open_files.enter_context(StopRequest(console, team.question(stop)))
        track = open_files.enter_context(tracking.open_log(config.log, run))
        team.alone(lambda: run.set_state("running", selected_by=indices.selected_by, model=model.facts()))
        try:
            with team.watched():
                _train(team, run, model, config, prepared, indices, console, stopping, track)
        except MvtnError as error:
            if team.first:
                run.set_state("interrupted", reason=error.message)
            raise
        seconds = round(sum(line["seconds"] for line in run.metrics()), 3)
        team.alone(lambda: run.set_state("finished", seconds=seconds))
    return run


def _train(
    team: Team,
    run: Run,
    model: Recogniser,
    config: TrainConfig,
    prepared: Any,
    indices: Indices,
    console: Console,
    stopping: StopRequest,
    track: tracking.Track,
) -> None:
    """From the first step, or the one after the last that was saved, to the end."""
    shown = shown_indices(indices, [record.label for record in prepared.records], SHOWN_SHAPES)
    if config.select == "test":
        console.warn("the best epoch is chosen on the test split, so the test accuracy will flatter")
    if not indices.select:
        console.note("no shapes choose the best epoch: the last one is taken")

    # Networks and optimisers: classifier and viewpoint network have one each, with rates of their own.
    use_threads(config.threads or team.threads)
    team.synchronise(model)
    optimisers = learner.build_optimisers(model, config)
    mixed = use_mixed(config.precision, team.fabric.device)
    loss_of, *stepping = team.fabric.setup(
        learner.Learner(model, config.label_smoothing, mixed=mixed), *optimisers.values()
    )
    viewpoints = dict(zip(optimisers, stepping, strict=True)).get(learner.VIEWPOINTS)

    if model.uses_views:
        kind = drawn_kind(prepared, indices.train[0], config.render)
        team.alone(lambda: compile_renderer(console, model.device, kind=kind, gradient=model.selector.learned))
    shapes = with_kept_views(prepared, config, console, model.device)

    # Where it stands, and what the cameras see before they learn.
    position = team.together(lambda: restore(run, model, optimisers))
    team.alone(lambda: run.cut_metrics(position.epoch))
    maker = ReadyMaker(team, model, shapes, config)
    keep = partial(save, run, position, model, optimisers)
    steps = len(epoch_batches(indices.train, config.batch_size, config.seed, 0))
    pictures_checked, collapse_told, saved = not model.uses_views, False, time.monotonic()
    if position == Position() and model.uses_views:
        team.alone(partial(judge.keep_views, run, "start", judge.look_at(model, shapes, shown, config, team=team)))

    while position.epoch < config.epochs:
        epoch, tally = position.epoch, position.tally
        batches = epoch_batches(indices.train, config.batch_size, config.seed, epoch)
        began = time.monotonic() - tally.seconds
        model.begin_stage(schedules.stage_of(config, epoch))
        teaching = viewpoints if model.stage == "shapes" else None
        learning = [optimiser for optimiser in stepping if optimiser is not viewpoints or teaching is not None]
        model.train()
        title = f"epoch {epoch + 1}/{config.epochs}"
        coming = [partial(maker.make, batches[step], epoch, step) for step in range(position.step, steps)]
        with console.progress(title, steps) as ticker, one_ahead(coming) as made:
            ticker.advance(position.step)
            for batch, look, generator, taken in made:
                # Schedules, and the randomness of this step: all from (seed, epoch, step).
                step = position.step
                done = schedules.progress_in_stage(config, epoch, step, steps)
                explore_deg = schedules.set_all(config, optimisers, done)
                torch.manual_seed(step_seed(config.seed, epoch, step))

                # Forward and backward; with several processes this one has a share of the batch.
                share = team.share(batches[step])
                buffers = learner.copy_buffers(model)
                with team.drawing(share):
                    loss, logits, images = loss_of(batch, look, explore_deg, generator, taken)
                if not pictures_checked:
                    watch.check_something_is_seen(images, partial(team.mean, share))
                    pictures_checked = True
                for optimiser in optimisers.values():
                    optimiser.zero_grad(set_to_none=True)
                right = (logits.argmax(1).cpu() == batch.labels)[: share.own].sum()
                mean_loss, correct = team.total(share.weight * float(loss.detach()), float(right))
                if math.isfinite(mean_loss):
                    # DDP averages over the processes, whose shares may have other sizes
                    team.fabric.backward(loss * (share.weight * share.size))

                # Clip, then step; or else leave everything as it was before this batch.
                trouble = watch.not_finite(mean_loss, optimisers)
                if trouble is None:
                    if teaching is not None:
                        norm = team.fabric.clip_gradients(loss_of, teaching, max_norm=config.clip)
                        tally.gradient_norms.append(float(norm or 0.0))
                    for optimiser in learning:
                        optimiser.step()
                    tally.add(mean_loss, int(correct), share.total)
                    position.bad_in_a_row = 0
                else:
                    learner.restore_buffers(model, buffers)
                    tally.skipped += 1
                    position.bad_in_a_row += 1
                    names = [prepared.records[i].name for i in batches[step]]
                    where = f"epoch {epoch + 1}, batch {step + 1} ({_some(names)})"
                    console.warn(f"{trouble} is not finite in {where}: this step is left out")
                position.step += 1
                tally.seconds = time.monotonic() - began

                # Save what has been reached, and end early if that is asked for or needed.
                ticker.advance()
                ticker.note(_step_line(position))
                hopeless = position.bad_in_a_row >= config.max_bad_steps
                asked, due = team.any(stopping(), time.monotonic() - saved >= SAVE_EVERY_SECONDS)
                if hopeless or asked or due:
                    team.alone(keep)
                    saved = time.monotonic()
                if hopeless:
                    raise team.agreed(_hopeless(run, position))
                if asked:
                    raise team.agreed(_interrupted(run, config, position, steps))

        # Judge the epoch by the shapes that choose the best one.
        try:
            settle_batch_norm(model, shapes, indices.train, config, partial(_check_all, team, stopping), team)
            judged = judge.judge_epoch(model, shapes, indices.select, shown, config, stopping.check, team)
            better = model.stage == "shapes" and judge.is_better(judged, position.best)
            look_again = better and model.uses_views
            seen = judge.look_at(model, shapes, shown, config, stopping.check, team) if look_again else None
        except StopNow:
            team.alone(keep)
            raise team.agreed(_interrupted(run, config, position, steps)) from None

        # Write down what came of it: best weights and numbers first, then the state that makes them count.
        tally.seconds = time.monotonic() - began
        record = {
            "epoch": epoch + 1,
            "stage": model.stage,
            **tally.summary(),
            **judged,
            "lr": optimisers[learner.CLASSIFIER].param_groups[0]["lr"],
        }
        if better:
            position.best = {key: record[key] for key in ("epoch", "val_accuracy", "val_loss")}
            about = {**position.best, "selected_by": indices.selected_by}
            team.alone(partial(judge.keep_best, run, model, about, seen))
        team.alone(partial(_write_down, run, record, track))
        position.next_epoch()
        team.alone(keep)
        saved = time.monotonic()
        console.note(judge.epoch_line(record, config.epochs, better))
        if not collapse_told and (warning := judge.view_warning(record, config)):
            console.warn(warning)
            collapse_told = True


def _check_all(team: Team, stopping: StopRequest) -> None:
    """End in all processes if one of them is asked to."""
    if any(team.any(stopping.asked)):
        raise StopNow


def _write_down(run: Run, record: dict[str, Any], track: tracking.Track) -> None:
    run.append_metrics(record)
    track(record)


def _some(names: Sequence[str]) -> str:
    """The first of many names."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _step_line(position: Position) -> str:
    """How it is going, for the progress bar."""
    tally = position.tally
    parts = [f"loss {tally.loss / tally.shapes:.3f}"] if tally.shapes else []
    if position.best is not None and position.best["val_accuracy"] is not None:
        parts.append(f"best val {position.best['val_accuracy']:.1%}")
    return ", ".join(parts)


def _interrupted(run: Run, config: TrainConfig, position: Position, steps: int) -> Interrupted:
    command = ["mvtn", "train", "--config", str(run.config_path)]
    folders = {"--runs": config.runs, "--cache": config.cache}  # these two are not in a run's config.toml
    for option, folder in folders.items():
        if folder not in (None, Path("runs")):
            command += [option, str(folder)]
    return Interrupted(
        f"stopped in epoch {position.epoch + 1} after step {position.step} of {steps}; saved in {run.path}",
        hint=f"go on with the same command, or: {shlex.join(command)}",
    )


def _hopeless(run: Run, position: Position) -> MvtnError:
    return MvtnError(
        f"{position.bad_in_a_row} steps in a row without finite numbers, up to epoch {position.epoch + 1}, "
        f"step {position.step}; the weights before them are kept in {run.path}",
        hint="try a lower --lr or --views-lr; the warnings above name the batches",
        code="train.not-finite",
    )
