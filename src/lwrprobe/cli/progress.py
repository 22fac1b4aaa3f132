"""One line that says what the probe is doing, on standard error; standard output stays for results."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn

KERNELS = 403
"""Kernels that `lwrprobe explore block` compiles with an empty cache, as `on_compilation` counted them."""


class ProgressLine:
    """Phases as sentences, the exploration as a bar with state, contacts, force and time."""

    def __init__(self, quiet: bool) -> None:
        self._console = Console(stderr=True, quiet=quiet)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[facts]}"),
            console=self._console,
            transient=True,
        )
        self._task: Any = None

    def __enter__(self) -> ProgressLine:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()

    def tell(self, sentence: str) -> None:
        """A new phase."""
        self._clear()
        self._console.print(f"[dim]{sentence}[/dim]", highlight=False)

    def _clear(self) -> None:
        self._bar.stop()
        for task in self._bar.task_ids:
            self._bar.remove_task(task)
        self._task = None

    @contextmanager
    def compilation(self) -> Iterator[None]:
        """Show how many kernels have been compiled, while the block runs."""
        from lwrprobe.compiled.disk_cache import loads
        from lwrprobe.compiled.pipeline import on_compilation

        start, count, task = time.monotonic(), 0, TaskID(-1)

        def show(name: str) -> None:
            nonlocal count, task
            count += 1
            if self._task is not None:  # the bar shows the exploration
                return
            if task not in self._bar.task_ids:
                task = self._bar.add_task("", total=KERNELS, facts="")
            self._bar.start()
            text = compilation_text(count, time.monotonic() - start, KERNELS if not loads else None)
            self._bar.update(task, completed=count, description=text, facts="", visible=True)

        with on_compilation(show):
            yield

    def watch(self, snapshot: Any) -> None:
        """Where the exploration stands."""
        if self._task is None:
            self._clear()
            self._task = self._bar.add_task("", total=1.0, facts="")
            self._bar.start()
        facts = (
            f"{snapshot.contacts} contacts  {snapshot.force:4.2f} N  "
            f"robot {snapshot.time:6.1f} s  wall {snapshot.wall:5.1f} s"
        )
        self._bar.update(
            self._task, completed=snapshot.progress.covered, description=f"{snapshot.progress.doing:<34}", facts=facts
        )


def compilation_text(count: int, seconds: float, total: int | None) -> str:
    """How far the compilation is. `total` is None where part of it was on the disk: how many are missing is unknown."""
    if total is None or count >= total:
        return f"compiling kernels: {count}"
    left = seconds / count * (total - count)
    return f"compiling kernels: {count} of about {total}, about {left:.0f} s left"
