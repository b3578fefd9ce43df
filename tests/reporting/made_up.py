"""A made-up run folder: what training and evaluation leave behind, without either."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import tomli_w

from mvtn_cli.core.evaluation.evaluate import judge, mistakes, save_views, write_tables
from mvtn_cli.core.evaluation.files import write_json
from mvtn_cli.core.evaluation.view_analysis import OWN, class_distribution, compare_answers
from mvtn_cli.core.evaluation.view_leak import class_leak, class_spread
from mvtn_cli.core.views import layouts


def ball(size: int, azimuth_deg: float, elevation_deg: float, radius: float) -> np.ndarray:
    """A lit ball with a dent: (3, size, size) uint8, brighter towards the light."""
    y, x = np.mgrid[-1.1 : 1.1 : size * 1j, -1.1 : 1.1 : size * 1j]
    z = np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0))
    spot = np.exp(
        -((x - np.sin(np.radians(azimuth_deg)) / 2) ** 2 + (y + np.sin(np.radians(elevation_deg)) / 2) ** 2) * 8
    )
    shade = np.where(z > 0, 40 + 190 * z / radius - 90 * spot, 0)
    return np.repeat(shade[None].clip(0, 255).astype(np.uint8), 3, axis=0)


def predictions(classes: list[str], per_class: int, num_views: int, known: bool, learned: bool, skill: float) -> Any:
    random = np.random.default_rng(7)
    labels = np.repeat(np.arange(len(classes)), per_class)
    count = len(labels)
    logits = random.normal(size=(count, len(classes))) * 1.4 + skill * np.eye(len(classes))[labels]
    azimuth, elevation = layouts("spherical", num_views)
    azimuth, elevation = np.tile(azimuth, (count, 1)), np.tile(elevation, (count, 1))
    side = random.uniform(-180, 180, count) if known else np.full(count, np.nan)
    if learned:
        azimuth = azimuth + random.normal(25, 14, azimuth.shape)
        elevation = elevation + random.normal(-8, 9, azimuth.shape)
    if known:
        azimuth = side[:, None] + random.normal(0, 18, (count, num_views))
        elevation = random.normal(12, 7, (count, num_views))
    return SimpleNamespace(
        names=tuple(f"{classes[label]}/{classes[label]}_{i:04d}" for i, label in enumerate(labels)),
        labels=labels,
        logits=logits.astype(np.float32),
        azimuth_deg=azimuth.astype(np.float32),
        elevation_deg=elevation.astype(np.float32),
        distance=np.full(azimuth.shape, 2.2, np.float32),
        known_azimuth_deg=side,
    )


def pictures(found: Any, rows: list[int], size: int) -> np.ndarray:
    views = range(found.azimuth_deg.shape[1])
    return np.stack(
        [
            np.stack(
                [ball(size, found.azimuth_deg[i, v], found.elevation_deg[i, v], 0.6 + 0.03 * (i % 10)) for v in views]
            )
            for i in rows
        ]
    )


def analysed(found: Any, classes: list[str]) -> dict[str, Any]:
    """A view analysis in which mean views cost some answers; even shapes are read, odd ones asked."""
    random = np.random.default_rng(1)
    worse = {
        name: found.logits + random.normal(0, noise, found.logits.shape)
        for name, noise in (("per-class-mean", 1.0), ("overall-mean", 2.0))
    }
    answers = {OWN: found.logits, **worse}
    angles = found.azimuth_deg, found.elevation_deg
    read, asked = ((angles[0][i::2], angles[1][i::2], found.labels[i::2]) for i in (0, 1))
    return {
        "skipped": None, "train_count": len(read[2]), "test_count": len(found.labels),
        "views": compare_answers(found.labels, answers, classes),
        "spread": class_spread(*angles, found.labels),
        "leak": class_leak(read, asked, len(classes), trees=20),
        "per_class": class_distribution(found.labels, *angles, answers, classes),
    }  # fmt: skip


def small_shapes(names: list[str], path: Path) -> None:
    """Write shapes.npz: by turns a mesh of a dented ball and points on one."""
    random = np.random.default_rng(5)
    a, e = np.meshgrid(np.linspace(0, 2 * np.pi, 25)[:-1], np.linspace(-np.pi / 2, np.pi / 2, 13), indexing="ij")
    ball = np.stack([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)], axis=-1).reshape(-1, 3)
    ball *= 1 - 0.35 * np.exp(-8 * ((ball - [0.0, 0.3, 0.95]) ** 2).sum(axis=1, keepdims=True))
    i, j = (x.ravel() for x in np.meshgrid(np.arange(24), np.arange(12), indexing="ij"))
    corners = [i * 13 + j, (i + 1) % 24 * 13 + j, (i + 1) % 24 * 13 + j + 1, i * 13 + j + 1]
    faces = np.concatenate([np.stack([corners[0], b, c], axis=1) for b, c in (corners[1:3], corners[2:4])])
    cloud = random.normal(size=(1000, 3))
    cloud /= np.linalg.norm(cloud, axis=1, keepdims=True)
    none = np.zeros((0, 3))
    parts = [(none, ball, faces) if number % 2 == 0 else (cloud, none, none) for number, _ in enumerate(names)]
    kinds = {kind: [part[k] for part in parts] for k, kind in enumerate(("point", "vertex", "face"))}
    np.savez_compressed(
        path, names=np.array(names), points=np.concatenate(kinds["point"]).astype(np.float32),
        vertices=np.concatenate(kinds["vertex"]).astype(np.float32),
        faces=np.concatenate(kinds["face"]).astype(np.uint16),
        **{f"{kind}_counts": list(map(len, arrays)) for kind, arrays in kinds.items()},
    )  # fmt: skip


def make_run(
    folder: Path,
    classes: list[str],
    *,
    per_class: int = 10,
    num_views: int = 6,
    known: bool = False,
    learned: bool = True,
    size: int = 48,
    epochs: int = 30,
    skill: float = 5.0,
    baseline: bool = True,
    analysis: bool = False,
    class_apart_deg: float = 0.0,
) -> Path:
    """Write run.json, config.toml, metrics.jsonl, the view files and an evaluation."""
    found = predictions(classes, per_class, num_views, known, learned, skill)
    found.azimuth_deg += class_apart_deg * found.labels[:, None].astype(np.float32)
    start_azimuth, start_elevation = layouts("spherical", num_views)
    views = ("learned-direct" if known else "learned-spherical") if learned else "fixed"
    config = {
        "views": views, "num_views": num_views, "image_size": size, "backbone": "tiny", "seed": 3,
        "epochs": epochs,
        "layout": "spherical", "dataset": "builtin:shapes", "lr": 3e-3, "select": "val", "gradient": "fd",
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.toml").write_text(tomli_w.dumps(config))
    write_json(folder / "run.json", {"name": folder.name, "classes": classes, "select": "val", "state": "finished"})
    (folder / "metrics.jsonl").write_text(
        "".join(json.dumps(epoch(i, epochs, known, learned)) + "\n" for i in range(epochs))
    )
    sources = [f"/data/{name}.off" for name in found.names]
    wrong = mistakes(found, classes, sources)
    document = {
        "schema": "mvtn.eval/1", "run": str(folder), "split": "test", "checkpoint": "best",
        **judge(found, classes, (start_azimuth, start_elevation) if learned else None),
        "baseline": {"accuracy": 0.714, "accuracy_sd": 0.008, "seeds": [0, 1, 2]} if baseline else None,
        "view_analysis": analysed(found, classes) if analysis else None,
        "mistakes": wrong[:12], "selection": views, "seed": 3, "best": {"epoch": max(1, epochs - 2)},
        "data": {"spec": "builtin:shapes", "title": f"Made-up shapes: {len(classes)} classes, 432 train, "
                 f"48 val, {len(found.labels)} test.", "address": "9f2c51d07ab34e6688c0"},
        "versions": {"mvtn": "0.1.0", "python": "3.11.9", "torch": "2.14.1", "numpy": "2.4.6"},
        "seconds": 6.4, "folder": str(folder),
    }  # fmt: skip
    write_json(folder / "result.json", document)
    write_tables(folder, found, classes, sources)
    rows = [m["index"] for m in wrong[:12]]
    save_views(folder / "mistakes.npz", found, rows, pictures(found, rows, size) if rows else None)
    shown = list(range(0, len(found.labels), max(1, len(found.labels) // 8)))[:8]
    save_views(folder / "views_best.npz", found, shown, pictures(found, shown, size))
    small_shapes(list(dict.fromkeys(found.names[i] for i in [*shown, *rows])), folder / "shapes.npz")
    before = SimpleNamespace(**vars(found))
    before.azimuth_deg = np.tile(start_azimuth, (len(found.labels), 1))
    before.elevation_deg = np.tile(start_elevation, (len(found.labels), 1))
    save_views(folder / "views_start.npz", before, shown, pictures(before, shown, size))
    return folder


def epoch(i: int, epochs: int, known: bool, learned: bool) -> dict[str, Any]:
    t = i / max(1, epochs - 1)
    change = 1 / (1 + np.exp((t - 0.55) * 30))  # the step of the known view
    return {
        "epoch": i + 1, "seconds": 6.2,
        "train_loss": 2.4 * np.exp(-3 * t) + 0.18, "train_accuracy": 1 - 0.9 * np.exp(-3.2 * t),
        "val_loss": 2.4 * np.exp(-3.4 * t) + 0.24 + 0.05 * np.sin(9 * i),
        "val_accuracy": 0.95 - 0.85 * np.exp(-3.6 * t) + 0.01 * np.sin(7 * i),
        "view_error_deg": 14 + 74 * change if known else None,
        "view_spread_deg": 22 * t if learned else 0.0,
    }  # fmt: skip
