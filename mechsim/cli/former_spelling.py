"""The present spelling of `mechsim dynamics MODEL`, which was one command before it had sub-commands."""

import shlex
from collections.abc import Sequence

# option of `dynamics` when it was one command -> its present sub-command; the others are of inverse
FORMER = {
    "statics": ("--statics", "--assemblies"),
    "modes": ("--modes",),
    "response": ("--response",),
    "forward": (
        "--initial",
        "--until",
        "--free",
        "--motor",
        "--controller",
        "--of",
        "--restitution",
        "--budget",
    ),
}


def present_spelling(args: Sequence[str]) -> str:
    """Return sub-command and arguments of `dynamics` for those of the time when it was one command."""
    options = {arg.partition("=")[0] for arg in args}
    name = next((name for name, old in FORMER.items() if options & {*old}), "inverse")
    words = [arg for arg in args if arg not in ("--statics", "--modes", "--free")]
    if "--response" in words:
        index = words.index("--response")
        # LOAD:QUANTITY is an argument after the model
        words = [*words[:1], *words[index + 1 : index + 2], *words[1:index], *words[index + 2 :]]
    if "--free" in args and "--speed" in words:
        index = words.index("--speed")
        words[index : index + 2] = ["--initial", f"crank.v={''.join(words[index + 1 : index + 2])}"]
    return shlex.join([name, *words])
