"""A bar for work that comes in stages, on standard error."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn


class StageBar:
    """Called with a stage and its share done, as reconstructors do; silent when quiet, gone when done."""

    def __init__(self, quiet: bool) -> None:
        self._bar = Progress(
            TextColumn("{task.description:<12}", markup=False),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            console=Console(stderr=True, quiet=quiet),
            transient=True,
        )
        self._task = self._bar.add_task("", total=1.0)

    def __enter__(self) -> StageBar:
        self._bar.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()

    def __call__(self, stage: str, share: float) -> None:
        """Show how far a stage is."""
        self._bar.update(self._task, description=stage, completed=share)
