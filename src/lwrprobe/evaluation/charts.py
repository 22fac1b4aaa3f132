"""Small charts as SVG text that takes its colours from the page around it (`--ink`, `--faint`, `--a` to `--d`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

_WIDTH, _HEIGHT = 520.0, 250.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 16.0, 18.0, 44.0


@dataclass(slots=True, frozen=True)
class Line:
    """x and y (n,), the name in the legend, the colour's letter; dots instead of a line if requested."""

    x: np.ndarray
    y: np.ndarray
    name: str
    colour: str = "a"
    dots: bool = False


def ticks(low: float, high: float, max_count: int = 6) -> np.ndarray:
    """Round numbers from `low` to `high`."""
    span = max(high - low, 1e-12)
    rough = span / max_count
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= rough * (1.0 - 1e-9))
    return np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0) * step + 0.0


def line_chart(
    lines: Sequence[Line],
    x_label: str,
    y_label: str,
    levels: Sequence[tuple[float, str]] = (),
    top: float | None = None,
    decades: bool = False,
) -> str:
    """Lines from zero up, or over decades, with horizontal `levels` (height, name), without what is not finite."""
    lines = [line for line in lines if np.isfinite(line.y).any()]
    x_low = min((float(line.x.min()) for line in lines), default=0.0)
    x_high = max((float(line.x.max()) for line in lines), default=1.0)
    finite = [line.y[np.isfinite(line.y)] for line in lines]
    highest = max([float(y.max()) for y in finite] + [height for height, _ in levels] + [1e-9])
    y_low, y_high = 0.0, top if top is not None else 1.08 * highest
    if decades:
        lowest = min((float(y.min()) for y in finite), default=highest)
        first = np.floor(np.log10(max(lowest, 1e-9)))
        y_low, y_high = 10.0**first, 10.0 ** max(np.ceil(np.log10(highest)), first + 1.0)
    frame = _Frame(x_low, max(x_high, x_low + 1e-9), y_low, y_high, decades)
    parts = frame.grid(x_label, y_label)
    for height, name in levels:
        y = frame.y(height)
        parts.append(f'<path class="level" d="M{_LEFT:.0f} {y:.1f}H{_WIDTH - _RIGHT:.0f}"/>')
        parts.append(
            f'<text class="note" x="{_WIDTH - _RIGHT:.0f}" y="{y - 4:.1f}" text-anchor="end">{escape(name)}</text>'
        )
    for line in lines:
        places = [f"{frame.x(a):.1f} {frame.y(min(b, y_high)):.1f}" for a, b in zip(line.x, line.y) if np.isfinite(b)]
        if line.dots:
            parts += [
                f'<circle class="dot {line.colour}" cx="{p.split()[0]}" cy="{p.split()[1]}" r="5"/>' for p in places
            ]
        elif places:
            parts.append(f'<path class="line {line.colour}" d="M{" L".join(places)}"/>')
    return _svg(parts, [(line.name, line.colour) for line in lines])


def histogram(values: np.ndarray, x_label: str, limit: float, bins: int = 81) -> str:
    """Shares of values within +-`limit`; what lies beyond is counted in the last bins."""
    counts, edges = np.histogram(np.clip(values, -limit, limit), bins=bins, range=(-limit, limit))
    shares = 100.0 * counts / max(len(values), 1)
    frame = _Frame(-limit, limit, 0.0, 1.08 * max(shares.max(initial=0.0), 1e-9))
    parts = frame.grid(x_label, "% of the surface")
    wide = frame.x(edges[1]) - frame.x(edges[0])
    for share, edge in zip(shares, edges):
        if share > 0.0:
            y = frame.y(share)
            parts.append(
                f'<rect class="bar a" x="{frame.x(edge) + 0.4:.1f}" y="{y:.1f}" width="{max(wide - 0.8, 0.5):.1f}" '
                f'height="{frame.y(0.0) - y:.1f}"/>'
            )
    parts.append(f'<path class="level" d="M{frame.x(0.0):.1f} {_TOP:.0f}V{_HEIGHT - _BOTTOM:.0f}"/>')
    return _svg(parts, [])


def bars(rows: Sequence[tuple[str, float, str]]) -> str:
    """Horizontal bars: name, length, what stands behind it."""
    tall = 26.0 * len(rows) + 8.0
    largest = max((value for _, value, _ in rows), default=1.0) or 1.0
    parts = []
    for i, (name, value, note) in enumerate(rows):
        y = 6.0 + 26.0 * i
        wide = 230.0 * value / largest
        parts.append(f'<text x="132" y="{y + 13:.0f}" text-anchor="end">{escape(name)}</text>')
        parts.append(f'<rect class="bar a" x="142" y="{y + 1:.0f}" width="{max(wide, 1.0):.1f}" height="16" rx="2"/>')
        parts.append(f'<text class="note" x="{150 + wide:.0f}" y="{y + 13:.0f}">{escape(note)}</text>')
    return _svg(parts, [], tall)


@dataclass(slots=True, frozen=True)
class _Frame:
    x_low: float
    x_high: float
    y_low: float
    y_high: float
    decades: bool = False

    def x(self, value: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * (value - self.x_low) / (self.x_high - self.x_low)

    def y(self, value: float) -> float:
        share = (value - self.y_low) / (self.y_high - self.y_low)
        if self.decades:
            share = np.log(max(value, self.y_low) / self.y_low) / np.log(self.y_high / self.y_low)
        return _HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * float(share)

    def grid(self, x_label: str, y_label: str) -> list[str]:
        parts = []
        heights = ticks(self.y_low, self.y_high, 5)
        if self.decades:
            heights = 10.0 ** np.arange(np.log10(self.y_low), np.log10(self.y_high) + 0.5)
        for tick in heights:
            y = self.y(tick)
            parts.append(f'<path class="grid" d="M{_LEFT:.0f} {y:.1f}H{_WIDTH - _RIGHT:.0f}"/>')
            parts.append(f'<text x="{_LEFT - 8:.0f}" y="{y + 4.5:.1f}" text-anchor="end">{tick:g}</text>')
        for tick in ticks(self.x_low, self.x_high):
            parts.append(
                f'<text x="{self.x(tick):.1f}" y="{_HEIGHT - _BOTTOM + 18:.0f}" text-anchor="middle">{tick:g}</text>'
            )
        middle = 0.5 * (_LEFT + _WIDTH - _RIGHT)
        parts.append(
            f'<text class="label" x="{middle:.0f}" y="{_HEIGHT - 6:.0f}" text-anchor="middle">{escape(x_label)}</text>'
        )
        upright = 0.5 * (_TOP + _HEIGHT - _BOTTOM)
        parts.append(
            f'<text class="label" transform="translate(15 {upright:.0f}) rotate(-90)" text-anchor="middle">'
            f"{escape(y_label)}</text>"
        )
        return parts


def _svg(parts: list[str], legend: list[tuple[str, str]], tall: float = _HEIGHT) -> str:
    if len(legend) < 2:
        legend = []
    names = "".join(f'<span><i class="{colour}"></i>{escape(name)}</span>' for name, colour in legend)
    return f'<svg viewBox="0 0 {_WIDTH:.0f} {tall:.0f}" role="img">{"".join(parts)}</svg>' + (
        f'<div class="legend">{names}</div>' if names else ""
    )
