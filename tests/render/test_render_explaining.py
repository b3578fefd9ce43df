"""`--explain` and `--no-skip`: what is said, and that nothing but time changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from reference import scenes
from reference.drawing import cameras

from mvtn_cli.core.render import render
from mvtn_cli.core.render.explaining import explain
from mvtn_cli.core.render.skips import BITS, EVERYTHING, use_skips, without
from mvtn_cli.core.render.tally import Tally, tally
from mvtn_cli.core.views import Cameras
from mvtn_cli.errors import UsageError

VIEWS = ((20.0, 30.0, 2.2), (-140.0, -70.0, 1.1), (20.0, 30.0, 2.2), (90.0, 0.0, 0.3))
KERNEL = ("frustum", "no-sample", "occluded", "background", "near-clip", "shading-terms", "same-view", "no-gradient")


def many_quads(count: int):
    """More faces than tiles are made for, far ones last."""
    random = np.random.default_rng(0)
    middle = np.sort(random.uniform(-0.8, 0.8, count))[::-1]
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.5
    vertices = np.concatenate([corners * random.uniform(0.2, 1) + [0, 0, z] for z in middle])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(count)])
    return scenes.stored(vertices, faces)


def all_scenes():
    """Thirty: the stiff set and shapes of all kinds."""
    found = {**scenes.stiff(), "quads": many_quads(5000), "box": scenes.box(), "chair": scenes.chair()}
    found |= {"bumpy": scenes.bumpy(12), "icosahedron": scenes.icosahedron()}
    for seed in range(30 - len(found)):
        found[f"soup {seed}"] = scenes.soup(20, seed, colored=seed % 2 == 0)
    return found


SCENES = all_scenes()


def drawn(shape, bits, shading):
    """Image and gradient; the last view has no incoming gradient."""
    views = cameras(*VIEWS)
    leaves = [field.clone().requires_grad_() for field in (views.azimuth_deg, views.elevation_deg, views.distance)]
    look = scenes.look(20, shading=shading, supersample=1 + (shading == "flat"))
    rgb = render(scenes.batch_of(shape), Cameras(*leaves, fov_deg=scenes.FOV), look, skips=bits).rgb
    weights = torch.from_numpy(np.random.default_rng(1).normal(size=rgb.shape)).float()
    weights[:, -1] = 0
    rgb.backward(weights)
    return [rgb.detach().numpy(), *(leaf.grad.numpy() for leaf in leaves)]


@pytest.mark.parametrize("name", [name for name, shape in SCENES.items() if len(shape.faces)])
def test_what_is_left_out_changes_nothing(name):
    shape = SCENES[name]
    for shading in ("smooth", "flat"):
        with_all = drawn(shape, EVERYTHING, shading)
        for skip in KERNEL:
            for found, expected in zip(drawn(shape, without([skip]), shading), with_all, strict=True):
                np.testing.assert_array_equal(found, expected, err_msg=skip)


@pytest.mark.parametrize("shape", [scenes.box(), scenes.icosahedron(), scenes.chair()], ids=["box", "ball", "chair"])
def test_the_back_of_proved_bodies_is_never_seen(shape):
    """But for a sample at a silhouette, where front and back meet within the rounding of a corner."""
    views, look = cameras((20, 30, 2.2), (-140, -70, 1.6), (90, 0, 3.0)), scenes.look(96)
    tally().clear()
    images = [
        render(scenes.batch_of(shape), views, look, skips=bits).rgb for bits in (EVERYTHING, without(["backface"]))
    ]
    assert tally().left_out["backface"] > 0
    assert (images[0] != images[1]).any(dim=2).float().mean() < 1e-3


def test_a_body_that_the_near_plane_cuts_open_shows_its_back():
    distance = float(np.linalg.norm(scenes.icosahedron().vertices, axis=1).max()) + 0.005
    shown = render(
        scenes.batch_of(scenes.icosahedron()), cameras((31.7, 0, distance)), scenes.look(16), outputs=("geometry",)
    )
    assert (shown.face_ids >= 0).all()


def test_the_back_of_what_is_not_proved_is_drawn():
    tally().clear()
    for shape in (
        scenes.flipped(scenes.box()),
        replace(scenes.box(), faces=scenes.box().faces[:-1]),
        scenes.soup(9, 1),
    ):
        render(scenes.batch_of(shape), cameras((20, 30, 2.2)), scenes.look(16))
    render(scenes.batch_of(scenes.box()), cameras((20, 30, 0.1)), scenes.look(16))
    assert tally().left_out["backface"] == 0 and tally().of["backface"] > 0


def test_each_counter_counts_somewhere():
    tally().clear()
    for name in ("quads", "box", "chair", "bumpy"):
        drawn(SCENES[name], EVERYTHING, "smooth")
    counted = {name for name, count in tally().left_out.items() if count}
    assert counted >= {"frustum", "no-sample", "background", "near-clip", "same-view", "no-gradient"}


def test_sentences_say_what_how_much_and_why_not():
    counts = Tally()
    counts.count("frustum", 5, 20)
    said = explain(counts)
    assert said[0] == "frustum: 5 of 20 left out (25 %): faces outside the image or behind the camera"
    assert "nothing left out" in said[1]
    try:
        use_skips(["frustum"])
        assert explain(counts)[0] == "frustum: off (--no-skip)"
    finally:
        use_skips([])


def test_what_has_no_switch_is_said_where_it_was_counted():
    counts = Tally()
    assert not any(sentence.startswith(("point-encoder", "eval-cache")) for sentence in explain(counts))
    counts.count("eval-cache", 128, 160)
    assert explain(counts)[-1].startswith("eval-cache: 128 of 160 left out (80 %): shapes described before")
    with pytest.raises(UsageError, match="eval-cache"):
        without(["eval-cache"])


def test_an_unknown_skip_is_refused_with_the_nearest_name():
    with pytest.raises(UsageError, match="did you mean 'backface'"):
        without(["backfce"])
    assert without(BITS) == 0
