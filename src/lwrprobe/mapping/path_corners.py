"""A driven path with as few places as say the same."""

from __future__ import annotations

import numpy as np


def path_corners(places: np.ndarray, directions: np.ndarray, chord: float | np.ndarray, turn: float) -> list[int]:
    """Indices of the rows between which straight pieces suffice (Ramer 1972; Douglas, Peucker 1973).

    Parameters
    ----------
    places : (n, 3) m
    directions : (n, k), elements of what the probe's orientation is given by; they change evenly along a piece
    chord : m, by which a coordinate of a place may lie off its piece; one for all places, or (n,), one for each
    turn : by which an element of the directions may differ from its piece
    """
    kept, spans = {0, len(places) - 1}, [(0, len(places) - 1)]
    chords = np.broadcast_to(chord, len(places))
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        step = places[last] - places[first]
        size = float(step @ step)
        if size > 1e-12:
            share = np.clip((places[inner] - places[first]) @ step / size, 0.0, 1.0)[:, None]
        else:
            share = np.linspace(0.0, 1.0, last - first + 1)[1:-1, None]
        turned = directions[last] - directions[first]
        off = np.abs(places[inner] - places[first] - share * step).max(axis=1) / chords[inner]
        bent = np.abs(directions[inner] - directions[first] - share * turned).max(axis=1) / turn
        worst = int(np.argmax(off + bent))
        if off[worst] > 1.0 or bent[worst] > 1.0:
            middle = first + 1 + worst
            kept.add(middle)
            spans += [(first, middle), (middle, last)]
    return sorted(kept)
