"""Objects by kind and seed: closed meshes, 60 to 120 mm long, that stand stably on the table; many overhang.

Solids are put together in millimetres by Manifold (https://github.com/elalish/manifold), whose results are closed and
manifold for any input. All numbers come from one generator, seeded by kind and seed: the same object on every machine,
but for the last digits of its coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from zlib import crc32

import numpy as np
import trimesh
from manifold3d import CrossSection, Manifold, Mesh64
from scipy.interpolate import PchipInterpolator
from scipy.spatial import ConvexHull

Draw = np.random.Generator

_LENGTHS = (60.0, 120.0)  # mm, of the longest side of the upright box around an object
_HIGHEST = 90.0  # mm, what the probe on its arm gets over and beside
_SHORTEST_EDGE = 0.005  # mm; what the simulator's distances have no use for
_SEGMENTS = 96  # of a circle: within 0.03 mm of it at 60 mm
_SUBDIVISIONS = 5  # of an icosahedron: edges of 2 mm at 60 mm
_SAME_FACE = 1e-4  # between the planes of the triangles of one face: direction, and mm


@lru_cache(maxsize=32)
def random_mesh(kind: str, seed: int, length: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) m and faces (m, 3) of an object that stands on z = 0 with its upright box about the z axis.

    `kind` is one of `KINDS`, `seed` any whole number from 0 up, `length` m of the longer level side of the box. An
    object with a length that would be too high with it is pressed flat; without one it is made smaller as a whole.
    """
    draw = np.random.default_rng([seed, crc32(kind.encode())])
    solid = KINDS[kind](draw)
    if kind not in _UPRIGHT:
        solid = _set_down(solid, draw)
    solid = _largest_piece(solid.rotate((0.0, 0.0, draw.uniform(0.0, 360.0))))
    lower, upper = np.split(np.array(solid.bounding_box()), 2)
    size = upper - lower
    drawn, flattest = draw.uniform(*_LENGTHS) / size.max(), _HIGHEST / size[2]
    wide = min(drawn, flattest) if length is None else 1e3 * length / size[:2].max()
    solid = solid.scale((wide, wide, min(wide, flattest))).simplify(_SHORTEST_EDGE)
    mesh = solid.to_mesh64()
    vertices, faces = np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts, dtype=np.int64)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    vertices = vertices - np.array([*(0.5 * (lower + upper))[:2], lower[2]])
    vertices, faces = np.round(1e-3 * vertices, 10), np.ascontiguousarray(faces)
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces


def hull(draw: Draw) -> Manifold:
    """The convex hull of random points."""
    points = draw.standard_normal((draw.integers(8, 40), 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True) ** draw.uniform(0.3, 1.0)
    return Manifold.hull_points(points * _sizes(draw))


def bumps(draw: Draw) -> Manifold:
    """A rounded box or ball with bumps and hollows."""
    power, sizes = draw.uniform(2.0, 6.0), 0.5 * _sizes(draw)
    places = _directions(draw, draw.integers(4, 12))
    heights, widths = draw.uniform(-0.12, 0.25, len(places)), draw.uniform(0.15, 0.45, len(places))

    def radius(u: np.ndarray) -> np.ndarray:
        base = (np.abs(u / sizes) ** power).sum(axis=1) ** (-1.0 / power)
        angles = np.arccos(np.clip(u @ places.T, -1.0, 1.0))
        return base * (1.0 + np.exp(-0.5 * (angles / widths) ** 2) @ heights)

    return _cut_flat(_star(radius), draw)


def extrusion(draw: Draw) -> Manifold:
    """A random outline, drawn out straight, tapered, widened or twisted."""
    height = draw.uniform(25.0, 80.0)
    top = draw.uniform(0.6, 1.3, 2) if draw.random() < 0.5 else np.ones(2)
    twist = draw.uniform(-40.0, 40.0) if draw.random() < 0.3 else 0.0
    outline = CrossSection([_outline(draw)])
    return Manifold.extrude(outline, height, 24 if twist else 0, twist, (float(top[0]), float(top[1])))


def revolution(draw: Draw) -> Manifold:
    """A random outline turned about an axis: necks, plates, feet."""
    rings = draw.integers(4, 8)
    heights = np.cumsum(draw.uniform(6.0, 25.0, rings))
    radii = draw.uniform(12.0, 45.0, rings)
    if draw.random() < 0.5:  # rounded
        fine = np.linspace(heights[0], heights[-1], 8 * rings)
        radii, heights = np.maximum(_smooth(heights, radii, fine), 8.0), fine
    ends = [[0.0, heights[-1]], [0.0, heights[0]]]
    profile = np.concatenate([np.column_stack([radii, heights]), ends])
    return Manifold.revolve(CrossSection([profile]), _SEGMENTS)


def boolean(draw: Draw) -> Manifold:
    """Primitives that grow into one another, less others."""
    solid = _primitive(draw)
    for _ in range(draw.integers(1, 4)):
        solid += _primitive(draw).translate(tuple(draw.uniform(-30.0, 30.0, 3)))
    for _ in range(draw.integers(1, 3)):
        beside = 35.0 * _directions(draw, 1)[0]
        solid -= _primitive(draw).scale((0.6, 0.6, 0.6)).translate(tuple(beside))
    return _largest_piece(solid)


def organic(draw: Draw) -> Manifold:
    """A smooth lump: spherical harmonics, or balls that flow together; some are bent."""
    solid = _star(_harmonics(draw) if draw.random() < 0.5 else _flowing_balls(draw))
    if draw.random() < 0.5:
        solid = _bent(solid, draw.uniform(1.3, 3.0))
    return _cut_flat(solid, draw)


def thin(draw: Draw) -> Manifold:
    """Walls and rods, 2.5 to 8 mm thick, upright or leaning, on a plate."""
    length, width = draw.uniform(60.0, 100.0), draw.uniform(35.0, 70.0)
    solid = _box(length, width, draw.uniform(3.0, 8.0))
    for _ in range(draw.integers(1, 3)):
        wall = _box(draw.uniform(25.0, 0.8 * length), draw.uniform(2.5, 6.0), draw.uniform(25.0, 60.0))
        solid += _planted(wall, draw, length, width, 20.0)
    for _ in range(draw.integers(1, 4)):
        rod = Manifold.cylinder(draw.uniform(25.0, 55.0), draw.uniform(2.0, 4.0), -1.0, 48)
        solid += _planted(rod, draw, length, width, 35.0)
    return solid


def steps(draw: Draw) -> Manifold:
    """Stairs with slots from above and from the sides."""
    count, width = draw.integers(2, 5), draw.uniform(35.0, 70.0)
    treads, rises = draw.uniform(12.0, 32.0, count), draw.uniform(6.0, 18.0, count)
    ends = np.cumsum(treads)
    heights = np.cumsum(rises)[draw.permutation(count)] if draw.random() < 0.5 else np.cumsum(rises)
    solid = Manifold()
    for end, tread, height in zip(ends, treads, heights):
        solid += _box(tread + 0.02, width, height).translate((end - 0.5 * tread, 0.0, 0.0))
    top, length = heights.max(), ends[-1]
    for _ in range(draw.integers(1, 4)):
        gap, depth = draw.uniform(6.0, 22.0), draw.uniform(0.25, 0.6)
        along = draw.uniform(0.15, 0.85) * length
        if draw.random() < 0.6:  # from above, across the stairs
            solid -= _box(gap, 2.0 * width, top).translate((along, 0.0, (1.0 - depth) * top))
        else:  # from one side: what is above it overhangs
            side = draw.choice([-0.5, 0.5]) * width
            low, tall = draw.uniform(0.1, 0.4) * top, draw.uniform(0.3, 0.5) * top
            solid -= _box(2.0 * gap, 2.0 * depth * width, tall).translate((along, side, low))
    return _largest_piece(solid)


def stack(draw: Draw) -> Manifold:
    """Blocks, discs and prisms on one another, each turned and shifted; the wider ones overhang."""
    solid, top, half = Manifold(), 0.0, 40.0
    centre = np.zeros(2)
    for n in range(draw.integers(2, 5)):
        height, size = draw.uniform(10.0, 30.0), draw.uniform(30.0, 80.0)
        kind = draw.integers(3)
        if kind == 0:
            piece = _box(size, draw.uniform(0.6, 1.0) * size, height)
        else:
            piece = Manifold.cylinder(height, 0.5 * size, -1.0, _SEGMENTS if kind == 1 else int(draw.integers(3, 8)))
        # The whole stays up: each middle lies over all that is below it, within a quarter of the narrowest.
        half = min(half, 0.25 * size)
        if n:
            centre = centre + draw.uniform(-0.3, 0.3, 2) * half
        solid += piece.rotate((0.0, 0.0, draw.uniform(0.0, 90.0))).translate((*centre, top - 0.02))
        top += height - 0.02
    return solid


KINDS: dict[str, Callable[[Draw], Manifold]] = {
    make.__name__: make for make in (hull, bumps, extrusion, revolution, boolean, organic, thin, steps, stack)
}
"""What makes an object of each kind, in any size and pose."""

_UPRIGHT = ("thin", "steps", "stack")  # stand as they are made


def _sizes(draw: Draw) -> np.ndarray:
    return draw.uniform(45.0, 100.0, 3)


def _directions(draw: Draw, count: int | np.integer) -> np.ndarray:
    vectors = draw.standard_normal((count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _box(length: float, width: float, height: float) -> Manifold:
    """Centred over the origin, standing on z = 0."""
    return Manifold.cube((length, width, height), True).translate((0.0, 0.0, 0.5 * height))


def _primitive(draw: Draw) -> Manifold:
    """A box, ball, cylinder, cone or ring of 30 to 70 mm, turned any way."""
    size, kind = draw.uniform(30.0, 70.0), draw.integers(5)
    if kind == 0:
        solid = Manifold.cube(tuple(size * draw.uniform(0.4, 1.0, 3)), True)
    elif kind == 1:
        solid = Manifold.sphere(0.5 * size, _SEGMENTS)
    elif kind == 2:
        solid = Manifold.cylinder(
            size * draw.uniform(0.5, 1.0), 0.5 * size * draw.uniform(0.4, 1.0), -1.0, _SEGMENTS, True
        )
    elif kind == 3:
        solid = Manifold.cylinder(
            size * draw.uniform(0.5, 1.0), 0.5 * size, 0.5 * size * draw.uniform(0.2, 0.7), _SEGMENTS, True
        )
    else:
        tube = CrossSection.circle(size * draw.uniform(0.12, 0.2), 48).translate((0.35 * size, 0.0))
        solid = Manifold.revolve(tube, _SEGMENTS)
    return solid.rotate(tuple(draw.uniform(0.0, 360.0, 3))) if draw.random() < 0.6 else solid


def _planted(part: Manifold, draw: Draw, length: float, width: float, lean: float) -> Manifold:
    """A wall or rod on a plate, leaning by up to `lean` degrees or not at all, its foot inside of the plate."""
    angles = (draw.uniform(-lean, lean), draw.uniform(-lean, lean)) if draw.random() < 0.5 else (0.0, 0.0)
    place = draw.uniform(-0.3, 0.3, 2) * (length, width)
    turned = part.translate((0.0, 0.0, -2.0)).rotate((*angles, draw.uniform(0.0, 180.0)))
    return turned.translate((*place, 3.0)).trim_by_plane((0.0, 0.0, 1.0), 0.5)


def _outline(draw: Draw) -> np.ndarray:
    """(n, 2) mm, counter-clockwise: waves about a circle, a star with straight sides, or an angle bracket."""
    kind = draw.integers(3)
    if kind == 0:
        turn = np.linspace(0.0, 2.0 * np.pi, 160, endpoint=False)
        radius = np.full(len(turn), 32.0)
        for n in range(2, 6):
            radius += draw.uniform(-12.0, 12.0) / (n - 1) * np.cos(n * turn + draw.uniform(0.0, 2.0 * np.pi))
        radius = np.maximum(radius, 8.0)
    elif kind == 1:
        corners = draw.integers(5, 11)
        turn = 2.0 * np.pi * (np.arange(corners) + draw.uniform(-0.3, 0.3, corners)) / corners
        radius = draw.uniform(16.0, 45.0, corners)
    else:
        a, b, s, t = *draw.uniform(50.0, 90.0, 2), *draw.uniform(15.0, 30.0, 2)
        bracket = np.array([[0, 0], [a, 0], [a, s], [t, s], [t, b], [0, b]])
        if draw.random() < 0.5:  # a channel: a second leg
            bracket = np.array([[0, 0], [a, 0], [a, b], [a - t, b], [a - t, s], [t, s], [t, b], [0, b]])
        return bracket
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])


def _smooth(places: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    return PchipInterpolator(places, values)(at)


def _star(radius: Callable[[np.ndarray], np.ndarray]) -> Manifold:
    """The solid whose surface lies at `radius` of each direction from its middle."""
    ball = trimesh.creation.icosphere(subdivisions=_SUBDIVISIONS)
    u = np.asarray(ball.vertices)
    return Manifold(Mesh64(radius(u)[:, None] * u, np.asarray(ball.faces, dtype=np.uint64)))


def _harmonics(draw: Draw) -> Callable[[np.ndarray], np.ndarray]:
    """A ball of 40 mm, stretched, with random waves of the degrees 2 to 5."""
    waves = [(n, _directions(draw, 1)[0], draw.uniform(-0.2, 0.2)) for n in range(2, 6) for _ in range(3)]
    stretch = draw.uniform(0.6, 1.3, 3)

    def radius(u: np.ndarray) -> np.ndarray:
        # Legendre polynomials about random axes: each is a spherical harmonic of its degree.
        total = sum(a * np.polynomial.legendre.Legendre.basis(n)(u @ axis) for n, axis, a in waves)
        return 40.0 / np.linalg.norm(u / stretch, axis=1) * np.exp(total)

    return radius


def _flowing_balls(draw: Draw) -> Callable[[np.ndarray], np.ndarray]:
    """Balls that all hold the middle, joined by a smooth minimum of their distances: a star about the middle."""
    count = draw.integers(3, 6)
    radii = draw.uniform(14.0, 26.0, count)
    centres = (
        _directions(draw, count) * (0.9 * radii * draw.uniform(0.6, 1.0, count))[:, None] * draw.uniform(0.9, 1.05)
    )
    blend = draw.uniform(2.0, 6.0)

    def radius(u: np.ndarray) -> np.ndarray:
        low, high = np.zeros(len(u)), np.full(len(u), 150.0)
        for _ in range(50):
            middle = 0.5 * (low + high)
            gaps = np.linalg.norm(middle[:, None, None] * u[:, None] - centres, axis=2) - radii
            inside = -blend * np.log(np.exp(-gaps / blend).sum(axis=1)) < 0.0
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return low

    return radius


def _bent(solid: Manifold, tightness: float) -> Manifold:
    """Bent about the y axis, `tightness` times as wide a bend as the solid is thick: nothing meets itself."""
    radius = tightness * max(abs(solid.bounding_box()[2]), abs(solid.bounding_box()[5]))

    def bend(points: np.ndarray) -> np.ndarray:
        turn, out = points[:, 0] / radius, radius + points[:, 2]
        return np.column_stack([out * np.sin(turn), points[:, 1], out * np.cos(turn) - radius])

    return solid.warp_batch(bend)


def _cut_flat(solid: Manifold, draw: Draw) -> Manifold:
    """Two of three with a flat face on some side, cut off by a plane."""
    if draw.random() < 1.0 / 3.0:
        return solid
    up = _directions(draw, 1)[0]
    heights = np.array(solid.to_mesh64().vert_properties)[:, :3] @ up
    level = heights.min() + draw.uniform(0.06, 0.3) * np.ptp(heights)
    return _largest_piece(solid.trim_by_plane(tuple(up), float(level)))


def _largest_piece(solid: Manifold) -> Manifold:
    """What remains in one piece; the scraps that a cut leaves are dropped."""
    return max(solid.decompose(), key=lambda piece: piece.volume())


def _set_down(solid: Manifold, draw: Draw) -> Manifold:
    """On a face of its convex hull on which it stands: the foot of its centre of mass lies within the face.

    Of several the face is drawn by its area. A round solid has few such faces, small ones below its middle.
    """
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties)[:, :3]
    middle = trimesh.Trimesh(vertices, np.array(mesh.tri_verts, dtype=np.int64), process=False).center_mass
    around = ConvexHull(vertices)
    normals, offsets = around.equations[:, :3], around.equations[:, 3]
    a, b, c = (vertices[around.simplices[:, k]] for k in range(3))
    foot = middle - (normals @ middle + offsets)[:, None] * normals
    inside = np.ones(len(normals), dtype=bool)
    for p, q, opposite in ((a, b, c), (b, c, a), (c, a, b)):
        side = np.einsum("ij,ij->i", np.cross(q - p, foot - p), np.cross(q - p, opposite - p))
        inside &= side >= 0.0
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    resting = np.flatnonzero(inside)
    same = np.abs(around.equations[resting][:, None] - around.equations).max(axis=2) < _SAME_FACE
    chances = same @ areas
    down = normals[draw.choice(resting, p=chances / chances.sum())]
    return solid.transform(_turn_down(down))


def _turn_down(normal: np.ndarray) -> np.ndarray:
    """(3, 4) rotation that turns a direction down."""
    aside = np.eye(3)[np.argmin(np.abs(normal))]
    x = np.cross(aside, normal)
    x /= np.linalg.norm(x)
    return np.column_stack([np.array([x, np.cross(-normal, x), -normal]), np.zeros(3)])
