"""End of a command: exit codes, signals, closed and full output streams."""

import errno
import io
import os
import re
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import Any

from typer import Abort
from typer.exceptions import TyperException

from mechsim.errors import MechsimError, cut

# invalid input
INVALID = 2
# exit code of the command-line library for Ctrl-C
INTERRUPTED = 130
# 128 + SIGPIPE, as if the system had ended the program
CLOSED_PIPE = 141
# an internal error (EX_SOFTWARE in sysexits.h); distinct from 1, *failed*
INTERNAL = 70
# environment variable that enables the traceback of an internal error
DEBUG = "MECHSIM_DEBUG"
# longest word of a message, more than a path has
MAX_WORD = 300
LONG_WORD = re.compile(rf"\S{{{MAX_WORD},}}")
# error numbers of a stream that cannot be written
UNWRITABLE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF}
# delay in [s] after which a signal lost in a destructor is sent again
RESEND_AFTER = 0.05
# start time of the command, from `time.perf_counter`
typed_at = time.perf_counter()
# lines on stderr after a result; an error omits them
notes: list[str] = []
# questions about the input: lines on stderr after a result, part of the line of an error
questions: list[str] = []
SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class EndedError(BaseException):
    """The system terminates the program; unfinished files are removed."""


def exit_code(command: Callable[[], Any]) -> int:
    """Run a command and return its exit code; an error is one line on stderr.

    0 and 1 are the command's own, 2 is invalid input, 70 an internal error, and 128 plus the number of a
    signal that ended it, as 130 for Ctrl-C.
    """
    global typed_at
    typed_at = time.perf_counter()
    notes.clear()
    questions.clear()
    open_streams()
    with _listening() as signals:
        code = _outcome(command, signals)
    if code in (0, 1):
        # a command may read its model several times
        for line in dict.fromkeys((*(f"mechsim: {question}" for question in questions), *notes)):
            print_stderr(line)
    return _flushed(code)


def open_streams() -> None:
    """Open closed standard streams on the null device, so that no output file gets their file descriptor.

    Output is UTF-8, as files are, unless PYTHONIOENCODING states another: Windows has its own in pipes.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    encoding = None if os.environ.get("PYTHONIOENCODING") else "utf-8"
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding=encoding, errors="backslashreplace")


def print_stderr(line: str) -> None:
    """Print a line on stderr; ignore errors."""
    with suppress(OSError, ValueError):
        print(" ".join(line.split()), file=sys.stderr, flush=True)


def _outcome(command: Callable[[], Any], signals: list[int]) -> int:
    try:
        code = command()
    except BaseException as error:
        # an error after a signal is its consequence, such as an interrupted encoder or a broken import
        return _ended_by(signals[0]) if signals else _failed(error)
    if code == INTERRUPTED:
        return _ended_by(signal.SIGINT)
    return code if isinstance(code, int) else 0


def _failed(error: BaseException) -> int:
    if isinstance(error, MechsimError):
        return _invalid(str(error))
    if isinstance(error, TyperException):
        return _invalid(_usage_text(error))
    if isinstance(error, KeyboardInterrupt | Abort):
        return _ended_by(signal.SIGINT)
    if isinstance(error, SystemExit) and error.code in (0, None):
        # the shell completion succeeded
        return 0
    if isinstance(error, BrokenPipeError | SystemExit):
        # the reader closed the pipe; the command-line library ends with the same code
        return CLOSED_PIPE
    if isinstance(error, OSError) and error.errno in UNWRITABLE:
        return _invalid(f"cannot write: {error.strerror}; free some space, or write elsewhere")
    # MuJoCo has its own error for missing memory
    if isinstance(error, MemoryError) or "could not allocate memory" in str(error).lower():
        return _invalid(f"not enough memory ({error or 'no figure known'}); reduce the task")
    if os.environ.get(DEBUG):
        traceback.print_exception(error)
    text = f"{type(error).__name__}: {error}"
    print_stderr(
        f"mechsim: internal error: {cut(text, 300)}: please report it; {DEBUG}=1 shows where it came from"
    )
    return INTERNAL


# messages of the command-line library, and their text in the style of mechsim's other errors
USAGE_TEXTS = (
    (r"^(No such option: --initial).*$", r"\1; mechsim dynamics forward starts from an initial state"),
    (r"\. Did you mean", "; did you mean"),
    (r" \(Possible options: (.*)\)$", r"; did you mean \1?"),
    (r"^Got unexpected extra argument(?:s|\(s\))? \((.*)\)$", r"unexpected argument \1"),
    (r"Input should be a valid integer.*$", "give a whole number"),
    (r"Input should be a valid number.*$", "give a number"),
    (r"\.$", ""),
)


def _usage_text(error: Any) -> str:
    """Return the error in a command line, and the command that shows its help."""
    text: str = error.format_message()
    for pattern, replacement in USAGE_TEXTS:
        text = re.sub(pattern, replacement, text)
    context = getattr(error, "ctx", None)
    if context is None:
        return text
    names: list[str] = []
    while context.parent:
        names, context = [context.info_name, *names], context.parent
    named = " ".join(["mechsim", *names])
    joint = "" if text.endswith("?") else ";"
    return f"{text[:1].lower()}{text[1:]}{joint} see `{named} --help`"


def _invalid(message: str) -> int:
    # a number or a name of the input may have thousands of characters
    message = LONG_WORD.sub(lambda word: f"{word[0][:MAX_WORD]}...", message)
    print_stderr(f"mechsim: {'; '.join([message, *questions])}")
    return INVALID


def _ended_by(number: int) -> int:
    print_stderr("mechsim: stopped")
    return 128 + number


def _flushed(code: int) -> int:
    """Return the exit code after flushing stdout and stderr; output that cannot be written is dropped."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            # flushing the rest of the buffer would fail again at exit
            with suppress(OSError, ValueError), open(os.devnull, "w") as null:
                os.dup2(null.fileno(), stream.fileno())
            if stream is sys.stdout and code in (0, 1):
                code = _failed(error)
    return code


@contextmanager
def _listening() -> Generator[list[int]]:
    """Yield a list of received signals; a signal lost in a destructor is sent again."""
    received: list[int] = []
    # timers of signals to be sent again
    timers: list[threading.Timer] = []

    def interrupt(number: int, _: object) -> None:
        received.append(number)
        for timer in timers:
            timer.cancel()
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise EndedError

    def resend(what: "sys.UnraisableHookArgs") -> None:
        if not isinstance(what.exc_value, KeyboardInterrupt | EndedError):
            sys.__unraisablehook__(what)
        elif received:
            timer = threading.Timer(RESEND_AFTER, os.kill, (os.getpid(), received[-1]))
            timer.daemon = True
            timers[:] = [timer]
            timer.start()

    # ignored signals remain ignored, as under nohup
    handled = [number for number in SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    if threading.current_thread() is not threading.main_thread():
        handled = []
    previous = {number: signal.signal(number, interrupt) for number in handled}
    hook, sys.unraisablehook = sys.unraisablehook, resend
    try:
        yield received
    finally:
        for timer in timers:
            timer.cancel()
        sys.unraisablehook = hook
        for number, handler in previous.items():
            signal.signal(number, handler)
