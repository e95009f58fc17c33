"""Parts of a sweep as tasks of Dask: in this process by its local scheduler, or on a cluster."""

import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mechsim.errors import InputError
from mechsim.simulation.mjcf import quiet
from mechsim.studies.sweep.libraries import library
from mechsim.studies.sweep.roads import by_one_formula, measured
from mechsim.studies.sweep.task import Measured, SweepTask

# designs of a part: by one formula, stepped together, by loop equations together, and each by itself
MANY, STEPPED, SOME, FEW = 8192, 512, 256, 64
# parts of a sweep at most: more designs make longer parts
MOST_PARTS = 20_000
# seconds in which a scheduler must answer, and parts under way on a cluster for each of its threads
ANSWER, AHEAD = 10.0, 4

Keep = Callable[[int, Measured], None]


def bounds(task: SweepTask) -> list[tuple[int, int]]:
    """Return the first design of each part, and the one after its last; the same wherever they run."""
    count = task.designs.count
    if task.settings is not None:
        usual = FEW if task.like is None else STEPPED
    else:
        usual = MANY if by_one_formula(task) else FEW if task.together is None else SOME
    size = max(usual, -(-count // MOST_PARTS))
    return [(low, min(low + size, count)) for low in range(0, count, size)]


def run_parts(
    task: SweepTask, parts: Sequence[tuple[int, int, int]], keep: Keep, scheduler: Any = None
) -> None:
    """Measure parts of a sweep and keep each as it ends.

    Args:
        task: the sweep.
        parts: number, first design, and the one after the last, of each.
        keep: takes number and result of each; it is called by one thread at a time.
        scheduler: None for Dask's own in this process, by threads; "synchronous"; the address of a
            scheduler, tcp://...; or a `distributed.Client`.

    Raises:
        InputError: for a scheduler that does not answer.
        MissingToolError: where Dask is not installed.
    """
    dask = library("dask")
    if scheduler is None or scheduler in ("threads", "synchronous"):
        _here(dask, task, parts, keep, scheduler or "threads")
    else:
        _there(task, parts, keep, scheduler)


def _here(
    dask: Any, task: SweepTask, parts: Sequence[tuple[int, int, int]], keep: Keep, scheduler: str
) -> None:
    lock = threading.Lock()

    def done(number: int, low: int, high: int) -> None:
        found = measured(task, low, high)
        with lock:
            keep(number, found)

    tasks = [dask.delayed(done, pure=False, traverse=False)(*part) for part in parts]
    # before threads begin: each would put back what it found
    with quiet():
        dask.compute(*tasks, scheduler=scheduler, num_workers=os.cpu_count())


def _there(task: SweepTask, parts: Sequence[tuple[int, int, int]], keep: Keep, scheduler: Any) -> None:
    distributed = library("distributed")
    own = isinstance(scheduler, str)
    client = _answering(distributed, scheduler) if own else scheduler
    try:
        with client.as_current():
            _sent(distributed, client, task, parts, keep)
    finally:
        if own:
            client.close()


def _sent(
    distributed: Any, client: Any, task: SweepTask, parts: Sequence[tuple[int, int, int]], keep: Keep
) -> None:
    """Send parts to a cluster, some ahead of those that ended; one whose worker is lost is sent again."""
    waiting = list(reversed(parts))
    ahead = AHEAD * max(1, sum(client.nthreads().values()))
    under_way: dict[Any, int] = {}

    def send() -> list[Any]:
        sent: list[Any] = []
        while waiting and len(under_way) < ahead:
            number, low, high = waiting.pop()
            # each part with its own designs alone: what is shared would be lost with the worker that has it
            own = replace(task.designs, values=task.designs.rows(low, high), spread="list")
            future = client.submit(measured, replace(task, designs=own), 0, high - low, pure=False)
            under_way[future] = number
            sent.append(future)
        return sent

    ended = distributed.as_completed(send())
    for future in ended:
        keep(under_way.pop(future), future.result())
        for more in send():
            ended.add(more)


def _answering(distributed: Any, address: str) -> Any:
    """Return a client of a scheduler.

    Raises:
        InputError: where none answers.
    """
    try:
        return distributed.Client(address, timeout=ANSWER, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address} within {ANSWER:g} s ({type(error).__name__}); start one "
            "with `dask scheduler`, or leave out --scheduler"
        ) from None
