"""Each option of each command: does it change the output or a file, or is it rejected?

    .venv/bin/python validation/robustness/options_without_effect.py [COMMAND ...]

An option that is accepted and changes nothing is printed. Some have no effect for a good reason, such as a
value that equals the model's own; each line is to be judged.
"""

import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import tomllib
from pathlib import Path

from mutated_files import import_everything

from mechsim.cli import COMMANDS, load_command, main

MUTATED = Path(__file__).parent / "mutated"
WORDS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
# [s] of processor time of a run: longer ones count as changed
LIMIT = 90
# lines of progress, which begin with the command and depend on the load of the computer
PROGRESS = re.compile(rf"^({'|'.join(COMMANDS)}): .*\n", re.MULTILINE)


def outcome(words: list[str]) -> tuple[int, list[str]]:
    """Return exit code and words of the output and files of a command, run in a child process."""
    folder = Path(tempfile.mkdtemp())
    for path in MUTATED.iterdir():
        shutil.copy(path, folder)
    shutil.copy(Path(__file__).with_suffix(".xml"), folder / "scene.xml")
    before = {path.name for path in folder.iterdir()} | {"printed"}
    if (child := os.fork()) == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))
        os.chdir(folder)
        printed = os.open("printed", os.O_CREAT | os.O_WRONLY)
        for stream in (1, 2):
            os.dup2(printed, stream)
        sys.argv = ["mechsim", *words]
        try:
            main()
        except SystemExit as end:
            sys.stdout.flush()
            os._exit(end.code if isinstance(end.code, int) else 0)
        sys.stdout.flush()
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    written = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in before]
    text = "\n".join(path.read_bytes().decode("latin-1") for path in [folder / "printed", *written])
    text = PROGRESS.sub("", text)
    shutil.rmtree(folder)
    return code, re.split(r"[\s,]+", text)


def check(command: str, base: str) -> None:
    """Print the options that a run accepts without an effect."""
    words = [*command.split(), *base.split()]
    (code, first), (_, second) = outcome(words), outcome(words)
    if code not in (0, 1) or len(first) != len(second):
        print(f"{' '.join(words)}: exit code {code}: {' '.join(first)[:200]}", flush=True)
        return
    # times of the computer differ between equal runs
    equal = [a == b for a, b in zip(first, second, strict=False)]
    for parameter in load_command(command).params:
        name = max(parameter.opts, key=len).lstrip("-")
        option = max(parameter.opts, key=len)
        stated = option in words or (name == "output" and "-o" in words) or (name == "n" and "-n" in words)
        if parameter.param_type_name != "option" or name in ("json", "help", "verbose") or stated:
            continue
        if parameter.is_flag and parameter.default and parameter.secondary_opts:
            option = parameter.secondary_opts[0]
        for value in [None] if parameter.is_flag else WORDS["values"][name]:
            tried = [*words, option, *([] if value in (None, "") else [value])]
            changed, now = outcome(tried)
            same = len(now) == len(first) and all(
                a == b for a, b, e in zip(first, now, equal, strict=False) if e
            )
            if changed not in (0, 1, 2, -signal.SIGXCPU, -signal.SIGKILL) or (changed == code and same):
                print(f"{' '.join(tried)}: exit code {changed}", flush=True)


if __name__ == "__main__":
    import_everything()
    for command in sys.argv[1:] or COMMANDS:
        for base in WORDS["runs"].get(command, WORDS["runs"]["others"]):
            check(command, base)
