"""What each data set should look like on disk, and where people get it: said in errors and by `--explain-layout`.

Nothing is ever downloaded: all these data sets have terms that a person has to agree to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import cleandoc

from mvtn_cli.errors import choose_error


@dataclass(frozen=True)
class Layout:
    """One kind of data set, for people.

    Attributes:
        spec: How it is named on a command line.
        title: One line: what it is, how many classes and shapes.
        trees: What is expected below PATH, by the form in which it is distributed; each begins with the up axis.
        source: Where people get it.
        terms: What they agree to.
    """

    spec: str
    title: str
    trees: Mapping[str, str]
    source: str
    terms: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "trees", {form: cleandoc(tree) for form, tree in self.trees.items()})

    def text(self) -> str:
        """Return all of it as lines."""
        lines = [self.spec, f"  {self.title}"]
        for form, tree in self.trees.items():
            lines += ["", f"  {form}:", *(f"    {line}" for line in tree.splitlines())]
        return "\n".join([*lines, "", f"  from:  {self.source}", f"  terms: {self.terms}"])


_MODELNET_SOURCE = (
    "https://modelnet.cs.princeton.edu (ModelNet40.zip, ModelNet10.zip); points: "
    "https://shapenet.cs.stanford.edu/media/modelnet40_ply_hdf5_2048.zip and …/modelnet40_normal_resampled.zip"
)
_MODELNET_TERMS = "no licence stated; academic use, the models belong to those who made them"
_HDF5_TREE = """
    PATH/
      ply_data_train0.h5 … ply_data_train4.h5   data (N, 2048, 3), label (N, 1)
      ply_data_test0.h5, ply_data_test1.h5
      train_files.txt, test_files.txt           which files belong to which split
      shape_names.txt                           the classes in the order of the labels
"""
_RESAMPLED_TREE = """
    PATH/
      modelnet{n}_train.txt, modelnet{n}_test.txt     names of shapes: airplane_0001
      modelnet{n}_shape_names.txt                    the classes in the order of the labels
      airplane/
        airplane_0001.txt                           10,000 lines of x,y,z,nx,ny,nz
        …
      …
"""

LAYOUTS: dict[str, Layout] = {
    "modelnet40": Layout(
        "modelnet40:PATH",
        "ModelNet40: 40 classes of CAD models, 9,843 train and 2,468 test shapes",
        {
            "meshes, OFF (z up)": """
                PATH/
                  airplane/
                    train/airplane_0001.off … airplane_0626.off
                    test/airplane_0627.off … airplane_0726.off
                  bathtub/
                  …
            """,
            "points, HDF5 (y up; the release has 9,840 train shapes)": _HDF5_TREE,
            "points with normals, text (y up)": _RESAMPLED_TREE.format(n=40),
        },
        _MODELNET_SOURCE,
        _MODELNET_TERMS,
    ),
    "modelnet10": Layout(
        "modelnet10:PATH",
        "ModelNet10: ten of the forty classes, 3,991 train and 908 test shapes",
        {
            "meshes, OFF (z up); ModelNet40's folder serves as well": """
                PATH/
                  bathtub/
                    train/bathtub_0001.off … bathtub_0106.off
                    test/bathtub_0107.off … bathtub_0156.off
                  bed/
                  …
            """,
            "points, HDF5 (y up), as for modelnet40": _HDF5_TREE,
            "points with normals, text (y up)": _RESAMPLED_TREE.format(n=10).replace("airplane", "bathtub"),
        },
        _MODELNET_SOURCE,
        _MODELNET_TERMS,
    ),
    "shapenet55": Layout(
        "shapenet55:PATH[@normal|@perturbed]",
        "ShapeNet Core55: 55 classes of CAD models, 35,765 train, 5,159 val and 10,266 test shapes",
        {
            "SHREC'17, OBJ (y up; perturbed: turned at random)": """
                PATH/
                  all.csv                  id,synsetId,subSynsetId,modelId,split (or train.csv and val.csv, before
                                           the test labels were published)
                  train_normal/000003.obj  or model_000003.obj; also train/, where there is no perturbed set
                  val_normal/…
                  test_normal/…
                  train_perturbed/…, val_perturbed/…, test_perturbed/…   for @perturbed
            """,
            "ShapeNetCore.v2, OBJ (y up), split by SHREC'17's list": """
                PATH/
                  all.csv                  or shapenet_split.csv, here or one folder higher; .csv.gz will do
                  02691156/
                    10155655850468db78d106ce0a280f87/models/model_normalized.obj
                    …
                  …                        55 synsets
            """,
        },
        "https://huggingface.co/datasets/ShapeNet (ask for access) or https://shapenet.org; all.csv: "
        "https://shapenet.cs.stanford.edu/shrec17 (the same as data/shapenet_split.csv of github.com/ajhamdi/MVTN)",
        "ShapeNet's terms of use: non-commercial research and teaching; access is given by name",
    ),
    "scanobjectnn": Layout(
        "scanobjectnn:PATH[@obj_only|@with_bg|@hardest|…]",
        "ScanObjectNN: 15 classes of scanned objects; obj_only (the default) and with_bg 2,309 train and 581 test, "
        "hardest 11,416 and 2,882",
        {
            "points, HDF5 (y up)": """
                PATH/                                       or h5_files/ in it; or one split folder itself
                  main_split/                               with background
                    training_objectdataset.h5               @with_bg (OBJ_BG): data (N, 2048, 3), label, mask
                    test_objectdataset.h5
                    training_objectdataset_augmentedrot_scale75.h5   @hardest (PB_T50_RS)
                    test_objectdataset_augmentedrot_scale75.h5
                    …_augmented25_norot.h5, …_augmented25rot.h5, …_augmentedrot.h5   @pb_t25, @pb_t25_r, @pb_t50_r
                  main_split_nobg/                          objects alone
                    training_objectdataset.h5               @obj_only (OBJ_ONLY)
                    test_objectdataset.h5
                    …_augmentedrot_scale75.h5               @hardest_nobg
            """,
            "scans, .bin (y up; all points of the scan; @obj_only and @with_bg)": """
                PATH/                                       or object_dataset/ in it
                  main_split.txt                            here or one folder higher: file, label, t for test
                  bag/
                    005_00020.bin                           count, then 11 float32 a point: x y z, normal, colour,
                    …                                       instance, semantic label
                  …                                         15 classes
            """,
        },
        "https://hkust-vgd.github.io/scanobjectnn (the form there; h5_files.zip, object_dataset.zip); main_split.txt: "
        "training_data/ of github.com/hkust-vgd/scanobjectnn",
        "ScanObjectNN's own terms of use, agreed to in the form; its code is MIT",
    ),
    "folder": Layout(
        "folder:PATH[?up=z], or a plain path",
        "shapes of your own, in any readable format",
        {
            "class folders (y up, z with ?up=z)": """
                PATH/CLASS/train/NAME.off, PATH/CLASS/test/NAME.off      or
                PATH/train/CLASS/NAME.off, PATH/test/CLASS/NAME.off      or
                PATH/CLASS/NAME.off        (a fifth of each class becomes test, by the hash of its name)
            """,
            "without classes": """
                PATH/NAME.off              shapes to draw and to predict, without labels
            """,
        },
        "your disk; val, valid or validation folders are a validation split",
        "yours",
    ),
    "builtin": Layout(
        "builtin:shapes[?train=N&test=N&seed=N], builtin:one-sided[…]",
        "made on the spot: 12 classes of everyday shapes, or 6 of barrels that one view tells apart",
        {"nothing on disk (y up)": "(no files)"},
        "this program",
        "this program's licence",
    ),
}


def layout_of(spec: str) -> Layout:
    """Return the layout that a data set's word (with or without its path) belongs to.

    Raises:
        UsageError: There is no such kind of data set.
    """
    word = spec.partition(":")[0]
    if word not in LAYOUTS:
        raise choose_error("kind of data set", word, LAYOUTS)
    return LAYOUTS[word]


def where(word: str) -> str:
    """Return where people get the data set `word`, for the hint of an error."""
    return f"people get it from {LAYOUTS[word].source}; mvtn preprocess {word} --explain-layout shows the tree"
