"""How many shapes each distribution officially has, by class and split.

Sources: counts of the OFF release's folders, equal to the lists of `modelnet40_normal_resampled`; rows of SHREC'17's
`all.csv`; rows of ScanObjectNN's `main_split.txt`; sizes of its HDF5 files as its papers and loaders state them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

_MODELNET40 = """
airplane 626 100|bathtub 106 50|bed 515 100|bench 173 20|bookshelf 572 100|bottle 335 100|bowl 64 20|car 197 100
chair 889 100|cone 167 20|cup 79 20|curtain 138 20|desk 200 86|door 109 20|dresser 200 86|flower_pot 149 20
glass_box 171 100|guitar 155 100|keyboard 145 20|lamp 124 20|laptop 149 20|mantel 284 100|monitor 465 100
night_stand 200 86|person 88 20|piano 231 100|plant 240 100|radio 104 20|range_hood 115 100|sink 128 20|sofa 680 100
stairs 124 20|stool 90 20|table 392 100|tent 163 20|toilet 344 100|tv_stand 267 100|vase 475 100|wardrobe 87 20
xbox 103 20
"""
_SHAPENET55 = """
airplane 2832 405 808|trash_bin 227 34 61|bag 58 8 17|basket 77 11 23|bathtub 599 85 172|bed 167 23 43
bench 1260 185 363|birdhouse 51 7 15|bookshelf 310 50 91|bottle 340 43 96|bowl 125 17 34|bus 628 94 186
cabinet 1076 152 315|camera 79 11 23|can 73 13 22|cap 39 5 12|car 2502 353 709|cellphone 404 83 1|chair 4612 662 1317
clock 455 65 131|keyboard 45 6 13|dishwasher 65 9 19|display 762 112 219|earphone 51 7 15|faucet 519 75 148
file_cabinet 208 30 60|guitar 557 80 160|helmet 113 16 33|jar 380 64 120|knife 296 43 85|lamp 1620 232 464
laptop 319 45 87|loudspeaker 1116 158 320|mailbox 65 10 19|microphone 46 7 14|microwaves 107 15 30|motorbike 235 34 68
mug 149 22 43|piano 167 24 48|pillow 67 9 20|pistol 185 26 54|flowerpot 420 61 121|printer 115 16 34|remote 46 6 14
rifle 1656 242 475|rocket 59 9 17|skateboard 106 15 31|sofa 2198 330 631|stove 152 22 44|table 5876 842 1679
telephone 323 23 216|tower 84 13 26|train 272 39 78|watercraft 1356 194 388|washer 116 17 34
"""
_SCANOBJECTNN = """
bag 60 18|bin 161 40|box 94 33|cabinet 272 75|chair 317 78|desk 119 30|display 139 42|door 179 42|shelf 218 49
table 188 54|bed 113 22|pillow 84 21|sink 94 24|sofa 212 42|toilet 65 17
"""
MODELNET10 = ("bathtub", "bed", "chair", "desk", "dresser", "monitor", "night_stand", "sofa", "table", "toilet")

Counts = Mapping[str, Mapping[str, int]]  # class name: split: shapes


@dataclass(frozen=True)
class Official:
    """What a distribution holds.

    Attributes:
        totals: Shapes in each split.
        classes: Shapes in each class and split; empty where only the totals are known.
        short: By how many shapes the distribution itself is known to fall short of this.
        why: What `short` is about.
        numbered: Files are called `CLASS_0001`, numbered through train first, then test.
    """

    totals: Mapping[str, int]
    classes: Counts = field(default_factory=dict, repr=False)
    short: int = 0
    why: str = ""
    numbered: bool = False


def _table(text: str, splits: tuple[str, ...]) -> Counts:
    entries = [entry.split() for line in text.split("\n") for entry in line.split("|") if entry]
    return {name: dict(zip(splits, map(int, counts), strict=True)) for name, *counts in entries}


def _with_totals(classes: Counts, short: int = 0, why: str = "", *, numbered: bool = False) -> Official:
    splits = dict.fromkeys(split for counts in classes.values() for split in counts)
    totals = {split: sum(counts[split] for counts in classes.values()) for split in splits}
    return Official(totals, classes, short, why, numbered)


_modelnet40 = _table(_MODELNET40, ("train", "test"))
_modelnet10 = {name: _modelnet40[name] for name in MODELNET10}
_shapenet55 = _table(_SHAPENET55, ("train", "val", "test"))
_scanobjectnn = _table(_SCANOBJECTNN, ("train", "test"))
_THREE = "the HDF5 release has 9,840 training shapes, three fewer than the meshes"
_V2 = "28 models of the list are believed not to be in ShapeNetCore.v2: papers count 51,162"
_objects = Official({"train": 2309, "test": 581})
_hardest = Official({"train": 11416, "test": 2882})

OFFICIAL: dict[str, Official] = {
    "modelnet40": _with_totals(_modelnet40, numbered=True),
    "modelnet10": _with_totals(_modelnet10, numbered=True),
    "modelnet40-hdf5": _with_totals(_modelnet40, 3, _THREE),
    "modelnet10-hdf5": _with_totals(_modelnet10, 3, _THREE),
    "shapenet55": _with_totals(_shapenet55),
    "shapenet55-v2": _with_totals(_shapenet55, 28, _V2),
    "scanobjectnn-obj_only": _objects,
    "scanobjectnn-with_bg": _objects,
    "scanobjectnn-hardest": _hardest,
    "scanobjectnn-hardest_nobg": _hardest,
    "scanobjectnn-raw": _with_totals(_scanobjectnn),
}
