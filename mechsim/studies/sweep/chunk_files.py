"""The chunks of a sweep in files, written as they end, so that a stopped sweep can resume."""

import json
import shutil
import zipfile
from pathlib import Path

import numpy as np

from mechsim.errors import InputError, OutputError
from mechsim.files import written_beside
from mechsim.numerics.resources import said
from mechsim.studies.sweep.task import Measured

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
                with written_beside(self.folder / NOTE) as note:
                    note.write_text(
                        json.dumps({"sweep": self.sweep_hash, "parts": self.count}), encoding="ascii"
                    )
            except OSError as error:
                raise OutputError(f"cannot make the folder {self.folder}: {error.strerror}") from None
            return set()
        if self._stored_hash() != self.sweep_hash:
            raise InputError(
                f"{self.folder} holds parts of another sweep; remove that folder, or name another output"
            )
        if not resume:
            raise InputError(
                f"{self.folder} holds parts of this sweep, which was stopped; give --resume to go on, or "
                "remove that folder"
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
        with written_beside(self._path(number)) as temporary:
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
        InputError: saying how many fit.
    """
    free = shutil.disk_usage(output.parent).free
    # chunks, and the output made of them
    each = 2.0 * (each + EXTRA_BYTES)
    if designs * each > free:
        raise InputError(
            f"{designs:,} designs would take {said(designs * each)} of disk, and {said(free)} are free at "
            f"{output.parent}; {int(free / each):,} fit: take fewer, or write elsewhere"
        )
