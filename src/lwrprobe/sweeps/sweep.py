"""A sweep from its file to its table and page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from lwrprobe.host.cores import cores
from lwrprobe.sweeps.execute import Result, is_settled, prepare_here, run_cluster, run_local
from lwrprobe.sweeps.journal import Journal
from lwrprobe.sweeps.page import write_page
from lwrprobe.sweeps.plan import SweepTask, check_scenes, read_plan
from lwrprobe.sweeps.table import Row, rows_of, write_tables
from lwrprobe.sweeps.worker import explored, prepared

Watch = Callable[[int, int, str], None]
"""Called with the number of runs that have ended, that of all, and the last one's name."""


@dataclass(slots=True, frozen=True)
class Swept:
    """What a sweep found.

    Attributes
    ----------
    rows : one each run, in the order of the plan
    files : what was written
    known : runs that an earlier sweep into the same folder had done
    """

    rows: list[Row]
    files: list[Path]
    known: int


def sweep(
    file: str | Path,
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    restart: bool = False,
    watch: Watch = lambda done, of, name: None,
) -> Swept:
    """Carry out a sweep file; what its folder has already is kept, so that a sweep that was cut off goes on.

    Parameters
    ----------
    file : scenes x strategies x profiles x variants x seeds, see `plan.SweepFile`
    out : folder for journal.jsonl, results.csv, results.parquet and sweep.html
    workers : processes, None = as many as cores
    scheduler : `tcp://host:port` of a Dask scheduler whose workers do the work instead
    restart : forget what the folder has
    watch : shown each run that ends

    Raises SceneError and its kin for a file, scene or setting that cannot be used, before the first run begins.
    """
    tasks = read_plan(file)
    check_scenes(tasks)
    with closing(Journal(out / "journal.jsonl", restart)) as journal:
        left = {task.key: task for task in tasks if not is_settled(journal.results.get(task.key))}
        known = len(tasks) - len(left)
        names = {key: f"{Path(task.scene).stem}, {task.strategy}, seed {task.seed}" for key, task in left.items()}
        for done, (key, result) in enumerate(_results(left, workers, scheduler), start=known + 1):
            journal.add(key, result)
            watch(done, len(tasks), names[key])
        rows = rows_of(tasks, journal.results)
        ended = [journal.results[task.key] for task in tasks if task.key in journal.results]
    seconds = sum(result.get("seconds") or 0.0 for result in ended)
    return Swept(rows, [*write_tables(out, rows), write_page(out, rows, seconds)], known)


def _results(left: dict[str, SweepTask], workers: int | None, scheduler: str | None) -> Iterator[tuple[str, Result]]:
    given = {key: task.for_worker() for key, task in left.items()}
    if not given:
        return iter(())
    if scheduler is not None:
        return run_cluster(given, explored, scheduler, prepared)
    kinds = {(task.strategy, task.settings, task.profile): key for key, task in reversed(left.items())}
    prepare_here([given[key] for key in kinds.values()], prepared)
    return run_local(given, explored, workers or cores())
