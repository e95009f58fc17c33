"""How a command ends: exit codes, signals, and streams that nobody reads or that take nothing."""

import errno
import os
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

REFUSED = 2
# what the command-line library returns for Ctrl-C, without a word
INTERRUPTED = 130
# as a program that the system ends for that: 128 + SIGPIPE
CLOSED_PIPE = 141
# a fault of the program, as sysexits.h numbers it: never taken for 1, *missed*
INTERNAL = 70
# set to anything, it shows where an internal error came from
DEBUG = "MECHSIM_DEBUG"
# what a stream says that cannot take what is printed
UNWRITABLE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF}
# after so many seconds a signal comes again that was swallowed where no exception can leave
AGAIN = 0.05
# when the command was typed, by `time.perf_counter`, as far as a program can know
typed_at = time.perf_counter()
# what there is to say beside a result; a refusal says all by itself
notes: list[str] = []
# what is asked back of what was typed: beside a result in lines of their own, in a refusal's line otherwise
questions: list[str] = []
SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class EndedError(BaseException):
    """The system asked the program to end; whatever is half made is taken away on the way out."""


def ended(command: Callable[[], Any]) -> int:
    """Run a command to its exit code; what went wrong is said in one line on stderr.

    0 and 1 are the command's own, 2 is refused or interrupted, 70 a fault of the program, and 128 and
    the number of the signal where one ended it.
    """
    global typed_at
    typed_at = time.perf_counter()
    notes.clear()
    questions.clear()
    opened_streams()
    with _listening() as came:
        code = _outcome(command, came)
    if code in (0, 1):
        for line in (*(f"mechsim: {question}" for question in questions), *notes):
            tell(line)
    return _flushed(code)


def opened_streams() -> None:
    """Let a closed stdin, stdout or stderr take everything, lest a file that is written get its number."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115


def tell(line: str) -> None:
    """Print a line on stderr, if that takes it."""
    with suppress(OSError, ValueError):
        print(" ".join(line.split()), file=sys.stderr, flush=True)


def _outcome(command: Callable[[], Any], came: list[int]) -> int:
    try:
        code = command()
    except BaseException as error:
        # after a signal whatever else goes wrong comes of it: an encoder that was interrupted too, an
        # import of compiled code that says anything but that
        return _ended_by(came[0]) if came else _failed(error)
    if code == INTERRUPTED:
        return _ended_by(signal.SIGINT)
    return code if isinstance(code, int) else 0


def _failed(error: BaseException) -> int:
    if isinstance(error, MechsimError):
        return _refused(str(error))
    if isinstance(error, TyperException):
        return _refused(error.format_message() if hasattr(error, "format_message") else str(error))
    if isinstance(error, KeyboardInterrupt | Abort):
        return _ended_by(signal.SIGINT)
    if isinstance(error, SystemExit) and error.code in (0, None):
        # what a shell asks for at the Tab key was answered
        return 0
    if isinstance(error, BrokenPipeError | SystemExit):
        # the command-line library, too, ends so when nobody reads on
        return CLOSED_PIPE
    if isinstance(error, OSError) and error.errno in UNWRITABLE:
        return _refused(f"cannot write: {error.strerror}; make room, or write elsewhere")
    # MuJoCo has an error of its own for it
    if isinstance(error, MemoryError) or "could not allocate memory" in str(error).lower():
        return _refused(f"not enough memory ({error or 'no figure known'}); ask for less")
    if os.environ.get(DEBUG):
        traceback.print_exception(error)
    said = f"{type(error).__name__}: {error}"
    tell(f"mechsim: internal error: {cut(said, 300)}: please report it; {DEBUG}=1 shows where it came from")
    return INTERNAL


def _refused(message: str) -> int:
    tell(f"mechsim: {'; '.join([message, *questions])}")
    return REFUSED


def _ended_by(number: int) -> int:
    tell("mechsim: stopped")
    return REFUSED if number == signal.SIGINT else 128 + number


def _flushed(code: int) -> int:
    """Return the exit code once all that was printed has left; what cannot leave is dropped."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            # what is left in its buffer would be tried again, and be a second error, at the very end
            with suppress(OSError, ValueError), open(os.devnull, "w") as nowhere:
                os.dup2(nowhere.fileno(), stream.fileno())
            if stream is sys.stdout and code in (0, 1):
                code = _failed(error)
    return code


@contextmanager
def _listening() -> Generator[list[int]]:
    """Give a list of the signals that came; one that a destructor swallowed comes again."""
    came: list[int] = []
    # a signal that is to come again; none does once another came, or once nobody listens
    later: list[threading.Timer] = []

    def interrupt(number: int, _: object) -> None:
        came.append(number)
        for one in later:
            one.cancel()
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise EndedError

    def lost(what: "sys.UnraisableHookArgs") -> None:
        if not isinstance(what.exc_value, KeyboardInterrupt | EndedError):
            sys.__unraisablehook__(what)
        elif came:
            again = threading.Timer(AGAIN, os.kill, (os.getpid(), came[-1]))
            again.daemon = True
            later[:] = [again]
            again.start()

    # a signal that is ignored, as under nohup, stays so
    heard = [one for one in SIGNALS if signal.getsignal(one) not in (signal.SIG_IGN, None)]
    if threading.current_thread() is not threading.main_thread():
        heard = []
    before, hook = {one: signal.signal(one, interrupt) for one in heard}, sys.unraisablehook
    sys.unraisablehook = lost
    try:
        yield came
    finally:
        for one in later:
            one.cancel()
        sys.unraisablehook = hook
        for one, old in before.items():
            signal.signal(one, old)
