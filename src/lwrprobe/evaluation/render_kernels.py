"""Pictures of meshes and points by depth buffer: orthographic, flat light, no window needed."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel


@kernel
def cover(places, faces, face, share, depth):
    """Which triangle is nearest in each pixel.

    places (n, 3) are pixels across, pixels down and depth (larger is nearer). Written: `face` (h, w), which comes in as
    -1, `share` (h, w, 2) of the triangle's first two corners, and `depth` (h, w), which comes in as -inf.
    """
    height, width = depth.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, bx, by, cx, cy = places[a, 0], places[a, 1], places[b, 0], places[b, 1], places[c, 0], places[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        left, right = max(0, int(np.ceil(min(ax, bx, cx)))), min(width - 1, int(np.floor(max(ax, bx, cx))))
        top, bottom = max(0, int(np.ceil(min(ay, by, cy)))), min(height - 1, int(np.floor(max(ay, by, cy))))
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u < -1e-9 or v < -1e-9 or w < -1e-9:
                    continue
                near = u * places[a, 2] + v * places[b, 2] + w * places[c, 2]
                if near > depth[y, x]:
                    depth[y, x] = near
                    face[y, x] = f
                    share[y, x, 0], share[y, x, 1] = u, v


@kernel
def paint(face, share, faces, colours, light, image):
    """Colour what `cover` found: colours (n, 3) of the vertices, light (m,) of the faces; image (h, w, 4)."""
    height, width = face.shape
    for y in range(height):
        for x in range(width):
            f = face[y, x]
            if f < 0:
                continue
            u, v = share[y, x, 0], share[y, x, 1]
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            for m in range(3):
                value = (u * colours[a, m] + v * colours[b, m] + (1.0 - u - v) * colours[c, m]) * light[f]
                image[y, x, m] = min(max(value, 0.0), 1.0)
            image[y, x, 3] = 1.0


@kernel
def draw_points(places, colours, radius, image, depth):
    """Draw points, placed as in `cover`, with colours (n, 3) as balls of `radius` pixels into image (h, w, 4)."""
    height, width = depth.shape
    for p in range(places.shape[0]):
        px, py = places[p, 0], places[p, 1]
        for y in range(max(0, int(np.ceil(py - radius))), min(height - 1, int(np.floor(py + radius))) + 1):
            for x in range(max(0, int(np.ceil(px - radius))), min(width - 1, int(np.floor(px + radius))) + 1):
                square = ((x - px) ** 2 + (y - py) ** 2) / (radius * radius)
                if square > 1.0:
                    continue
                bulge = np.sqrt(1.0 - square)
                near = places[p, 2] + radius * bulge
                if near > depth[y, x]:
                    depth[y, x] = near
                    for m in range(3):
                        image[y, x, m] = colours[p, m] * (0.55 + 0.45 * bulge)
                    image[y, x, 3] = 1.0


@kernel
def smooth(image, finer, out):
    """Means over `finer` by `finer` pixels of image (h, w, 4), colours weighted by their cover, into out, uint8."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            cover, red, green, blue = 0.0, 0.0, 0.0, 0.0
            for j in range(finer * y, finer * y + finer):
                for i in range(finer * x, finer * x + finer):
                    share = image[j, i, 3]
                    cover += share
                    red += share * image[j, i, 0]
                    green += share * image[j, i, 1]
                    blue += share * image[j, i, 2]
            whole = 255.0 / max(cover, 1e-9)
            out[y, x, 0], out[y, x, 1] = np.uint8(red * whole + 0.5), np.uint8(green * whole + 0.5)
            out[y, x, 2], out[y, x, 3] = np.uint8(blue * whole + 0.5), np.uint8(255.0 * cover / finer**2 + 0.5)
