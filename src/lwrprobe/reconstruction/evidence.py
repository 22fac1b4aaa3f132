"""Where nothing was touched: what must be solid, what must be free, and where the surface runs in between.

Lines leave gaps: the object ends, or a wall stands, somewhere between the last line that touched and the first
that did not. There the surface is bounded on both sides. Without any other hint it is put half way; but when the
last line's normals lean towards the gap, the drop of the surface since the line before shows whether a sharp
edge (the sphere rolls over it: an arc of its own radius) or a rounding has begun, and where it will end.

Such a guess is worth less than contacts near it, and than those on both sides of it that face the same way. Where they
say, in the second case with a deviation not much larger than the guess's, that the surface passes between solid and
free, the guess is dropped; where they say that it passes where the sphere has been, the guess goes to the border of
that space. Contacts near it also count against solid evidence: below a contact whose normal leans down a little the
column is taken to be solid, and the surface recedes. Beside contacts whose normals lean down more it goes on inwards,
below what the stick lets the sphere reach: there each guess is dropped.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lwrprobe.reconstruction.evidence_kernels import (
    curvature_radii,
    extrapolate,
    mark_above,
    mark_below,
    mark_places,
    upstream,
)
from lwrprobe.reconstruction.grid import Grid
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField

_CURVATURE_NOISE = 1.2e-4  # m, of the drop between two lines
_EVIDENCE_FLOOR = 3e-4  # m, no extrapolation is better than this
_WALL_NORMAL_SD = 0.2  # rad
_THIN = 0.8  # of the distance wanted between guesses: edge of the cells that hold one each
_SUPPORTED = 0.7  # of the same: nearer than that to a contact nothing has to be guessed
_TOGETHER = 2.5
"""Times the deviation of a guess: that squared, as many lie within a correlation length of the field and err alike."""
_BESIDE = 1.0  # of the reach: contacts on the lines on either side of a guess are that near
_ALIKE = 0.8  # cosine between a guess's direction and the normals of contacts that the surface leads on
LEANING = -0.15  # z of the normals of contacts under which the surface goes on inwards; less is noise
_FAR_BELOW = 1.5  # of the reach: how far under such contacts
_TOWARDS = 0.3  # cosine between such a normal and the direction of a guess that it makes needless
_STRAIGHT = 0.7  # cosine between a guess's direction, along a face, and the way to contacts before and behind it
_STEP = 0.05  # of the reach: contacts that far from one plane at most are on one face
_CERTAIN = 0.3
"""Share of the field's deviation without contacts, up to which these say where the surface is: a pitch beside them."""
_TRUSTED = 4.0
"""Times a guess's deviation that the contacts' own may have: the guesses beside one another err the same way."""


@dataclass(slots=True)
class Evidence:
    """Solid and free space around the touches, on a grid.

    Attributes
    ----------
    bound : (nx, ny, nz) m, negative where the sphere's centre cannot have been, positive where it could; half way
        between touched and free at zero
    solid_place, free_place : (nx, ny, nz, 3) m, the nearest evidence of either kind
    solid_contact : (nx, ny, nz) the contact that the nearest solid evidence comes from
    """

    grid: Grid
    bound: np.ndarray
    solid_place: np.ndarray
    free_place: np.ndarray
    solid_contact: np.ndarray


def gather(
    grid: Grid,
    points: np.ndarray,
    normals: np.ndarray,
    visited: np.ndarray,
    stood: np.ndarray,
    touching: int,
    radius: float,
) -> Evidence:
    """Evidence from contacts (n, 3), their normals, and the centres (k, 3) that the sphere visited.

    The stick was upright where it `stood` (k,) bool: only there nothing is above. The first `touching` of the centres
    are those of contacts.
    """
    from scipy.ndimage import distance_transform_edt

    solid, free = np.full(grid.shape, -1, dtype=np.int64), np.full(grid.shape, -1, dtype=np.int64)
    mark_places(visited, grid.origin, grid.step, free)
    mark_below(points, normals, radius, grid.origin, grid.step, free, touching, solid)
    mark_above(visited, stood, grid.origin, grid.step, solid, free)
    nodes = grid.nodes()
    places = []
    for marks, source in ((solid, points), (free, visited)):
        _, at = distance_transform_edt(marks < 0, return_indices=True)
        at = tuple(at)
        place = source[np.maximum(marks[at], 0)]
        # It counts along its column; in its own node it is where it was, no half cell below.
        height = grid.origin[2] + grid.step * at[2]
        place[..., 2] = np.where(np.abs(height - place[..., 2]) > 0.5 * grid.step, height, place[..., 2])
        places.append(place)
        if marks is solid:
            contact = marks[at]
    to_solid, to_free = (np.linalg.norm(nodes - place, axis=-1) for place in places)
    bound = to_solid - radius - to_free
    bound[solid >= 0] = -radius
    return Evidence(grid, bound, places[0], places[1], contact)


@dataclass(slots=True)
class Walls:
    """Where the surface of the sphere's centres must run although no contact is near.

    Attributes
    ----------
    data : Hermite data, its `value_sd` such that guesses beside one another weigh no more than one
    deviation : (n,) m, of each guess, from the width of what is possible
    """

    data: HermiteData
    deviation: np.ndarray

    def __len__(self) -> int:
        return len(self.data.points)


def find_walls(evidence: Evidence, known: HermiteField, contacts: np.ndarray, settings: WallSettings) -> Walls:
    """Walls between solid and free evidence.

    Parameters
    ----------
    known : the field of the clustered contacts alone
    contacts : (n, 3) centres of the single contacts, as numbered in `evidence`
    """
    centres, normals = known.data.points, known.data.normals
    start, direction, gap, contact = _unsupported(evidence, centres, settings)
    start, direction, gap, contact = _thin(start, direction, gap, contact, _THIN * settings.apart)
    place, facing = start + 0.5 * gap[:, None] * direction, direction.copy()
    deviation = gap / np.sqrt(12.0)
    for rows, arcs in _arcs(direction, centres, normals, settings):
        for row in rows:
            _refine(row, arcs, start, direction, gap, contacts[contact[row]], settings, place, facing, deviation)
    kept = _bound(known, start, start + gap[:, None] * direction, place, direction, deviation)
    place, facing, deviation = place[kept], facing[kept], deviation[kept]
    normal_sd = np.full(len(place), _WALL_NORMAL_SD)
    return Walls(HermiteData(place, facing, _TOGETHER * deviation, normal_sd), deviation)


def _bound(
    known: HermiteField,
    start: np.ndarray,
    end: np.ndarray,
    place: np.ndarray,
    direction: np.ndarray,
    deviation: np.ndarray,
) -> np.ndarray:
    """(n,) bool: the guesses that remain; where contacts put the surface beyond a gap's `end`, a guess goes there.

    `place` (n, 3) and `deviation` (n,) are changed in place.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(known.data.points)
    distance, nearest = tree.query(place)
    facing = known.data.normals[nearest]
    own = known.deviations(place)
    certain, trusted = own < _CERTAIN * np.sqrt(known.variance), own < _TRUSTED * deviation
    certain &= np.einsum("ij,ij->i", facing, direction) > _ALIKE  # not those of a face before an edge
    # However sure the arcs of lines far above are of a guess: they know of no overhang.
    kept = ~_under(facing, direction, distance, known.reach)
    near = tree.query_ball_point(place, _BESIDE * known.reach)
    led = _between(known.data, near, place, direction) | _across(known, near, place, direction, facing)
    sure = np.flatnonzero(kept & (certain | trusted & led))
    at_start, at_end = known.values_near(place[sure], np.stack([start[sure], end[sure]], axis=1)).T
    kept[sure[(at_end >= 0.0) & ((at_start <= 0.0) | certain[sure])]] = False
    beyond = sure[(at_start <= 0.0) & (at_end < 0.0)]
    place[beyond] = end[beyond]
    deviation[beyond] = np.minimum(deviation[beyond], _EVIDENCE_FLOOR)
    return kept


def _under(facing: np.ndarray, direction: np.ndarray, distance: np.ndarray, reach: float) -> np.ndarray:
    """(n,) bool: the nearest contacts, with normals `facing` (n, 3), lean down, and not against `direction` (n, 3)."""
    towards = np.einsum("ij,ij->i", facing, direction) > _TOWARDS
    return (facing[:, 2] < LEANING) & towards & (distance < _FAR_BELOW * reach)


def _between(known: HermiteData, near: Sequence[list[int]], place: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(n,) bool: of the contacts `near` places (n, 3), some on two sides face the way of `direction` (n, 3): no edge
    lies there.
    """
    found = np.zeros(len(place), dtype=bool)
    for i, rows in enumerate(near):
        aside, _ = _aside(known, rows, place[i], direction[i])
        found[i] = bool((aside @ aside.T < 0.0).any())
    return found


def _across(
    known: HermiteField, near: Sequence[list[int]], place: np.ndarray, direction: np.ndarray, facing: np.ndarray
) -> np.ndarray:
    """(n,) bool: of the contacts `near` places (n, 3), some before and some behind, along `direction` (n, 3), lie on
    one face with the nearest one, whose normals are `facing` (n, 3).

    It leads across there, and what the sphere passed right over it is no hole in it.
    """
    found = np.zeros(len(place), dtype=bool)
    for i, rows in enumerate(near):
        aside, height = _aside(known.data, rows, place[i], facing[i])
        onward = direction[i] - (direction[i] @ facing[i]) * facing[i]
        along = aside @ onward / np.maximum(np.linalg.norm(aside, axis=1) * np.linalg.norm(onward), 1e-12)
        steps = np.subtract.outer(height[along > _STRAIGHT], height[along < -_STRAIGHT])
        found[i] = bool((np.abs(steps) < _STEP * known.reach).any())
    return found


def _aside(known: HermiteData, rows: list[int], place: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the contacts in `rows` those that face the way of a normal: (k, 3) m beside a place, and (k,) m above it."""
    alike = np.array(rows, dtype=np.int64)[known.normals[rows] @ normal > _ALIKE]
    aside = known.points[alike] - place
    height = aside @ normal
    return aside - np.outer(height, normal), height


@dataclass(slots=True, frozen=True)
class WallSettings:
    """Line pitch, sphere radius, lowest height of the sphere's centre and noise of a contact point, m.

    Guesses are `apart` [m] from one another and from contacts: the pitch, or less where contacts lie in no regular
    lines.
    """

    pitch: float
    radius: float
    lowest: float
    noise: float
    apart: float


def _unsupported(evidence: Evidence, centres: np.ndarray, settings: WallSettings) -> tuple[np.ndarray, ...]:
    """Segments from solid to free evidence, through the half-way surface, away from contacts."""
    grid = evidence.grid
    supported = grid.nearest(centres, _SUPPORTED * settings.apart) >= 0
    wanted = (np.abs(evidence.bound) < grid.step) & ~supported
    wanted[:, :, : max(0, int(np.ceil((settings.lowest - grid.origin[2]) / grid.step)))] = False
    node = grid.origin + grid.step * np.argwhere(wanted)
    solid, free, contact = evidence.solid_place[wanted], evidence.free_place[wanted], evidence.solid_contact[wanted]
    across, aside = free - solid, node - solid
    length = np.maximum(np.linalg.norm(across, axis=1), 1e-12)
    direction = across / length[:, None]
    straight = np.einsum("ij,ij->i", aside, direction) > 0.9 * np.linalg.norm(aside, axis=1)
    kept = straight & (length > settings.radius) & (length < 4.0 * settings.pitch)
    # The outermost of many noisy points lies too far out, by about one and a half deviations.
    sure = settings.radius - 1.5 * settings.noise
    start = solid + sure * direction
    return start[kept], direction[kept], length[kept] - sure, contact[kept]


def _thin(
    start: np.ndarray, direction: np.ndarray, gap: np.ndarray, contact: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """One segment for each cell of edge `size`: means, and any of the contacts; cells of many directions are left."""
    if len(start) == 0:
        return start, direction, gap, contact
    _, first, cell = np.unique(np.floor(start / size), axis=0, return_index=True, return_inverse=True)
    cell = cell.ravel()
    count = np.bincount(cell)
    means = [
        np.stack([np.bincount(cell, column) for column in v.T], axis=1) / count[:, None] for v in (start, direction)
    ]
    length = np.linalg.norm(means[1], axis=1)
    kept = length > 0.8
    unit = means[1][kept] / length[kept, None]
    return means[0][kept], unit, (np.bincount(cell, gap) / count)[kept], contact[first[kept]]


@dataclass(slots=True)
class _Arcs:
    """How the clustered contacts' surface bends towards one direction."""

    direction: np.ndarray
    centres: np.ndarray
    along: np.ndarray
    pairs: np.ndarray
    radii: np.ndarray


def _arcs(
    direction: np.ndarray, centres: np.ndarray, normals: np.ndarray, settings: WallSettings
) -> Iterator[tuple[np.ndarray, _Arcs]]:
    """Rows of the segments by rounded direction, with the arcs towards it."""
    if len(direction) == 0:
        return
    keys, group = np.unique(np.rint(2.0 * direction), axis=0, return_inverse=True)
    group = group.ravel()
    for g, key in enumerate(keys):
        unit = key / np.linalg.norm(key)
        along = centres @ unit
        order = np.argsort(along, kind="stable")
        pairs, radii = np.empty((len(centres), 9)), np.full((len(centres), 3), np.nan)
        upstream(centres, normals, along, order, unit, settings.pitch, pairs)
        curvature_radii(centres, along, order, pairs, settings.pitch, _CURVATURE_NOISE, radii)
        yield np.flatnonzero(group == g), _Arcs(unit, centres, along, pairs, radii)


def _refine(
    row: int,
    arcs: _Arcs,
    start: np.ndarray,
    direction: np.ndarray,
    gap: np.ndarray,
    contact: np.ndarray,
    settings: WallSettings,
    place: np.ndarray,
    facing: np.ndarray,
    deviation: np.ndarray,
) -> None:
    """Weigh the half-way guess of one segment against what the arcs of its line say."""
    towards = arcs.direction
    same_line = np.abs((arcs.centres - contact) @ towards) < 0.25 * settings.pitch
    members = np.flatnonzero(same_line & np.isfinite(arcs.radii[:, 0]))
    fitted, scratch = np.empty(5), np.empty((len(members), 3))
    if not extrapolate(
        arcs.centres, arcs.pairs, arcs.radii, members, towards, start[row], settings.radius, _EVIDENCE_FLOOR,
        scratch, fitted,
    ):  # fmt: skip
        return
    unit = direction[row]
    prior, seen = 1.0 / deviation[row] ** 2, 1.0 / fitted[1] ** 2
    excess = (prior * 0.5 * gap[row] + seen * (fitted[0] - start[row] @ towards) / (unit @ towards)) / (prior + seen)
    place[row] = start[row] + np.clip(excess, 0.0, gap[row]) * unit
    deviation[row] = 1.0 / np.sqrt(prior + seen)
    mixed = seen * fitted[2:] + prior * unit
    facing[row] = mixed / np.linalg.norm(mixed)
