"""Pictures and videos in files."""

from __future__ import annotations

import functools
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError, MissingToolError, OutputError, needs
from mechsim.files import atomic_path
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.pictures.render.drawing import frames, still
from mechsim.pictures.render.frame_poses import returns_visibly
from mechsim.pictures.render.labels import Picture
from mechsim.pictures.render.look import Look

# options of mediapy for each kind; webm plays without patents, mp4 everywhere
CODECS: dict[str, dict[str, Any]] = {
    ".mp4": {"codec": "h264", "crf": 20, "ffmpeg_args": "-preset veryfast"},
    # "good" and row-based threads: the default takes ten times as long for the same quality
    ".webm": {
        "codec": "vp9",
        "crf": 31,
        "ffmpeg_args": "-b:v 0 -deadline good -cpu-used 5 -row-mt 1",
        "encoded_format": "yuv420p",
    },
    ".gif": {"codec": "gif"},
}


def write_picture(
    path: str | Path, mechanism: Mechanism, motion: Motion, look: Look | None = None, **options: Any
) -> None:
    """Write one picture as PNG; see `still` and `Look` for the options.

    Raises:
        InputError: for an extension other than `.png` or an unknown option.
        OutputError: where the file cannot be written.
        MissingToolError: where this machine has no OpenGL.
    """
    path = Path(path)
    _require_extension(path, ".png")
    with atomic_path(path) as temporary:
        _write_png(temporary, still(mechanism, motion, look, **options))


def write_video(
    path: str | PathLike[str],
    mechanism: Mechanism,
    motion: Motion,
    look: Look | None = None,
    *,
    fps: float = 30.0,
    angles: ArrayLike | None = None,
    progress: Callable[[], None] = lambda: None,
    **options: Any,
) -> int:
    """Write a motion as mp4, webm or gif, or, for a path without extension, as a directory of PNG files.

    Args:
        path: output path; a directory must be new or empty.
        mechanism: the mechanism.
        motion: its motion; a frame for each sample unless `angles` is given.
        look: contents of the pictures; None is the default.
        fps: frames per second.
        angles: crank angles of the frames in [rad]; `turn_angles` makes evenly spaced ones.
        progress: called after each frame.
        options: see `frames` and `Look`.

    Returns:
        How many frames were written.

    Raises:
        InputError: for an unknown extension or option, or a rate that is not positive.
        OutputError: where the file cannot be written.
        MissingToolError: where this machine has no OpenGL or no ffmpeg.
    """
    path = Path(path)
    if not 0.0 < fps <= 1000.0:
        raise InputError(f"{fps} frames per second; give a rate above 0 and up to 1000")
    if path.suffix == "":
        return _write_sequence(path, frames(mechanism, motion, look, angles=angles, **options), progress)
    _require_extension(path, *CODECS)
    ffmpeg = find_ffmpeg()
    with atomic_path(path) as temporary:
        pictures = frames(mechanism, motion, look, angles=angles, **options)
        count = _encode(temporary, pictures, fps, ffmpeg, progress)
        readable = frames_in(temporary, ffmpeg)
        if readable != count:
            raise OutputError(
                f"cannot write {path}: {readable} of {count} frames of the written video can be read; "
                "make room on the disk, or choose another path"
            )
        return count


def frames_in(path: Path, ffmpeg: str) -> int:
    """Return how many frames of a video file ffmpeg reads; 0 for a file that it rejects.

    Some versions of ffmpeg end with code 0 although the disk was full.
    """
    reported = ("-f", "null", "-progress", "pipe:1", "-")
    command = [ffmpeg, "-v", "error", "-i", str(path), "-map", "0:v", *reported]
    try:
        read = subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL, check=False)
    except OSError:
        return 0
    counts = re.findall(rb"^frame=\s*(\d+)", read.stdout, re.MULTILINE)
    return int(counts[-1]) if counts and read.returncode == 0 and not read.stderr.strip() else 0


def turn_angles(mechanism: Mechanism, motion: Motion, per_turn: int = 36) -> np.ndarray:
    """Return evenly spaced crank angles over a motion, `per_turn` in a revolution, in [rad].

    36 frames stand 10 degrees apart, as in the paper. Over whole turns after which every link stands
    as it did, the last one is left out, so that the frames play in a loop.
    """
    if per_turn < 1:
        raise InputError(f"{per_turn} frames per turn; give 1 or more")
    first, last = float(motion.angle[0]), float(motion.angle[-1])
    steps = abs(last - first) * per_turn / (2.0 * np.pi)
    whole = abs(steps - round(steps)) < 1e-6 and round(steps) % per_turn == 0 and round(steps) > 0
    again = whole and returns_visibly(mechanism, motion)
    count = round(steps) if again else int(np.floor(steps + 1e-6)) + 1
    return first + np.sign(last - first) * np.arange(count) * 2.0 * np.pi / per_turn


def find_ffmpeg() -> str:
    """Return the path of an ffmpeg program that runs: the system's, else the one imageio-ffmpeg brings.

    Raises:
        MissingToolError: where there is neither.
    """
    executable = shutil.which("ffmpeg")
    if executable and _runs(executable):
        return executable
    with suppress(ImportError, RuntimeError):
        import imageio_ffmpeg

        brought = imageio_ffmpeg.get_ffmpeg_exe()
        if _runs(brought):
            return brought
    what = f"{executable} does not run" if executable else "there is no ffmpeg here"
    raise MissingToolError(
        f"no video can be written: {what}; install the system package ffmpeg "
        "or the Python package imageio-ffmpeg"
    )


@functools.cache
def _runs(executable: str) -> bool:
    try:
        process = subprocess.run([executable, "-version"], capture_output=True, timeout=30, check=False)
    except (OSError, subprocess.SubprocessError):
        return False
    return process.returncode == 0 and process.stdout.startswith(b"ffmpeg")


def _encode(
    path: Path, pictures: Iterator[Picture], fps: float, ffmpeg: str, progress: Callable[[], None]
) -> int:
    with needs("pictures"):
        import mediapy

    mediapy.set_ffmpeg(ffmpeg)
    # the first frame is drawn before the encoder starts, so that an error leaves no process behind
    first = next(pictures)
    shape = first.shape[0] // 2 * 2, first.shape[1] // 2 * 2  # codecs want even edges
    count = 0
    try:
        # the encoder takes a frame while the next one is drawn; at most two frames wait
        with (
            mediapy.VideoWriter(path, shape, fps=fps, **CODECS[path.suffix]) as writer,
            ThreadPoolExecutor(max_workers=1) as line,
        ):
            pending = line.submit(lambda: None)
            for picture in chain([first], pictures):
                frame = np.ascontiguousarray(picture[: shape[0], : shape[1]])
                pending.result()
                pending = line.submit(writer.add_image, frame)
                count += 1
                progress()
            pending.result()
    except (RuntimeError, OSError, subprocess.SubprocessError) as error:
        # a signal such as Ctrl-C also ends ffmpeg
        if error.__context__ is not None and not isinstance(error.__context__, Exception):
            raise error.__context__ from None
        reason = str(error).strip().splitlines()[-1:] or ["no reason given"]
        raise OutputError(f"cannot write {path.suffix[1:]} video: ffmpeg failed: {reason[0]}") from error
    return count


def _write_sequence(path: Path, pictures: Iterator[Picture], progress: Callable[[], None]) -> int:
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise OutputError(f"cannot write pictures to {path}: it is not an empty directory; name a new one")
    if not path.parent.is_dir():
        raise OutputError(f"cannot write {path}: there is no directory {path.parent}; create it first")
    count = 0
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as scratch:
            temporary = Path(scratch) / "frames"
            temporary.mkdir()
            for picture in pictures:
                _write_png(temporary / f"{count:05d}.png", picture)
                count += 1
                progress()
            temporary.replace(path)
    except OSError as error:
        raise OutputError(f"cannot write pictures to {path}: {error.strerror or error}") from error
    return count


def _write_png(path: Path, picture: Picture) -> None:
    from PIL import Image

    Image.fromarray(picture).save(path, optimize=True)


def _require_extension(path: Path, *extensions: str) -> None:
    if path.suffix not in extensions:
        raise InputError(
            f"cannot write {path.name}: extension {path.suffix or '(none)'!r} "
            f"is not one of {', '.join(extensions)}"
        )
