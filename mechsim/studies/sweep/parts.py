"""The parts of a sweep, each written as it ends, so that one that was stopped can go on."""

import json
import shutil
import zipfile
from pathlib import Path

import numpy as np

from mechsim.errors import InputError, OutputError
from mechsim.files import written_beside
from mechsim.maths.memory import said
from mechsim.studies.sweep.task import Measured

NOTE = "sweep.json"
# of a design: what its place in a part, its reason and its file take beside its measures, in bytes
BESIDE = 24.0


class PartFolder:
    """A folder beside the output, with one file for each part that is done.

    Attributes:
        folder: OUT.parts.
        mark: of the sweep (see `identity`).
    """

    def __init__(self, output: Path, mark: str, count: int):
        self.folder = output.with_name(output.name + ".parts")
        self.mark, self.count = mark, count

    def begin(self, *, resume: bool) -> set[int]:
        """Make the folder, or find it with parts that are done; return their numbers.

        Raises:
            InputError: where it holds another sweep, or this one and it was not to go on.
            OutputError: where it cannot be made.
        """
        if not self.folder.exists():
            try:
                self.folder.mkdir()
                with written_beside(self.folder / NOTE) as note:
                    note.write_text(json.dumps({"sweep": self.mark, "parts": self.count}), encoding="ascii")
            except OSError as error:
                raise OutputError(f"cannot make the folder {self.folder}: {error.strerror}") from None
            return set()
        if self._noted() != self.mark:
            raise InputError(
                f"{self.folder} holds parts of another sweep; remove that folder, or name another output"
            )
        if not resume:
            raise InputError(
                f"{self.folder} holds parts of this sweep, which was stopped; give --resume to go on, or "
                "remove that folder"
            )
        numbers = {int(one.stem) for one in self.folder.glob("*.npz") if one.stem.isdigit()}
        return {number for number in numbers if self._whole(number)}

    def _noted(self) -> str:
        try:
            return str(json.loads((self.folder / NOTE).read_text(encoding="ascii"))["sweep"])
        except (OSError, ValueError, KeyError, TypeError):
            return ""

    def _whole(self, number: int) -> bool:
        try:
            self.read(number)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return False
        return True

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:08d}.npz"

    def write(self, number: int, part: Measured) -> None:
        """Write a part."""
        words, which = np.unique(part.reason.astype(str), return_inverse=True)
        with written_beside(self._path(number)) as beside:
            np.savez(
                beside,
                allow_pickle=False,
                values=np.array([*part.values.values()]),
                outcome=part.outcome,
                words=words,
                which=which.astype(np.int32),
            )

    def read(self, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return values (measures, n), outcomes and reasons (n,) of a part."""
        with self._path(number).open("rb") as part, np.load(part, allow_pickle=False) as file:
            return file["values"], file["outcome"], file["words"].astype(object)[file["which"]]

    def remove(self) -> None:
        """Take the folder away, once what it held is in the output."""
        shutil.rmtree(self.folder, ignore_errors=True)


def require_disk(output: Path, designs: int, each: float) -> None:
    """Refuse more designs than the disk holds.

    Raises:
        InputError: saying how many fit.
    """
    free = shutil.disk_usage(output.parent).free
    # parts, and the output made of them
    each = 2.0 * (each + BESIDE)
    if designs * each > free:
        raise InputError(
            f"{designs:,} designs would take {said(designs * each)} of disk, and {said(free)} are free at "
            f"{output.parent}; {int(free / each):,} fit: take fewer, or write elsewhere"
        )
