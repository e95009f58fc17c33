"""Chunks of a sweep, measured by threads."""

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from mechsim.simulation.mjcf.compiling import quiet
from mechsim.studies.sweep.methods import by_one_formula, measured_designs
from mechsim.studies.sweep.task import Measured, SweepTask

# designs in a chunk: by one formula, by loop equations together, and one at a time
BY_FORMULA, BY_LOOPS, SINGLE = 8192, 256, 64
# largest number of chunks in a sweep: more designs make longer chunks
MAX_CHUNKS = 20_000

Keep = Callable[[tuple[int, int], Measured], None]


def chunk_bounds(task: SweepTask) -> list[tuple[int, int]]:
    """Return the first design of each chunk, and the one after its last."""
    count = task.designs.count
    usual = BY_FORMULA if by_one_formula(task) else SINGLE if task.loops is None else BY_LOOPS
    length = max(usual, -(-count // MAX_CHUNKS))
    return [(low, min(low + length, count)) for low in range(0, count, length)]


def run_chunks(task: SweepTask, chunks: Sequence[tuple[int, int]], keep: Keep) -> None:
    """Measure chunks of a sweep by threads.

    Args:
        task: the sweep.
        chunks: first design, and the one after the last, of each.
        keep: called with each chunk and its result when it ends, by one thread at a time.
    """
    lock = threading.Lock()

    def run(chunk: tuple[int, int]) -> None:
        measured_values = measured_designs(task, *chunk)
        with lock:
            keep(chunk, measured_values)

    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        # before threads start: each thread would restore the state that it finds
        with quiet():
            for _ in pool.map(run, chunks):
                pass
    finally:
        pool.shutdown(cancel_futures=True)
