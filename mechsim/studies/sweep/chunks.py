"""Chunks of a sweep: measured by threads, and stored in files until all have ended."""

import hashlib
import json
import os
import shutil
import threading
import zipfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from mechsim._version import __version__
from mechsim.errors import InputError, OutputError
from mechsim.files import atomic_path
from mechsim.numerics.resources import size_text
from mechsim.simulation.mjcf import quiet
from mechsim.studies.release import Release
from mechsim.studies.sweep.methods import by_one_formula, measured_designs
from mechsim.studies.sweep.task import Measured, SweepTask


def identity(task: SweepTask) -> str:
    """Return the hash of a sweep's subject, designs, measures and poses."""
    designs = task.designs
    description = {
        "version": __version__,
        "subject": task.subject.identity,
        "spread": designs.spread,
        "designs": {name: _hash(values.tobytes()) for name, values in designs.values.items()},
        "order": [*designs.values],
        "measures": [_measure(values.name, values.subject, values.kind) for values in task.measures],
        "samples": task.samples,
        "speed": repr(task.path_speed),
        "release": None if task.release is None else _release(task.release),
    }
    return _hash(json.dumps(description, sort_keys=True).encode())


def _release(release: Release) -> list[Any]:
    end = release.duration, release.until, release.restitution, release.budget
    return [sorted(release.initial.items()), *end]


def _measure(name: str, subject: str, kind: str) -> str:
    return name if kind != "function" else name + _hash(Path(subject.rpartition(":")[0]).read_bytes())


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


NOTE = "sweep.json"
# bytes of a design in addition to its measures: index, reason and file overhead
EXTRA_BYTES = 24.0


class ChunkFolder:
    """A folder next to the output with one file for each finished chunk.

    Attributes:
        folder: OUT.parts.
        sweep_hash: of the sweep (see `identity`).
    """

    def __init__(self, output: Path, sweep_hash: str, count: int):
        self.folder = output.with_name(output.name + ".parts")
        self.sweep_hash, self.count = sweep_hash, count

    def open(self, *, resume: bool) -> set[int]:
        """Create or open the folder; return the numbers of finished chunks.

        Raises:
            InputError: if it contains another sweep, or this one without `resume`.
            OutputError: if it cannot be created.
        """
        if not self.folder.exists():
            try:
                self.folder.mkdir()
                with atomic_path(self.folder / NOTE) as note:
                    note.write_text(
                        json.dumps({"sweep": self.sweep_hash, "parts": self.count}), encoding="ascii"
                    )
            except OSError as error:
                raise OutputError(f"cannot make the folder {self.folder}: {error.strerror}") from None
            return set()
        if self._stored_hash() != self.sweep_hash:
            raise InputError(
                f"{self.folder} contains chunks of another sweep; remove that folder, or name another output"
            )
        if not resume:
            raise InputError(
                f"{self.folder} contains chunks of this sweep, which was stopped; give --resume to "
                "continue, or remove that folder"
            )
        numbers = {int(path.stem) for path in self.folder.glob("*.npz") if path.stem.isdigit()}
        return {number for number in numbers if self._is_complete(number)}

    def _stored_hash(self) -> str:
        try:
            return str(json.loads((self.folder / NOTE).read_text(encoding="ascii"))["sweep"])
        except (OSError, ValueError, KeyError, TypeError):
            return ""

    def _is_complete(self, number: int) -> bool:
        try:
            self.read(number)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return False
        return True

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:08d}.npz"

    def write(self, number: int, chunk: Measured) -> None:
        """Write a chunk."""
        texts, which = np.unique(chunk.reason.astype(str), return_inverse=True)
        with atomic_path(self._path(number)) as temporary:
            np.savez(
                temporary,
                allow_pickle=False,
                values=np.array([*chunk.values.values()]),
                outcome=chunk.outcome,
                words=texts,
                which=which.astype(np.int32),
            )

    def read(self, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return values (measures, n), outcomes and reasons (n,) of a chunk."""
        with self._path(number).open("rb") as file_handle, np.load(file_handle, allow_pickle=False) as file:
            return file["values"], file["outcome"], file["words"].astype(object)[file["which"]]

    def remove(self) -> None:
        """Remove the folder after its contents are in the output."""
        shutil.rmtree(self.folder, ignore_errors=True)


def require_disk(output: Path, designs: int, each: float) -> None:
    """Reject more designs than fit on the disk.

    Raises:
        InputError: for more designs than fit, with the number that fits.
    """
    free = shutil.disk_usage(output.parent).free
    # the chunk files, and the output made of them
    each = 2.0 * (each + EXTRA_BYTES)
    if designs * each > free:
        raise InputError(
            f"{designs:,} designs would take {size_text(designs * each)} of disk, but only "
            f"{size_text(free)} are free at {output.parent}; {int(free / each):,} fit: reduce the number, or "
            "write to another disk"
        )


# designs in a chunk: by one formula, by loop equations together, and one at a time
BY_FORMULA, BY_LOOPS, SINGLE = 8192, 256, 64
# largest number of chunks in a sweep: more designs make longer chunks
MAX_CHUNKS = 20_000

Keep = Callable[[int, Measured], None]


def chunk_bounds(task: SweepTask) -> list[tuple[int, int]]:
    """Return the first design of each chunk, and the one after its last."""
    count = task.designs.count
    usual = BY_FORMULA if by_one_formula(task) else SINGLE if task.loops is None else BY_LOOPS
    length = max(usual, -(-count // MAX_CHUNKS))
    return [(low, min(low + length, count)) for low in range(0, count, length)]


def run_chunks(task: SweepTask, chunks: Sequence[tuple[int, int, int]], keep: Keep) -> None:
    """Measure chunks of a sweep by threads and store each one when it ends.

    Args:
        task: the sweep.
        chunks: number, first design, and the one after the last, of each.
        keep: called with number and result of each chunk by one thread at a time.
    """
    lock = threading.Lock()

    def run(chunk: tuple[int, int, int]) -> None:
        number, low, high = chunk
        measured_values = measured_designs(task, low, high)
        with lock:
            keep(number, measured_values)

    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        # before threads start: each thread would restore the state that it finds
        with quiet():
            for _ in pool.map(run, chunks):
                pass
    finally:
        pool.shutdown(cancel_futures=True)
