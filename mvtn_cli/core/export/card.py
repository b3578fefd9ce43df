"""The model card: what the weights are, how good, how they are used, and where that ends."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from mvtn_cli import __version__
from mvtn_cli.core.evaluation.evaluate import results_folder
from mvtn_cli.core.export.graphs import Graph
from mvtn_cli.core.networks.recogniser import Recogniser
from mvtn_cli.core.training.run import Run

WORDS = {
    "images": "pictures in [0, 1], drawn as the settings below say (white shapes, headlight)",
    "directions": "unit vectors from the shape to the cameras of these pictures, y up",
    "points": "the first points of the stored shape, centred, in shape radii, y up",
    "start_azimuth_deg": "where the cameras start, degrees",
    "start_elevation_deg": "the same",
    "logits": "the largest is the class, in the order of labels.txt; their softmax its probability",
    "descriptor": "for retrieval",
    "azimuth_deg": "of each camera, degrees, from +z towards +x, not wrapped",
    "elevation_deg": "above the ground plane, degrees; may lie beyond a pole",
    "distance": "from the shape's centre, shape radii",
    "light": "unit vector towards the light of each view",
}
LIMITS = """\
- It knows these classes alone, and names one of them for any shape: look at the probabilities.
- It was measured on shapes of its own data set. Scans, other poses or other up axes are something else:
  `mvtn robustness` measures that.
- The ONNX files take pictures and points; drawing pictures is not part of them. Pictures drawn by another
  renderer, or with other settings, are not what it has learned from."""


def measured(run: Run, checkpoint: str) -> dict[str, Any] | None:
    """What `mvtn eval` found on the test split with these weights; None if it did not look, or before they changed."""
    path = results_folder(run.path, "test", checkpoint) / "result.json"
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(result, dict) or (result.get("split"), result.get("checkpoint")) != ("test", checkpoint):
        return None
    # a training may have gone on since: the newest weights carry no name, the best ones their epoch and numbers
    newer = checkpoint == "last" and run.weights_path("last").stat().st_mtime > path.stat().st_mtime
    stale = newer or result.get("best") != run.best
    return result if isinstance(result.get("accuracy"), int | float) and not stale else None


def model_card(
    run: Run, model: Recogniser, checkpoint: str, graphs: Sequence[Graph], differences: Mapping[str, float]
) -> str:
    """Write the card, as Markdown with the head that model hubs read.

    Args:
        run: The training.
        model: With the weights that are exported.
        checkpoint: Which of them.
        graphs: What was written as ONNX.
        differences: By name, how far each is from the network itself.
    """
    parts = [
        _head(run),
        _about(run, model, checkpoint),
        "## Accuracy\n\n" + _accuracy(run, checkpoint),
        "## Files and use\n\n" + _use(graphs, differences, model),
        "## Limits\n\n" + LIMITS,
        "## Settings\n\n```toml\n" + run.config_path.read_text(encoding="utf-8").strip() + "\n```",
    ]
    return "\n\n".join(parts) + "\n"


def _head(run: Run) -> str:
    return f"---\nlibrary_name: mvtn\ntags: [3d, shape-recognition, multi-view]\n---\n\n# {run.name}"


def _about(run: Run, model: Recogniser, checkpoint: str) -> str:
    info, config = run.info, run.config
    weights = sum(model.facts()["parameters"].values())
    views = f"{config.num_views} {config.views} views of {config.image_size} × {config.image_size} pixels"
    seen = views if model.uses_views else f"{config.encoder_points} points"
    best = run.best or {}
    epoch = f", of epoch {best['epoch']}" if checkpoint == "best" and "epoch" in best else ""
    return "\n".join(
        [
            f"A {config.network} with {weights:,} weights ({checkpoint}{epoch}) that names one of "
            f"{len(run.classes)} classes of 3D shapes. It looks at {seen}.",
            "",
            f"- Trained on: {info['title']} (`{info['dataset']}`, stored shapes {info['data_address']})",
            f"- Seed {info['seed']}, epochs {config.epochs}, best epoch chosen on: "
            f"{info.get('selected_by', info['select'])}",
            f"- Trained with mvtn {info['version']}, exported with mvtn {__version__}",
        ]
    )


def _accuracy(run: Run, checkpoint: str) -> str:
    result = measured(run, checkpoint)
    if result is None:
        return f"Not measured yet: `mvtn eval {run.name} --checkpoint {checkpoint}`, then export again."
    return "\n".join(
        [
            "| | |",
            "| --- | --- |",
            f"| test shapes | {result['count']} |",
            f"| accuracy | {100 * result['accuracy']:.2f} % |",
            f"| mean of classes | {100 * result['class_accuracy']:.2f} % |",
        ]
    )


def _use(graphs: Sequence[Graph], differences: Mapping[str, float], model: Recogniser) -> str:
    lines = []
    for graph in graphs:
        lines += [f"`{graph.name}.onnx` (within {differences[graph.name]:.1e} of torch), B shapes at a time:", ""]
        lines += [f"- in `{name}` ({_axes(shape)}): {WORDS[name]}" for name, shape in graph.inputs.items()]
        lines += [f"- out `{name}`: {WORDS[name]}" for name in graph.outputs]
        lines.append("")
    if model.uses_views and len(graphs) == 1:
        lines += [_fixed_cameras(model), ""]
    lines.append(
        "`labels.txt`: a class a line. `weights.safetensors`: all weights, viewpoint network included; "
        "`build_recogniser(config, classes)` of mvtn makes the networks that take them."
    )
    return "\n".join(lines)


def _axes(shape: tuple[int, ...]) -> str:
    return "B, " + ", ".join(map(str, shape))


def _fixed_cameras(model: Recogniser) -> str:
    selector = model.selector
    if model.config.views == "random":
        return "The cameras are drawn at random, new ones for each shape."
    angles = [", ".join(f"{angle:g}" for angle in side.tolist()) for side in selector.start]
    return (
        f"The cameras stand at azimuths {angles[0]} and elevations {angles[1]} (degrees), "
        f"{selector.distance:g} radii from the centre."
    )
