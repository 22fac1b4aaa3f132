"""Tasks carried out side by side: in spawned processes here, or on the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from platform import node
from time import perf_counter
from typing import Any, TypeVar, cast

from lwrprobe.errors import InputError, MissingExtraError
from lwrprobe.sweeps.journal import Journal
from lwrprobe.sweeps.worker import one_thread

Task = TypeVar("Task")
Result = dict[str, Any]
ATTEMPTS = 2
"""How often a task is begun whose worker dies."""
KILLED = "killed"
"""Status of a task whose workers died."""
CONNECT = 10.0
"""s, within which a scheduler has to answer."""


def run_in_order(tasks: Sequence[Task], work: Callable[[Task], Result], workers: int) -> list[Result]:
    """Results in the order of the tasks, from so many processes as of `run_local`; one worker is this process."""
    if workers == 1:
        return [work(task) for task in tasks]
    results = dict(run_local({str(number): task for number, task in enumerate(tasks)}, work, workers))
    return [results[str(number)] for number in range(len(tasks))]


def run_kept(
    tasks: Mapping[str, Task], work: Callable[[Task], Result], workers: int, journal: Path | None
) -> dict[str, Result]:
    """Results by the tasks' keys, each written to a journal as it comes; those that it has are not made again.

    Processes are those of `run_in_order`. Raises StorageError for a journal that cannot be written.
    """
    with closing(Journal(journal)) as kept:
        left = {key: task for key, task in tasks.items() if not is_settled(kept.results.get(key))}
        made = ((key, work(task)) for key, task in left.items()) if workers == 1 else run_local(left, work, workers)
        for key, result in made:
            kept.add(key, result)
        return {key: kept.results[key] for key in tasks}


def is_settled(result: Result | None) -> bool:
    """Whether a task has a result; one whose process was killed is done again."""
    return result is not None and result.get("status") != KILLED


def run_local(tasks: Mapping[str, Task], work: Callable[[Task], Result], workers: int) -> Iterator[tuple[str, Result]]:
    """Results as they come, by the tasks' keys, from spawned processes of one thread each.

    A task that raises gives a result with a status and a reason, as does one whose process dies twice. A process that
    dies costs its own task alone, and another one takes its place.
    """
    left = list(tasks)
    attempts = dict.fromkeys(left, 0)
    running: dict[Connection, tuple[BaseProcess, str]] = {}
    idle: list[tuple[Connection, BaseProcess]] = []
    try:
        while left or running:
            while left and len(running) < workers:
                pipe, process = idle.pop() if idle else _worker(work)
                key = left.pop(0)
                attempts[key] += 1
                pipe.send(tasks[key])
                running[pipe] = process, key
            for pipe in cast(list[Connection], wait(list(running))):
                process, key = running.pop(pipe)
                try:
                    result = pipe.recv()
                except (EOFError, OSError):
                    process.join()
                    if attempts[key] < ATTEMPTS:
                        left.insert(0, key)
                        continue
                    yield key, _died(process.exitcode)
                else:
                    idle.append((pipe, process))
                    yield key, result
    finally:
        for process in [process for process, _ in running.values()] + [process for _, process in idle]:
            process.kill()
            process.join()


def _worker(work: Callable[[Task], Result]) -> tuple[Connection, BaseProcess]:
    """A spawned process that serves tasks, and the line to it."""
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, work), daemon=True)
    process.start()
    theirs.close()
    return ours, process


def _serve(pipe: Connection, work: Callable[[Task], Result]) -> None:
    one_thread()
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        pipe.send(_timed(work, task))


def run_cluster(
    tasks: Mapping[str, Task], work: Callable[[Task], Result], scheduler: str, prepare: Callable[[Task], Result] | None
) -> Iterator[tuple[str, Result]]:
    """The same on the workers of a Dask scheduler (`tcp://host:port`); `prepare` runs once on each of their hosts.

    Raises InputError for a scheduler that does not answer, and MissingExtraError.
    """
    try:
        from distributed import Client, KilledWorker, as_completed
    except ImportError:
        raise MissingExtraError("a sweep on a cluster", "distributed", "cluster") from None
    try:
        client = Client(scheduler, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError("--scheduler", scheduler, f"the address of a Dask scheduler that answers ({error})") from None
    with client, client.as_current():
        client.run(one_thread)
        if prepare is not None and tasks:
            first = next(iter(tasks.values()))
            hosts = {
                about["host"]: address for address, about in client.scheduler_info(n_workers=-1)["workers"].items()
            }
            client.gather([client.submit(prepare, first, workers=[at], pure=False) for at in hosts.values()])
        keys = {
            client.submit(_timed, work, task, key=f"lwrprobe-{key}", pure=False, retries=0): key
            for key, task in tasks.items()
        }
        for future in as_completed(list(keys)):
            failure = future.exception()
            if isinstance(failure, KilledWorker):
                yield keys[future], _died(None)
            elif failure is not None:
                yield keys[future], {"status": "failed", "reason": f"{type(failure).__name__}: {failure}"}
            else:
                yield keys[future], future.result()


def prepare_here(tasks: Sequence[Task], prepare: Callable[[Task], Result]) -> None:
    """Run `prepare` for each task in one process, so that no two compile the same kernels."""
    for _ in run_local({str(number): task for number, task in enumerate(tasks)}, prepare, 1):
        pass


def _timed(work: Callable[[Task], Result], task: Task) -> Result:
    begin = perf_counter()
    try:
        result = work(task)
    except Exception as error:  # one run must not end the others
        result = {"status": "failed", "reason": f"{type(error).__name__}: {error}"}
    return result | {
        "seconds": round(perf_counter() - begin, 3),
        "host": node(),
    }


def _died(code: int | None) -> Result:
    return {"status": KILLED, "reason": f"its process died (exit code {code})", "seconds": None, "host": ""}
