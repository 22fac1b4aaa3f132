"""One line that says what the probe is doing, on standard error; standard output stays for results."""

from __future__ import annotations

from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn


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
        self._bar.stop()
        self._console.print(f"[dim]{sentence}[/dim]", highlight=False)

    def watch(self, snapshot: Any) -> None:
        """Where the exploration stands."""
        if self._task is None:
            self._task = self._bar.add_task("", total=1.0, facts="")
            self._bar.start()
        facts = (
            f"{snapshot.contacts} contacts  {snapshot.force:4.2f} N  "
            f"robot {snapshot.time:6.1f} s  wall {snapshot.wall:5.1f} s"
        )
        self._bar.update(
            self._task, completed=snapshot.progress.covered, description=f"{snapshot.progress.doing:<34}", facts=facts
        )
