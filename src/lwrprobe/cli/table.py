"""A table in a terminal of any width: nothing is cut; what is too wide is continued below, rows named again."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

_GAP = 2
"""Characters between two columns, one of which is the divider of the box."""
_WIDEST = 28
"""Characters, above which text is rather wrapped than given a column of its full width."""


def print_table(console: Console, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print cells of text, left-aligned, as one table or as several below each other.

    Each further part repeats the first columns, as many as it takes to tell the rows apart. Cells wrap between words,
    and within a word that is wider than the console.
    """
    texts = [[heading, *(row[i] for row in rows)] for i, heading in enumerate(columns)]
    widths = [max(map(len, column)) for column in texts]
    if sum(widths) + _GAP * len(widths) > console.width:
        widths = [_width(column) for column in texts]
    keys = _keys(rows, widths, console.width)
    console.print(Text(title, style="bold"))
    for part in _parts(widths, keys, console.width):
        shown = [*range(keys), *part]
        grid = Table(box=box.SIMPLE_HEAD, padding=(0, _GAP - 1, 0, 0), pad_edge=False, show_edge=False)
        for i in shown:
            grid.add_column(Text(columns[i]), overflow="fold", max_width=max(1, min(widths[i], console.width)))
        for row in rows:
            grid.add_row(*(Text(row[i]) for i in shown))
        console.print(grid)
        console.print()


def _width(column: Sequence[str]) -> int:
    """What a heading and the cells below it need: the longest word, and the longest cell up to a bound."""
    longest_word = max((len(word) for text in column for word in text.split()), default=1)
    return max(longest_word, min(_WIDEST, max(map(len, column[1:]), default=1)))


def _keys(rows: Sequence[Sequence[str]], widths: Sequence[int], width: int) -> int:
    """How many of the first columns name a row, at most half of the console; at least one."""
    for count in range(1, len(widths)):
        if sum(widths[:count]) + _GAP * count > width // 2:
            return max(1, count - 1)
        if len({tuple(row[:count]) for row in rows}) == len(rows):
            return count
    return 1


def _parts(widths: Sequence[int], keys: int, width: int) -> list[list[int]]:
    """Indices of the columns beside the keys, part by part, each part as wide as the console allows."""
    available = width - sum(widths[:keys]) - _GAP * keys
    parts: list[list[int]] = [[]]
    left = available
    for i in range(keys, len(widths)):
        if parts[-1] and widths[i] > left:
            parts.append([])
            left = available
        parts[-1].append(i)
        left -= widths[i] + _GAP
    return parts
