"""Progress displays: a bar in a terminal, a line in a notebook."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

if TYPE_CHECKING:
    from lwrprobe.exploration.loop.explorer import ProgressSnapshot


KERNELS = {True: 251, False: 403}
"""Kernels that an exploration of the scene `block` compiles with an empty cache, with a second process and without one
(`lwrprobe bench start`)."""


class ProgressDisplay(Protocol):
    """Shows phases as sentences, and snapshots while the probe moves."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None: ...

    def message(self, sentence: str) -> None:
        """A new phase."""

    def watch(self, snapshot: ProgressSnapshot) -> None:
        """Where the exploration stands; called some ten times a second."""


def progress_display(quiet: bool = False) -> ProgressDisplay:
    """The display that suits where Python runs; one that shows nothing when `quiet`."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    in_notebook = running is not None and getattr(running, "kernel", None) is not None
    return NotebookProgress() if in_notebook and not quiet else ProgressLine(quiet)


class ProgressLine:
    """For a terminal, on standard error: a bar with contacts, force and time; standard output stays for results."""

    def __init__(self, quiet: bool) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        self._console = Console(stderr=True, quiet=quiet)
        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[facts]}", markup=False),
            console=self._console,
            transient=True,
        )
        self._task: Any = None
        self._exploring = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()

    def message(self, sentence: str) -> None:
        """A new phase."""
        from rich.text import Text

        self._clear()
        self._console.print(Text(sentence, style="dim"))

    def compiled(self, count: int, seconds: float, total: int | None) -> None:
        """So many kernels have been compiled in so many seconds, of `total` as far as that is known."""
        if self._exploring:  # the bar shows the exploration
            return
        self._show(compilation_text(count, seconds, total), count, total or max(count, KERNELS[True]), "")

    def watch(self, snapshot: ProgressSnapshot) -> None:
        """Where the exploration stands."""
        if not self._exploring:
            self._clear()
            self._exploring = True
        self._show(f"{snapshot.progress.doing:<34}", snapshot.progress.covered, 1.0, _facts(snapshot))

    def _show(self, text: str, completed: float, total: float, facts: str) -> None:
        if self._task is None:
            self._task = self._bar.add_task("", total=total, facts="")
            self._bar.start()
        self._bar.update(self._task, completed=completed, total=total, description=text, facts=facts)

    def _clear(self) -> None:
        self._bar.stop()
        if self._task is not None:
            self._bar.remove_task(self._task)
        self._task, self._exploring = None, False


class NotebookProgress:
    """For a notebook: one line of HTML under the cell that is rewritten during the run; it needs no widgets."""

    def __init__(self) -> None:
        self._handle: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        return None

    def message(self, sentence: str) -> None:
        """A new phase."""
        self._show(f"<i>{escape(sentence)}</i>")

    def compiled(self, count: int, seconds: float, total: int | None) -> None:
        """So many kernels have been compiled in so many seconds, of `total` as far as that is known."""
        self._show(f"<i>{compilation_text(count, seconds, total)}</i>")

    def watch(self, snapshot: ProgressSnapshot) -> None:
        """Where the exploration stands."""
        progress = snapshot.progress
        bar = f'<progress value="{progress.covered:.3f}" max="1"></progress>'
        self._show(f"{bar} {progress.covered:.0%} {escape(progress.doing)} <small>{escape(_facts(snapshot))}</small>")

    def _show(self, text: str) -> None:
        from IPython.display import HTML, display

        if self._handle is None:
            self._handle = display(HTML(text), display_id=True)
        elif self._handle:
            self._handle.update(HTML(text))


def _facts(snapshot: ProgressSnapshot) -> str:
    return (
        f"{snapshot.contacts} contacts  {snapshot.force:4.2f} N  "
        f"robot {snapshot.time:6.1f} s  wall {snapshot.wall:5.1f} s"
    )


@contextmanager
def compilation_shown(display: ProgressDisplay) -> Iterator[None]:
    """Call the display's `compiled`, where it has one, for each kernel that is compiled while the block runs."""
    compiled: Callable[[int, float, int | None], None] | None = getattr(display, "compiled", None)
    if compiled is None:
        yield
        return
    # these load numba, which a command with a wrong argument does without
    from lwrprobe.compiled.disk_cache import loads
    from lwrprobe.compiled.pipeline import on_compilation
    from lwrprobe.host.cores import cores

    start, count = time.monotonic(), 0

    def show(name: str) -> None:
        nonlocal count
        count += 1
        compiled(count, time.monotonic() - start, KERNELS[cores() > 1] if not loads else None)

    with on_compilation(show):
        yield


def compilation_text(count: int, seconds: float, total: int | None) -> str:
    """How far the compilation is; `total` is None where part of it was on the disk: how many are missing is unknown."""
    if total is None or count >= total:
        return f"compiling kernels: {count}"
    left = seconds / count * (total - count)
    return f"compiling kernels: {count} of about {total}, about {left:.0f} s left"
