"""Real files: what is awkward, what ModelNet, ShapeNet and a shape benchmark hold."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from mvtn_cli.core.shapes import (
    Shape,
    normalise,
    read_shape,
    sample_surface,
    simplify,
    validate,
    vertex_normals,
)
from mvtn_cli.errors import DataError

CLOUD = "a point cloud is a shape here; the manifest asks for meshes"
DIFFERENT = {
    "trimesh__points_ascii.ply": CLOUD,
    "trimesh__points_bin.ply": CLOUD,
    "trimesh__points_emptyface.ply": CLOUD,
    "assimp__points.ply": CLOUD,
}
# As read; `validate` drops and counts what the manifest's reader dropped on the way.
OTHER_TRIANGLES = {"trimesh__notenoughindices.obj": (2, "the face of two corners is kept until validate counts it")}


def sound(shape: Shape) -> bool:
    """Whether a shape goes through every stage with finite numbers."""
    unit, center, radius = normalise(shape)
    normals = vertex_normals(unit.vertices, unit.faces)
    points, _ = sample_surface(unit, 200, seed=0)
    assert np.isfinite(unit.vertices).all() and np.isfinite(center).all() and 0 < radius < np.inf
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    assert np.isfinite(points).all() and np.linalg.norm(points, axis=1).max() <= 1 + 1e-9
    return True


def usable(path: Path) -> Shape | None:
    """Read and mend a file; None where it is refused, which must be in one line."""
    try:
        mended, findings = validate(read_shape(path))
    except DataError as error:
        if not (error.message.isprintable() and path.name in error.message):
            pytest.fail(f"not one line about {path.name}: {error.message!r}")
        return None
    return None if any(finding.fatal for finding in findings) else mended


def test_each_awkward_file_loads_sound_or_is_refused_in_one_line(real_data: Path) -> None:
    with (real_data / "awkward" / "MANIFEST.tsv").open() as manifest:
        rows = list(csv.DictReader(manifest, delimiter="\t"))
    assert len(rows) == 71
    different = []
    for row in rows:
        path = real_data / "awkward" / row["file"]
        mended = usable(path)
        loads = mended is not None
        if mended is not None:
            assert sound(mended), row["file"]
        if loads != row["expected"].startswith("valid"):
            different.append(row["file"])
        elif loads:
            wanted, _ = OTHER_TRIANGLES.get(row["file"], (int(row["triangles"]), ""))
            assert len(read_shape(path).faces) == wanted, row["file"]
    assert sorted(different) == sorted(DIFFERENT)


def test_point_clouds_among_the_awkward_files_keep_points_and_colours(real_data: Path) -> None:
    counts = {name: len(read_shape(real_data / "awkward" / name).points) for name in DIFFERENT}
    assert sorted(counts.values()) == [4, 5, 5, 1024]
    colors = read_shape(real_data / "awkward" / "assimp__points.ply").point_colors
    assert colors is not None
    assert colors.tolist() == [[1, 1, 1], [1, 0, 1], [1, 1, 0], [0, 1, 1]]


def test_vertex_colours_of_glb_and_ply_are_kept(real_data: Path) -> None:
    for name, first in (("trimesh__cubevc.glb", [1, 0, 1]), ("assimp__float-color.ply", [0, 0, 1])):
        colors = read_shape(real_data / "awkward" / name).colors
        assert colors is not None
        assert colors[0].tolist() == first


def test_all_modelnet_files_load_with_the_counts_of_their_header(real_data: Path) -> None:
    paths = sorted((real_data / "modelnet_off").rglob("*.off"))
    assert len(paths) == 23
    for path in paths:
        head = path.read_bytes()[:60].removeprefix(b"OFF").split()
        shape = read_shape(path, up="z")
        assert (len(shape.vertices), len(shape.faces)) == (int(head[0]), int(head[1])), path.name
        mended, findings = validate(shape)
        assert not any(finding.fatal for finding in findings), path.name
        assert sound(mended)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_glued_header_gives_the_geometry_of_its_repaired_twin(real_data: Path, number: int) -> None:
    folder = real_data / "modelnet_off"
    glued = read_shape(folder / f"bathtub_000{number}.off")
    twin = read_shape(folder / "variants" / f"modelnet10__bathtub_000{number}.off")
    assert np.array_equal(glued.vertices, twin.vertices)
    assert np.array_equal(glued.faces, twin.faces)


def test_a_large_modelnet_file_is_simplified_close_to_itself(real_data: Path) -> None:
    shape, _ = validate(read_shape(real_data / "modelnet_off" / "variants" / "rescaled__chair_0059.off"))
    small, report = simplify(shape, 20_000)
    assert report is not None
    assert len(small.vertices) <= 20_000 < report.vertices_before
    assert report.error_percent < 0.1
    assert report.worst_percent < 5
    assert not any(finding.fatal for finding in validate(small)[1])


def test_all_meshes_of_the_benchmark_load_sound_also_the_one_of_huge_extent(real_data: Path) -> None:
    with (real_data / "meshes24" / "index.tsv").open() as index:
        rows = list(csv.DictReader(index, delimiter="\t"))
    assert len(rows) == 576
    extents = {}
    for row in rows:
        path = real_data / "meshes24" / row["class"] / row["split"] / row["file"]
        shape = read_shape(path)
        assert (len(shape.vertices), len(shape.faces)) == (int(row["vertices"]), int(row["faces"])), path.name
        mended, findings = validate(shape)
        assert not any(finding.fatal for finding in findings), path.name
        unit, _, radius = normalise(mended)
        assert np.linalg.norm(unit.vertices, axis=1).max() == pytest.approx(1)
        extents[path.name] = radius
    assert max(extents, key=lambda name: extents[name]) == "m94.off"
    assert extents["m94.off"] > 1e8


def test_shapenet_models_load_with_their_lines_groups_and_missing_materials(real_data: Path) -> None:
    counts = {"model_normalized": (1626, 9402), "poisonwine_hw5": (266, 758), "xingyu_go_mesh": (138, 624),
              "osamarais_moments_loss": (1885, 8130), "mohamed_ebbed_scan2mesh": (1250, 4688),
              "raahii_simple_voxel_viewer": (2932, 10916)}  # fmt: skip
    for path in sorted((real_data / "shapenet" / "models").rglob("*.obj")):
        shape = read_shape(path)
        assert (len(shape.vertices), len(shape.faces)) == counts.pop(shape.name)
        mended, findings = validate(shape)
        assert not any(finding.fatal for finding in findings)
        assert sound(mended)
    assert counts == {}


def test_no_mutilation_of_an_awkward_file_gets_past_as_anything_but_a_shape_or_one_line(
    real_data: Path, tmp_path: Path
) -> None:
    generator = np.random.default_rng(0)
    paths = [p for p in sorted((real_data / "awkward").iterdir()) if p.stat().st_size < 4000 and p.suffix != ".tsv"]
    paths = [p for p in paths if p.name not in {"MANIFEST.tsv", "README.md"}]
    refused = 0
    for path in paths:
        original = path.read_bytes()
        for _ in range(6):
            data = bytearray(original)
            for at in generator.integers(0, max(len(data), 1), 4) if data else ():
                data[at] = generator.choice(np.frombuffer(b"\0\n 09-.e\xff", np.uint8))
            broken = tmp_path / f"x{path.suffix}"
            broken.write_bytes(bytes(data[: generator.integers(len(data) // 2, len(data) + 1)]))
            mended = usable(broken)
            refused += mended is None
            assert mended is None or sound(mended)
    assert refused > len(paths)
