"""Chunks of a sweep as Dask tasks: in this process by the local scheduler, or on a cluster."""

import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mechsim.errors import InputError
from mechsim.simulation.mjcf import quiet
from mechsim.studies.sweep.libraries import library
from mechsim.studies.sweep.methods import by_one_formula, measured
from mechsim.studies.sweep.task import Measured, SweepTask

# designs in a chunk: by one formula, stepped together, by loop equations together, and one by one
BY_FORMULA, STEPPED, BY_LOOPS, SINGLE = 8192, 512, 256, 64
# largest number of chunks in a sweep: more designs make longer chunks
MAX_CHUNKS = 20_000
# connection timeout of a scheduler in [s], and chunks queued on a cluster for each of its threads
TIMEOUT, CHUNKS_PER_THREAD = 10.0, 4

Keep = Callable[[int, Measured], None]


def chunk_bounds(task: SweepTask) -> list[tuple[int, int]]:
    """Return the first design of each chunk, and the one after its last; the same for every scheduler."""
    count = task.designs.count
    if task.settings is not None:
        usual = SINGLE if task.like is None else STEPPED
    else:
        usual = BY_FORMULA if by_one_formula(task) else SINGLE if task.loops is None else BY_LOOPS
    length = max(usual, -(-count // MAX_CHUNKS))
    return [(low, min(low + length, count)) for low in range(0, count, length)]


def run_chunks(
    task: SweepTask, chunks: Sequence[tuple[int, int, int]], keep: Keep, scheduler: Any = None
) -> None:
    """Measure chunks of a sweep and store each one when it ends.

    Args:
        task: the sweep.
        chunks: number, first design, and the one after the last, of each.
        keep: called with number and result of each chunk by one thread at a time.
        scheduler: None for Dask's own in this process, by threads; "synchronous"; the address of a
            scheduler, tcp://...; or a `distributed.Client`.

    Raises:
        InputError: for a scheduler that does not answer.
        MissingToolError: where Dask is not installed.
    """
    dask = library("dask")
    if scheduler is None or scheduler in ("threads", "synchronous"):
        _run_local(dask, task, chunks, keep, scheduler or "threads")
    else:
        _run_on_cluster(task, chunks, keep, scheduler)


def _run_local(
    dask: Any, task: SweepTask, chunks: Sequence[tuple[int, int, int]], keep: Keep, scheduler: str
) -> None:
    lock = threading.Lock()

    def run(number: int, low: int, high: int) -> None:
        measured_values = measured(task, low, high)
        with lock:
            keep(number, measured_values)

    tasks = [dask.delayed(run, pure=False, traverse=False)(*chunk) for chunk in chunks]
    # before threads start: each would restore the state it sees
    with quiet():
        dask.compute(*tasks, scheduler=scheduler, num_workers=os.cpu_count())


def _run_on_cluster(
    task: SweepTask, chunks: Sequence[tuple[int, int, int]], keep: Keep, scheduler: Any
) -> None:
    distributed = library("distributed")
    own = isinstance(scheduler, str)
    client = _answering(distributed, scheduler) if own else scheduler
    try:
        with client.as_current():
            _sent(distributed, client, task, chunks, keep)
    finally:
        if own:
            client.close()


def _sent(
    distributed: Any, client: Any, task: SweepTask, chunks: Sequence[tuple[int, int, int]], keep: Keep
) -> None:
    """Send chunks to a cluster, a few in advance; a chunk whose worker is lost is sent again."""
    waiting = list(reversed(chunks))
    ahead = CHUNKS_PER_THREAD * max(1, sum(client.nthreads().values()))
    under_way: dict[Any, int] = {}

    def send() -> list[Any]:
        sent: list[Any] = []
        while waiting and len(under_way) < ahead:
            number, low, high = waiting.pop()
            # each chunk holds only its own designs: shared data would be lost with the worker that holds it
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
        return distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address} within {TIMEOUT:g} s ({type(error).__name__}); "
            "start one "
            "with `dask scheduler`, or leave out --scheduler"
        ) from None
