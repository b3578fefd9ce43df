"""What the page's viewer draws: small meshes or lit points, and their cameras around them."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike, NDArray

from mvtn_cli.core.reporting import plots
from mvtn_cli.core.reporting.gather import Findings, Solid, Views

NEIGHBOURS = 12
SHOWN_SHAPES = 24
DISTANCE, FOV = 2.2, 60.0  # of runs that say neither


def viewer_section(findings: Findings) -> dict[str, Any] | None:
    """The shapes to choose from, and the numbers for the script; None without shapes or cameras."""
    shapes = _shapes(findings)
    if not shapes:
        return None
    num_views = len(shapes[0]["cameras"])
    document = {
        "fov": float(findings.config.get("fov") or FOV),
        "colors": [_css(color) for color in plots.view_colors(num_views)],
        "shapes": [{key: value for key, value in shape.items() if key != "name"} for shape in shapes],
    }
    # numbers, base64 and colours only: there is nothing in it that could end the script element
    return {
        "names": [shape["name"] for shape in shapes],
        "has_start": any(shape["start"] is not None for shape in shapes),
        "data": Markup(json.dumps(document, separators=(",", ":"))),
    }


def _shapes(findings: Findings) -> list[dict[str, Any]]:
    """First those whose views are shown, then mistakes."""
    solids = findings.solids
    found: dict[str, dict[str, Any]] = {}
    for views, start in ((findings.best, findings.start), (findings.mistakes, None)):
        if views is None or (found and views.azimuth_deg.shape[1] != len(next(iter(found.values()))["cameras"])):
            continue
        moved = start is not None and start.names == views.names and start.azimuth_deg.shape == views.azimuth_deg.shape
        wrong = {row["name"]: row["predicted"] for row in findings.result.get("mistakes", [])}
        for i, name in enumerate(views.names):
            if name not in solids or name in found:
                continue
            cameras = _cameras(views, i, findings)
            before = _cameras(start, i, findings) if moved and start is not None else None
            said = f", taken for {wrong[name]}" if views is findings.mistakes and name in wrong else ""
            found[name] = {
                "name": _title(name, int(views.labels[i]), findings) + said,
                **_packed(solids[name]),
                "cameras": cameras,
                "start": before if before != cameras else None,
            }
    return list(found.values())[:SHOWN_SHAPES]


def _packed(solid: Solid) -> dict[str, str]:
    """Coordinates as 16-bit fractions of the radius, normals as 8-bit ones, faces as 16-bit indices."""
    if len(solid.faces):
        return {"vertices": _fractions(solid.vertices), "faces": _text(solid.faces, np.dtype("<u2"))}
    return {"points": _fractions(solid.points), "normals": _text(normals(solid.points) * 127, np.dtype("i1"))}


def _fractions(places: NDArray[np.float32]) -> str:
    return _text(np.clip(places, -1, 1) * 32767, np.dtype("<i2"))


def normals(points: ArrayLike) -> NDArray[np.float64]:
    """Unit normals (P, 3) of points on a surface, of unknown sign: where their neighbours spread the least.

    Fewer than four points have none: they all get +y.
    """
    from scipy.spatial import cKDTree

    points = np.asarray(points, np.float64)
    if len(points) < 4:
        return np.tile([0.0, 1.0, 0.0], (len(points), 1))
    _, near = cKDTree(points).query(points, k=min(NEIGHBOURS, len(points)))
    apart = points[near] - points[near].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("pki,pkj->pij", apart, apart))
    return axes[:, :, 0]


def _cameras(views: Views, shape: int, findings: Findings) -> list[list[float]]:
    """Azimuth, elevation and distance of each view."""
    usual = float(findings.config.get("distance") or DISTANCE)
    distance = np.where(np.isfinite(views.distance[shape]), views.distance[shape], usual)
    columns = views.azimuth_deg[shape], views.elevation_deg[shape], distance
    return np.round(np.stack(columns, axis=1), 2).tolist()


def _title(name: str, label: int, findings: Findings) -> str:
    classes = findings.result["classes"]
    known = classes[label] if 0 <= label < len(classes) else ""
    return f"{known}: {name.removeprefix(f'{known}/')}" if known else name


def _text(numbers: NDArray[Any], kind: np.dtype[Any]) -> str:
    return base64.b64encode(np.round(numbers).astype(kind).tobytes()).decode("ascii")


def _css(color: Any) -> str:
    """The name of the page's variable, or a colour of its own."""
    if isinstance(color, str):
        return f"--{plots.VARIABLES[color]}"
    return "#" + "".join(f"{round(255 * part):02x}" for part in color)
