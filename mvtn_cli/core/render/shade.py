"""What colour does a sample have: one directional light, two-sided; and how samples become pixels.

Radiance = albedo * (ambient + diffuse * max(0, n.l)^falloff) + specular * max(0, r.v)^shininess (no highlight where
n.l <= 0), with v towards the eye and r the mirrored light; albedo = vertex colour * shape colour. A falloff of 1 is
Lambert's law; 2 tells shallow relief apart better.
"""

from __future__ import annotations

import math

from mvtn_cli.core.render.compiled import njit, njit_inline
from mvtn_cli.core.render.skips import SHADING_TERMS

# Columns of the `material` row that the kernels take.
AMBIENT, DIFFUSE, SPECULAR, SHININESS, FALLOFF = 0, 1, 2, 3, 4


@njit
def power(base, exponent):
    """base^exponent for base > 0; by squaring where the exponent is whole, which it nearly always is."""
    whole = int(exponent)
    if whole != exponent or whole > 1024:
        return base**exponent
    result = 1.0
    while whole > 0:
        if whole & 1:
            result *= base
        base *= base
        whole >>= 1
    return result


@njit
def lambert_and_highlight(nx, ny, nz, vx, vy, vz, lx, ly, lz, shiny, material):
    """Return (factor on the albedo, amount added in white) for unit normal, view and light."""
    cosine = nx * lx + ny * ly + nz * lz
    if cosine <= 0.0:
        return material[AMBIENT], 0.0
    highlight = 0.0
    if shiny:
        mirrored = 2.0 * cosine * (nx * vx + ny * vy + nz * vz) - (lx * vx + ly * vy + lz * vz)
        if mirrored > 0.0:
            highlight = material[SPECULAR] * power(mirrored, material[SHININESS])
    return material[AMBIENT] + material[DIFFUSE] * power(cosine, material[FALLOFF]), highlight


@njit
def towards_eye(rt, ray_x, ray_y):
    """Unit vector from where a ray hits to the eye, world frame; it does not matter how far away that is."""
    scale = 1.0 / math.sqrt(ray_x * ray_x + ray_y * ray_y + 1.0)
    return (
        (rt[2, 0] - rt[0, 0] * ray_x + rt[1, 0] * ray_y) * scale,
        (rt[2, 1] - rt[0, 1] * ray_x + rt[1, 1] * ray_y) * scale,
        (rt[2, 2] - rt[0, 2] * ray_x + rt[1, 2] * ray_y) * scale,
    )


@njit_inline
def paint_sample(j, i, rt, focal, lx, ly, lz, albedo, material, shiny, height, width, normal_image, tint, image):
    """Fill `image` at one sample that sees the shape."""
    nx, ny, nz = normal_image[j, i, 0], normal_image[j, i, 1], normal_image[j, i, 2]
    vx = vy = vz = 0.0
    if shiny:
        vx, vy, vz = towards_eye(rt, (i + 0.5 - width * 0.5) / focal, (j + 0.5 - height * 0.5) / focal)
    lambert, highlight = lambert_and_highlight(nx, ny, nz, vx, vy, vz, lx, ly, lz, shiny, material)
    for channel in range(3):
        value = albedo[channel] * tint[j, i, channel] if tint.shape[0] > 0 else albedo[channel]
        image[j, i, channel] = value * lambert + highlight


@njit
def paint(rt, focal, lx, ly, lz, albedo, material, background, skips, box, depth, normal_image, tint, image):
    """Fill `image` (H,W,3) with the colour at each sample centre of the covered box and of one sample around it."""
    height, width = depth.shape
    shiny = material[SPECULAR] > 0.0 or skips & SHADING_TERMS == 0
    for j in range(max(0, box[0] - 1), min(height, box[1] + 2)):
        for i in range(max(0, box[2] - 1), min(width, box[3] + 2)):
            inside = box[0] <= j <= box[1] and box[2] <= i <= box[3]
            if not inside or depth[j, i] == 0.0:
                for channel in range(3):
                    image[j, i, channel] = background[channel]
                continue
            paint_sample(j, i, rt, focal, lx, ly, lz, albedo, material, shiny, height, width, normal_image, tint, image)


@njit
def average(image, box, background, supersample, out):
    """Fill `out` (3,H,W): each pixel is the mean of its supersample^2 samples, background outside the box."""
    for channel in range(3):
        out[channel] = background[channel]
    share = 1.0 / (supersample * supersample)
    for j in range(box[0], box[1] + 1):
        row = j // supersample
        for i in range(box[2], box[3] + 1):
            column = i // supersample
            for channel in range(3):
                # What the sample adds to a pixel that was background all over.
                out[channel, row, column] += (image[j, i, channel] - background[channel]) * share


@njit
def light_of(rt, light):
    """Unit vector towards the light, world frame; a row of zeros is a headlight, which shines along the view."""
    if light[0] == 0.0 and light[1] == 0.0 and light[2] == 0.0:
        return True, rt[2, 0], rt[2, 1], rt[2, 2]
    return False, light[0], light[1], light[2]
