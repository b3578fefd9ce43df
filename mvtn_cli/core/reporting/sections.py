"""What stands in each section of a report: numbers, plots, captions, pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from mvtn_cli.core.evaluation.known_view import signed_errors
from mvtn_cli.core.evaluation.views import standard_angles
from mvtn_cli.core.reporting import plots, words
from mvtn_cli.core.reporting.gather import Findings, Views
from mvtn_cli.core.reporting.images import png_uri
from mvtn_cli.core.views import angle_between
from mvtn_cli.network_config import POINT_NETWORKS

NETWORK_NAMES = {
    "mvcnn": "MVCNN", "rotationnet": "RotationNet", "viewgcn": "View-GCN", "pointnet": "PointNet", "dgcnn": "DGCNN",
}  # fmt: skip
THUMBNAIL, LARGE = 112, 224  # pixels of a picture in the page: it is shown small, and grows by a click
SHOWN_SHAPES = 8
SHOWN_VIEWS = 12
SHOWN_MISTAKES = 12
MISTAKE_VIEWS = 6
SAME_START_DEG = 10.0
MAX_PICTURES = 160  # before and after together
PICTURES_BYTES = 4_000_000  # of all pictures together, so that the page stays below 6 MB


def summary(findings: Findings) -> str:
    """Say in one sentence what was trained on what."""
    config = findings.config
    views, kind = config.get("num_views"), str(config.get("views", ""))
    if not views:
        return ""
    how = {
        "fixed": "fixed", "jittered": "jittered", "random": "random",
        "learned-direct": "learned", "learned-circular": "learned", "learned-spherical": "learned",
        "learned-random": "learned",
    }.get(kind, kind)  # fmt: skip
    anywhere = ("random", "learned-direct", "learned-random", "transferred")
    start = "" if kind in anywhere else f" ({config.get('layout', 'spherical')} layout)"
    if kind in ("learned-circular", "learned-spherical"):
        start = f" that start from a {kind.split('-')[1]} layout"
    noun = "view" if views == 1 else "views"
    title = findings.result["data"]["title"] or findings.result["data"]["spec"]
    title = title[:1].upper() + title[1:]
    name = str(config.get("network", "mvcnn"))
    if name in POINT_NETWORKS:
        return f"{NETWORK_NAMES[name]} on {config.get('encoder_points')} points, without views. {title}"
    network = f"{NETWORK_NAMES[name]}, {config.get('backbone')} backbone, {config.get('image_size')}² pixels"
    return f"{views} {how} {noun}{start}, {network}. {title}"


def headline(findings: Findings) -> list[dict[str, str]]:
    """The few numbers on top: value, what it is, and a word of context."""
    result, epochs = findings.result, findings.epochs
    low, high = result["accuracy_interval"]
    figures = [
        {
            "value": words.percent(result["accuracy"]),
            "label": f"{result['split']} accuracy",
            "note": f"95 % interval {words.span(low, high)}",
        },
        {
            "value": words.percent(result["class_accuracy"]),
            "label": "class accuracy",
            "note": f"mean over {sum(row['count'] > 0 for row in result['per_class'])} classes",
        },
    ]
    if result.get("known_view"):
        known, one = result["known_view"], result["views"]["num_views"] == 1
        figures.append(
            {
                "value": words.degrees(known["median_deg"]),
                "label": "median view error",
                "note": f"{words.percent(known['within_30'], 0)} within 30°" + ("; blind views: 90°" if one else ""),
            }
        )
    if result.get("baseline"):
        baseline = result["baseline"]
        figures.append(
            {
                "value": words.percent(baseline["accuracy"]),
                "label": "without pictures",
                "note": "random forest on distance histograms",
            }
        )
    if epochs:
        seconds = [epoch.get("seconds") for epoch in epochs]
        total = sum(s for s in seconds if s is not None)
        best = (result.get("best") or {}).get("epoch")
        kept = best is not None and result["checkpoint"] == "best"
        figures += [
            {
                "value": words.duration(total),
                "label": "training time",
                "note": f"{words.duration(total / len(epochs))} an epoch",
            },
            {
                "value": str(len(epochs)),
                "label": "epoch" if len(epochs) == 1 else "epochs",
                "note": f"weights of epoch {best}" if kept else "weights of the last",
            },
        ]
    return figures


def learning_curves(findings: Findings) -> list[dict[str, Any]]:
    """Plots over the epochs with their captions; none for a run without epochs."""
    epochs = findings.epochs
    if not epochs:
        return []
    best = _best_index(findings)

    def column(key: str) -> list[float | None]:
        return [epoch.get(key) for epoch in epochs]

    figures = []
    for key, percent in (("loss", False), ("accuracy", True)):
        series = [(name, column(f"{short}_{key}")) for name, short in (("training", "train"), ("validation", "val"))]
        series = [(name, values) for name, values in series if any(v is not None for v in values)]
        if series:
            plot = plots.curves(series, label=key, percent=percent, best_epoch=best)
            figures.append({"plot": Markup(plot), "caption": CAPTIONS[key], "wide": False})
    errors = column("view_error_deg")
    if any(value is not None for value in errors):
        plot = plots.curves(
            [("validation", errors)],
            label="median angle to the known side (°)",
            best_epoch=best,
            reference=(90.0, "blind views") if findings.result["views"]["num_views"] == 1 else None,
        )
        figures.append({"plot": Markup(plot), "caption": CAPTIONS["known"], "wide": False})
    spread = column("view_spread_deg")
    if any((value or 0) > 0.5 for value in spread):
        plot = plots.curves([("validation", spread)], label="spread of the cameras between shapes (°)", best_epoch=best)
        figures.append({"plot": Markup(plot), "caption": CAPTIONS["spread"], "wide": False})
    return figures


CAPTIONS = {
    "loss": "Cross entropy. Training pictures have random colours and lights, and learned views noise: "
    "so the training loss may lie above the validation loss.",
    "accuracy": "The dot marks the epoch whose weights were kept.",
    "known": "Each shape has one side that tells its class. The error falls in a few epochs, or not at all: "
    "judge nothing before that step.",
    "spread": "How much the cameras differ from shape to shape: at 0 every shape gets the same ones.",
}


def camera_section(findings: Findings) -> dict[str, Any] | None:
    """Where the cameras went: plots, captions and numbers; None without cameras."""
    cameras = findings.cameras
    if cameras is None:
        return None
    learned = str(findings.config.get("views", "")).startswith("learned")
    start = _common_start(findings) if learned else None
    statistics = findings.result["views"]
    if statistics is None:
        return None
    figures: list[dict[str, Any]] = []
    known = bool(findings.result.get("known_view"))
    if known:
        turns = signed_errors(cameras.azimuth_deg, cameras.known_azimuth_deg, cameras.elevation_deg)
        before = None if start is None else signed_errors(
            np.broadcast_to(start[0], cameras.azimuth_deg.shape), cameras.known_azimuth_deg
        )  # fmt: skip
        figures.append({"plot": Markup(plots.azimuth_histogram(turns, before)), "caption": _known_caption(findings)})
    alike = not learned and (statistics.get("spread_deg") or 0) < 0.5
    rings = (cameras.azimuth_deg[0], cameras.elevation_deg[0]) if alike else start
    shown = plots.sphere_map(cameras.azimuth_deg, cameras.elevation_deg, rings, dots=not alike)
    figures.append({"plot": Markup(shown), "caption": _map_caption(findings, start is not None, learned, alike)})
    return {
        "figures": figures,
        "statistics": statistics,
        "learned": learned,
        "remarks": [*_remarks(statistics, learned), *_candidates(findings.result.get("model") or {})],
    }


def _known_caption(findings: Findings) -> str:
    known = findings.result["known_view"]
    text = (
        "Azimuth of the nearest view minus that of the side which tells the class, over "
        f"{words.count(known['count'])} shapes. "
        f"{words.percent(known['within_30'], 0)} lie within the shaded ±30°, "
        f"{words.percent(known['over_90'], 0)} look from behind."
    )
    if findings.result["views"]["num_views"] > 1:
        return text
    return f"{text} A camera that knows nothing would give a flat histogram: 17 % within 30°, 50 % behind."


def _map_caption(findings: Findings, has_start: bool, learned: bool, alike: bool) -> str:
    statistics = findings.result["views"]
    text = (
        "The sphere of directions on an equal-area map: azimuth 0° looks from +z and grows to the right, "
        "elevation 90° looks from above. "
    )
    if alike:
        return text + "Rings are the cameras, the same for every shape."
    if not learned:
        return text + "Each dot is a camera of a shape, coloured by view."
    text += f"Each dot is a camera of one {findings.result['split']} shape, coloured by view"
    text += "; numbered rings are where the views started. " if has_start else ". "
    if statistics["moved_deg"] is not None:
        text += f"On average a camera moved {words.degrees(statistics['moved_deg'], 0)} from its start. "
    return text + f"Between shapes the cameras spread by {words.degrees(statistics['spread_deg'], 0)}."


def _remarks(statistics: Mapping[str, Any], learned: bool) -> list[str]:
    """What should make one think: cameras that are alike for every shape, or on top of one another."""
    remarks = []
    if learned and (statistics.get("spread_deg") or 0) < 2:
        remarks.append("The cameras are nearly the same for every shape: one layout was learned, not one a shape.")
    share = statistics.get("coincident_share")
    if share is not None and share > 0.2:
        remarks.append(f"{words.percent(share, 0)} of the views stand within 5° of another view of their shape.")
    return remarks


def _candidates(model: Mapping[str, Any]) -> list[str]:
    """What RotationNet takes for turns of the shape."""
    turns = model.get("candidates")
    if turns is None or turns["layout"] is None:
        return []
    return [
        f"RotationNet tries {turns['count']} turns of each shape: those of the {turns['layout']} layout, "
        "also where learned views have left it."
    ]


def before_and_after(findings: Findings) -> dict[str, Any] | None:
    """Pictures of a few shapes, before and after learning one over the other; None without pictures."""
    best, start = findings.best, findings.start
    if best is None:
        return None
    if start is not None and (start.names != best.names or start.images.shape != best.images.shape):
        start = None
    moved = start is not None and not (
        np.array_equal(start.azimuth_deg, best.azimuth_deg) and np.array_equal(start.elevation_deg, best.elevation_deg)
    )
    stages = [start, best] if moved and start is not None else [best]
    num_views = min(SHOWN_VIEWS, best.azimuth_deg.shape[1])
    size = picture_size(findings)
    rows = range(min(len(best.names), SHOWN_SHAPES, max(1, MAX_PICTURES // (num_views * len(stages)))))
    return {
        "moved": moved,
        "hidden_views": best.azimuth_deg.shape[1] - num_views,
        "shapes": [
            {
                "name": best.names[i],
                "short": _short(best.names[i], _class_name(findings, int(best.labels[i]))),
                "label": _class_name(findings, int(best.labels[i])),
                "views": [[_picture(stage, i, v, size) for stage in stages] for v in range(num_views)],
            }
            for i in rows
        ],
    }


def mistakes(findings: Findings) -> list[dict[str, Any]]:
    """The surest mistakes with their pictures."""
    views = findings.mistakes
    where = {} if views is None else {name: i for i, name in enumerate(views.names)}
    size = picture_size(findings)
    found = []
    for mistake in findings.result.get("mistakes", [])[:SHOWN_MISTAKES]:
        row = where.get(mistake["name"])
        pictures: list[dict[str, Any]] = []
        if views is not None and row is not None:
            pictures = [_picture(views, row, v, size) for v in range(min(MISTAKE_VIEWS, views.azimuth_deg.shape[1]))]
        found.append({**mistake, "short": _short(mistake["name"], mistake["label"]), "pictures": pictures})
    return found


def settings(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every setting of the training, and whether it differs from the default."""
    from mvtn_cli.config import TrainConfig
    from mvtn_cli.core.training.run import NOT_SETTINGS

    fields = TrainConfig.model_fields
    return [
        {
            "name": name.replace("_", "-"),
            "value": str(value).lower() if isinstance(value, bool) else str(value),
            "changed": name in fields and name not in NOT_SETTINGS and value != fields[name].default,
        }
        for name, value in sorted(config.items())
    ]


def picture_size(findings: Findings) -> int:
    """The largest side in pixels of the pictures in the page: 224 where they then stay below 4 MB, else 112."""
    views = findings.best or findings.mistakes
    if views is None or views.azimuth_deg.size == 0:
        return THUMBNAIL
    some = [len(png_uri(images[0], LARGE)) for images in views.images[:SHOWN_SHAPES]]
    most = min(MAX_PICTURES, 2 * views.azimuth_deg.size) + SHOWN_MISTAKES * min(
        MISTAKE_VIEWS, views.azimuth_deg.shape[1]
    )
    return LARGE if most * max(some) < PICTURES_BYTES else THUMBNAIL


def _picture(views: Views, shape: int, view: int, size: int) -> dict[str, str]:
    azimuth, elevation = standard_angles(views.azimuth_deg[shape, view], views.elevation_deg[shape, view])
    return {
        "uri": png_uri(views.images[shape, view], size),
        "azimuth": words.degrees(float(azimuth), 0),
        "elevation": words.degrees(float(elevation), 0),
    }


def _class_name(findings: Findings, label: int) -> str:
    classes: Sequence[str] = findings.result["classes"]
    return classes[label] if 0 <= label < len(classes) else ""


def _short(name: str, label: str) -> str:
    """Leave the class out of `chair/0012` where it stands beside it anyway."""
    return name.removeprefix(f"{label}/") or name


def _best_index(findings: Findings) -> int | None:
    if findings.result["checkpoint"] != "best":
        return len(findings.epochs) - 1
    best = (findings.result.get("best") or {}).get("epoch")
    numbers = [epoch.get("epoch") for epoch in findings.epochs]
    return numbers.index(best) if best in numbers else None


def _common_start(findings: Findings) -> tuple[Any, Any] | None:
    """Azimuth and elevation (M,) before learning, where they are about the same for every shape."""
    start, cameras = findings.start, findings.cameras
    if start is None or cameras is None or start.azimuth_deg.shape[1] != cameras.azimuth_deg.shape[1]:
        return None
    first = start.azimuth_deg[0], start.elevation_deg[0]
    apart = angle_between(start.azimuth_deg, start.elevation_deg, *first)
    return first if apart.max() < SAME_START_DEG else None
