"""The image of one mesh from one camera, sample by sample, in float64."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from reference.rasteriser import View, rasterise, rays


@dataclass(frozen=True)
class Scene:
    """One mesh and how it is lit.

    Attributes:
        vertices, normals: (V, 3).
        faces: (F, 3).
        colors: (V, 3), or None for white.
        albedo: (3,), multiplied with `colors`.
        light: (3,) unit vector towards the light, or None for a headlight.
        background: (3,).
        material: (ambient, diffuse, specular, shininess, falloff).
        smooth: Interpolated normals, or those of the faces.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    colors: np.ndarray | None = None
    albedo: np.ndarray = field(default_factory=lambda: np.ones(3))
    light: np.ndarray | None = None
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    material: tuple[float, ...] = (0.25, 0.75, 0.0, 64.0, 1.0)
    smooth: bool = True


def weights_of_hit(corners: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Return the barycentric weights of where a ray meets the plane of a face, held inside it."""
    weights = np.maximum(np.linalg.solve(corners.T, ray), 0)
    return weights / weights.sum()


def normal_of_hit(scene: Scene, face: np.ndarray, weights: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Return the unit normal towards the eye; corner normals that disagree with their face are turned."""
    a, b, c = scene.vertices[face].astype(np.float64)
    own = np.cross(b - a, c - a)
    own *= np.sign(own @ (eye - a)) / np.linalg.norm(own)
    if not scene.smooth:
        return own
    corners = scene.normals[face].astype(np.float64)
    corners = np.where((corners @ own >= 0)[:, None], corners, -corners)
    mean = weights @ corners
    length = np.linalg.norm(mean)
    return mean / length if length > 1e-4 else own


def radiance(scene: Scene, face: np.ndarray, weights: np.ndarray, rt: np.ndarray) -> np.ndarray:
    """Return the (3,) colour of a point of a face: one directional light, after Phong."""
    eye = -rt[:, :3].T @ rt[:, 3]
    ambient, diffuse, specular, shininess, falloff = scene.material
    light = rt[2, :3] if scene.light is None else scene.light
    normal = normal_of_hit(scene, face, weights, eye)
    to_eye = eye - weights @ scene.vertices[face].astype(np.float64)
    to_eye /= np.linalg.norm(to_eye)
    cosine = normal @ light
    mirrored = (2 * cosine * normal - light) @ to_eye
    highlight = specular * mirrored**shininess if cosine > 0 and mirrored > 0 else 0.0
    albedo = scene.albedo if scene.colors is None else scene.albedo * (weights @ scene.colors[face])
    return albedo * (ambient + diffuse * max(cosine, 0) ** falloff) + highlight


def draw(scene: Scene, rt: np.ndarray, focal: float, size: int, supersample: int = 1) -> np.ndarray:
    """Return the (3, H, W) image; each pixel is the mean of its samples."""
    fine, fine_focal = size * supersample, focal * supersample
    view: View = rasterise(scene.vertices, scene.faces, rt, fine_focal, fine)
    ray = rays(fine_focal, fine)
    image = np.tile(np.array(scene.background, np.float64), (fine, fine, 1))
    for j, i in np.argwhere(view.ids >= 0):
        face = scene.faces[view.ids[j, i]]
        image[j, i] = radiance(scene, face, weights_of_hit(view.camera[face], ray[j, i]), rt)
    return image.reshape(size, supersample, size, supersample, 3).mean(axis=(1, 3)).transpose(2, 0, 1)
