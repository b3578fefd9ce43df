"""What rows have in common: values with their sources, and how the three parties differ.

"Released code" is the one that came with the paper (ajhamdi/MVTN); "paper" is its text and supplement.
"""

from __future__ import annotations

from typing import Any

from mvtn_cli.presets.preset import Setting

Settings = dict[str, Setting]

PAPER = "paper"
RELEASED = "released code"
BOTH = "paper and released code"


def sourced(source: str, **values: Any) -> Settings:
    """Values that share a source."""
    return {field: Setting(value, source) for field, value in values.items()}


PICTURES: Settings = (
    sourced(RELEASED, image_size=224, fov=60.0)
    | sourced(f"{PAPER}: colours are random in training, white in testing; released code: white by default",
              color="random")
    | sourced(f"{BOTH}: random in training, from the camera in testing", light="random")
)  # fmt: skip
BACKBONE: Settings = sourced(f"{BOTH}: ResNet-18, pre-trained on ImageNet", backbone="resnet18", weights="imagenet")
TRAINING: Settings = sourced(f"{BOTH}", epochs=100, batch_size=20, weight_decay=0.01)

MESHES: Settings = (
    sourced(RELEASED, distance=2.2)
    | sourced(f"{PAPER}: white behind meshes", look="paper")
    | sourced("the row is about meshes", render="mesh")
)
POINTS: Settings = (
    sourced("ours: the sphere around the shape fills the view; released code: orthographic, 1.0", distance=2.2)
    | sourced("the paper's pictures: black behind points", look="paper")
    | sourced("the row is about points", render="points")
    | sourced(f"{RELEASED}: 0.006 of half the picture, which is this at the shape's centre", point_radius=0.0076)
    | sourced(f"{PAPER}, supplement: points are white in training and testing", color="white", light="headlight")
    | sourced(f"{PAPER}: 30 for points; released code: 20", batch_size=30)
)

NETWORKS: dict[str, Settings] = {
    "mvcnn": (
        sourced("the row", network="mvcnn")
        | sourced(f"{BOTH}: maximum over the views", pool="max")
        | sourced(f"{PAPER}; released code: 1e-3", lr=3e-4)
    ),
    "rotationnet": (
        sourced("the row", network="rotationnet") | sourced(f"{PAPER}, as for MVCNN; released code: 1e-3", lr=3e-4)
    ),
    "viewgcn": (
        sourced("the row", network="viewgcn")
        | sourced(f"{PAPER}: 50 epochs on single pictures, then 35; released code: 30 and 100",
                  epochs=85, first_stage_epochs=50)
        | sourced(f"{PAPER}, both stages; released code: the same, with SGD in the second", lr=1e-3)
    ),
}  # fmt: skip

LEARNED: Settings = (
    sourced(f"{PAPER}; released code: 1e-4", views_lr=1e-3)
    | sourced(f"{BOTH}; the released code clips after its step, without effect", clip=30.0)
    | sourced(f"{BOTH}: PointNet whose 40 outputs are the features; with both T-Nets in the released code",
              encoder="pointnet", tnets=True)
    | sourced(f"{RELEASED}: five linear layers", regressor="reference")
    | sourced(f"{PAPER}: 2,048 on meshes; released code: always", encoder_points=2048)
    | sourced(f"{PAPER}: no noise on learned views (ours by default has some)", explore=0.0)
)  # fmt: skip
VIEWS: dict[str, Settings] = {
    "fixed": sourced("the row: the network's own fixed views", views="fixed"),
    "circular": (
        sourced("the row: a circle of fixed views", views="fixed", layout="circular")
        | sourced(f"{RELEASED}: canonical elevation", elevation=30.0)
    ),
    "spherical": sourced("the row: fixed views all around", views="fixed", layout="spherical"),
    "random": sourced("the row: drawn anew for each shape, also in testing", views="random"),
    "mvtn-circular": (
        sourced("the row", views="learned-circular", layout="circular")
        | sourced(f"{RELEASED}: canonical elevation", elevation=30.0)
        | LEARNED
    ),
    "mvtn-spherical": sourced("the row", views="learned-spherical", layout="spherical") | LEARNED,
    "mvtn-direct": (
        sourced("the row", views="learned-direct") | sourced(f"{PAPER}: bound · tanh", angles="tanh") | LEARNED
    ),
    "mvtn-random": sourced("the row", views="learned-random") | LEARNED,
}  # fmt: skip

NOTE_SELECT = (
    "best epoch: the paper's is the best on the test shapes, and of four runs; here validation shapes choose "
    "(--select test is the paper's habit)"
)
NOTE_RATE = (
    "learning rate: the released code divides it by 10 every 30 epochs (MVCNN, RotationNet) or halves it every 10 "
    "(View-GCN), and never lowers the viewpoint network's; here both follow one cycle"
)
NOTE_LIGHT = "colour and light: the released code draws one of each per batch; here each shape has its own"
NOTE_ENCODER = (
    "point encoder: the released code starts from a PointNet trained on ModelNet40, and what it hands on is "
    "rectified and dropped out; here it starts from nothing"
)
NOTE_CLIP = "released code: the gradient is clipped after the step, and NaN is only mended in a copy: neither works"
NOTE_ANGLES = "angles: the released code feeds raw degrees to the viewpoint network; here their sines and cosines"
NOTES_BY_VIEWS = {
    "random": ("random views: the released code draws elevations evenly, so more views near the poles",),
    "mvtn-circular": ("released code: the circular variant is never trained; its figure is of random offsets",),
    "mvtn-random": ("random starts: the released code draws elevations evenly, so more views near the poles",),
}
NOTES_BY_NETWORK = {
    "rotationnet": (
        "RotationNet: the released code uses the turns of one circle for every layout, and stops at its own default "
        "batch size; here the turns of the layout that views start from",
    ),
    "viewgcn": (
        "View-GCN: the released code loads the first stage from a file by default, takes 12 or 20 views alone, and "
        "its samplers compare groups instead of classes",
    ),
}
NOTE_POINTS = (
    "points: with the released code's blending the picture's gradient is zero almost everywhere; here points are "
    "blended by alpha"
)
