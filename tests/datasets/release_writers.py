"""Tiny copies of data sets as they are distributed, with the defects that the real ones are known for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

# Groups, line elements, a material that is not there, faces as v//vn: all found in real `model_normalized.obj` files.
SHAPENET_OBJ = """# exported
mtllib ./model_normalized.mtl
v 0 0 0
v {width} 0 0
v 0 2 0
v 0 0 1
vn 0 0 1
g mesh1 mesh1-geometry
usemtl material_24
f 1//1 3//1 2//1
f 1//1 2//1 4//1
l 1 2
g mesh2
f 1/1/1 4/1/1 3/1/1
f 2//1 3//1 4//1
"""
COLUMNS = "id,synsetId,subSynsetId,modelId,split"
AIRPLANE, CAR, CAP = "02691156", "02958343", "02954340"


def put(path: Path, content: str | bytes = "") -> Path:
    """Write a file, with its folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


# ModelNet


def off_release(root: Path, counts: Mapping[str, Sequence[int]]) -> Path:
    """Write CLASS/{train,test}/CLASS_0001.off, numbered through; every third with the glued header and CRLF."""
    for name, (train, test) in counts.items():
        for number in range(1, train + test + 1):
            split = "train" if number <= train else "test"
            text = box_off(1 + 0.1 * number + 0.01 * len(name))
            if number % 3 == 0:
                text = text.replace("OFF\n", "OFF").replace("\n", " \r\n")
            put(root / name / split / f"{name}_{number:04d}.off", text)
    return root


def box_off(height: float) -> str:
    """A box on its floor, z up, with quads and one face without area."""
    corners = [f"{x} {y} {z * height}" for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    quads = ["4 0 2 3 1", "4 4 5 7 6", "4 0 1 5 4", "4 2 6 7 3", "4 0 4 6 2", "4 1 3 7 5"]
    return "\n".join(["OFF", f"8 {len(quads) + 1} 0", *corners, *quads, "3 0 0 1"]) + "\n"


def resampled_release(root: Path, rows: Mapping[str, Sequence[str]], names: Sequence[str], number: int = 40) -> Path:
    """Write `modelnet40_normal_resampled` with the shapes of each split; the files have 20 points, not 10,000."""
    put(root / f"modelnet{number}_shape_names.txt", "\r\n".join(names) + "\r\n")
    for split, shapes in rows.items():
        put(root / f"modelnet{number}_{split}.txt", "\n".join(shapes) + "\n")
        for index, shape in enumerate(shapes):
            class_name = shape.rpartition("_")[0]
            put(root / class_name / f"{shape}.txt", point_lines(index + 1000 * (split == "test")))
    put(root / "filelist.txt", "\n".join(shape for shapes in rows.values() for shape in shapes))
    return root


def point_lines(seed: int, count: int = 20) -> str:
    """Lines of x,y,z,nx,ny,nz as in the release: six decimals, commas, no blanks."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    table = np.hstack([rng.uniform(-1, 1, (count, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)])
    return "".join(",".join(f"{value:.6f}" for value in row) + "\n" for row in table)


# ShapeNet


def shapenet_rows(synsets: Sequence[str] = (AIRPLANE, CAP, CAR), each: int = 4) -> list[tuple[str, ...]]:
    """Rows of the list: of each synset the last model is test, the one before val, all others train."""
    rows = []
    for synset in synsets:
        for index in range(each):
            number = len(rows) + 3
            split = {each - 1: "test", each - 2: "val"}.get(index, "train")
            rows.append((f"{number:06d}", synset, f"0{number:07d}", f"{number:032x}", split))
    return rows


def write_list(path: Path, rows: Sequence[Sequence[str]]) -> Path:
    """Write the list as SHREC'17 does."""
    return put(path, "\n".join([COLUMNS, *(",".join(row) for row in rows)]) + "\n")


def core_v2(root: Path, rows: Sequence[tuple[str, ...]]) -> Path:
    """Write ShapeNetCore.v2: SYNSET/MODEL/models/model_normalized.obj, with what else lies beside it."""
    for index, (_, synset, _, model, _) in enumerate(rows):
        models = root / synset / model / "models"
        put(models / "model_normalized.obj", SHAPENET_OBJ.format(width=1 + index / 10))
        put(models / "model_normalized.solid.binvox")
        put(root / synset / model / "images" / "texture0.jpg")
    put(root / "taxonomy.json", "[]")
    return root


def shrec17(root: Path, rows: Sequence[tuple[str, ...]], kinds: Sequence[str] = ("_normal", "_perturbed")) -> Path:
    """Write SHREC'17's split folders; in the perturbed ones the shapes are wider, to tell them apart."""
    for index, (number, _, _, _, split) in enumerate(rows):
        for kind in kinds:
            width = 1 + index / 10 + (100 if kind == "_perturbed" else 0)
            put(root / f"{split}{kind}" / f"model_{number}.obj", SHAPENET_OBJ.format(width=width))
    return root


# ScanObjectNN


def objects_file(path: Path, labels: Sequence[int], points: int = 20, *, mask: bool = True, seed: int = 0) -> Path:
    """Write one of ScanObjectNN's HDF5 files, gzipped as those are; -1 in the mask is background."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed + len(labels))
    with h5py.File(path, "w") as file:
        data = rng.normal(size=(len(labels), points, 3)).astype(np.float32)
        file.create_dataset("data", data=data, compression="gzip")
        file["label"] = np.array(labels, np.uint8)
        if mask:
            file["mask"] = np.where(rng.random((len(labels), points)) < 0.2, -1, 5).astype(np.int32)
    return path


def objects_release(root: Path, suffixes: Sequence[str] = ("", "_augmentedrot_scale75")) -> Path:
    """Write `main_split` and `main_split_nobg`; every file has a number of points of its own."""
    for folder in ("main_split", "main_split_nobg"):
        for index, suffix in enumerate(suffixes):
            points = 20 + 10 * index + (5 if folder == "main_split" else 0)
            for word, labels in (("training", [0, 4, 14, 4]), ("test", [4, 0])):
                objects_file(root / folder / f"{word}_objectdataset{suffix}.h5", labels, points, seed=points)
    return root


def scan(points: int, semantic: Sequence[int], seed: int = 0) -> bytes:
    """A .bin file: the count, then x y z, normal, colour, instance and semantic label of each point, float32."""
    table = np.random.default_rng(seed).normal(size=(points, 11)).astype("<f4")
    table[:, 9] = 7
    table[:, 10] = np.resize(semantic, points)
    return np.float32(points).tobytes() + table.tobytes()


def scans_release(root: Path, points: int = 12) -> Path:
    """Write object_dataset/CLASS/SCENE_OBJECT.bin with main_split.txt; a third of each scan is floor."""
    listing = [
        ("005_00020.bin", "bag", 0, ""),
        ("014_00018.bin", "bag", 0, "t"),
        ("255_00001.bin", "cabinet", 3, ""),
        ("700_00012.bin", "toilet", 14, "t"),
    ]
    for index, (file, name, _, _) in enumerate(listing):
        put(root / "object_dataset" / name / file, scan(points, (36, 36, 2), seed=index))
    lines = ["\t".join(filter(None, (file, str(label), mark))) for file, _, label, mark in listing]
    put(root / "object_dataset" / "main_split.txt", "\n".join(lines) + "\n")
    return root
