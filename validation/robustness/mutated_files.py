"""Mutated input files: each command ends in a result or one clear line, in time and in memory.

    python validation/robustness/mutated_files.py [--mutants 20000] [--seed 0]

A mutant has one to three random changes: numbers, words, lines or bytes of a gallery file, a file of
`models` or one of `mutated`. A child of this process, which has imported everything, runs a command on it:
mostly one that reads, checks or writes the file; one in three solves or simulates. A fault is an exit code
other than 0, 1 and 2, exit code 2 without exactly one line on stderr, a warning of Python there, more than
`SECONDS` of processor time, more than `MEMORY` resident, or an incomplete file. The exit code is 1 if there
was any fault.
"""

import argparse
import gc
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from command_outcomes import Case, file_faults, output_faults

from mechsim import cli

ROOT = Path(__file__).resolve().parents[2]
OWN = Path(__file__).parent / "mutated"
# limits of processor time in [s], wall time in [s], resident memory and mapped memory in bytes
SECONDS, WALL, MEMORY, MAPPED = 60, 600, 2 * 1024**3, 16 * 1024**3
NUMBER = re.compile(rb"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_]\w*")
# weights of the commands that read, check or write a file; the others have 1
WEIGHTS = {"show": 6, "check": 6, "export": 4}
# libraries that mechsim imports when they are needed
LIBRARIES = ("networkx", "pydantic", "scipy.optimize", "yaml")
TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
# commands of each kind of file, and what replaces numbers and bytes
COMMANDS = TABLE["commands"]
NUMBERS, TEXTS = ([text.encode("latin-1") for text in TABLE[kind]] for kind in ("numbers", "texts"))
NUMBERS.append(b"9" * 5000)
TEXTS += [text.encode() * 2000 for text in TABLE["repeated"]]


def inputs() -> list[Path]:
    """Return the files that are mutated."""
    return sorted([*ROOT.glob("models/gallery/*.toml"), *ROOT.glob("models/*.xml"), *OWN.iterdir()])


def mutant(content: bytes, chance: random.Random) -> bytes:
    """Return a file with one to three random changes."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        change = chance.choices((changed_number, changed_word, changed_lines, changed_bytes), (12, 4, 2, 1))[
            0
        ]
        content = change(content, chance)
    return content


def changed_number(content: bytes, chance: random.Random) -> bytes:
    """Return a file with one other number: of the file, near the former, or extreme."""
    tokens = list(NUMBER.finditer(content))
    if not tokens:
        return content
    token = chance.choice(tokens)
    about = repr(float(token[0]) * chance.choice((1 + 1e-6, 1.01, 1.5, -1.0, 10.0))).encode()
    new = chance.choice((chance.choice(tokens)[0], about, about, chance.choice(NUMBERS)))
    return content[: token.start()] + new + content[token.end() :]


def changed_word(content: bytes, chance: random.Random) -> bytes:
    """Return a file with one word replaced by another of the file."""
    tokens = list(WORD.finditer(content))
    if not tokens:
        return content
    token = chance.choice(tokens)
    return content[: token.start()] + chance.choice(tokens)[0] + content[token.end() :]


def changed_lines(content: bytes, chance: random.Random) -> bytes:
    """Return a file with a line deleted, repeated elsewhere or exchanged."""
    lines = content.split(b"\n")
    i, j = chance.randrange(len(lines)), chance.randrange(len(lines))
    exchanged = lines.copy()
    exchanged[i], exchanged[j] = lines[j], lines[i]
    return b"\n".join(
        chance.choice((lines[:i] + lines[i + 1 :], [*lines[:i], lines[j], *lines[i:]], exchanged))
    )


def changed_bytes(content: bytes, chance: random.Random) -> bytes:
    """Return a file with a few bytes replaced by hostile text."""
    start = chance.randrange(len(content) + 1)
    return content[:start] + chance.choice(TEXTS) + content[start + chance.randint(0, 8) :]


def random_case(chance: random.Random) -> Case:
    """Return a command and the mutant that it reads, with the other files of its folder."""
    path = chance.choice(inputs())
    commands = COMMANDS.get(path.name) or COMMANDS[path.suffix]
    weights = [WEIGHTS.get(command.split()[0], 1) for command in commands]
    words = chance.choices(commands, weights)[0].replace("FILE", path.name)
    files = {other.name: other.read_bytes() for other in (OWN / "tree.urdf", OWN / "loops.yaml")}
    return Case(tuple(words.split()), {**files, path.name: mutant(path.read_bytes(), chance)})


def run_in_child(case: Case, folder: Path) -> Iterator[str]:
    """Run a command in a child process; yield its exit code as text, then its faults."""
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    with tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            become_command(case, folder, err.fileno())
        _, status, usage = os.wait4(child, 0)
        err.seek(0)
        output = err.read().decode(errors="replace")
    code = os.waitstatus_to_exitcode(status)
    yield str(code)
    if code < 0:
        yield f"ended by {signal.Signals(-code).name} after {usage.ru_utime + usage.ru_stime:.0f} s"
    if usage.ru_maxrss * 1024 > MEMORY:
        yield f"{usage.ru_maxrss / 1024**2:.1f} GB"
    if "Warning:" in output:
        yield f"a warning on stderr: {output[:300]!r}"
    yield from output_faults(code, output)
    yield from file_faults(folder, case, code)


def become_command(case: Case, folder: Path, err: int) -> None:
    """Run a command in this process, with limits, and end it."""
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (MAPPED, MAPPED))
    signal.alarm(WALL)
    os.chdir(folder)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(err, 2)
    # a caller may have replaced the streams of Python
    sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
    sys.argv = ["mechsim", *case.words]
    code = 70
    try:
        cli.main()
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 0
    finally:
        sys.stderr.flush()
        # the parent's handlers and threads are not the child's
        os._exit(code)


def import_everything() -> None:
    """Import mechsim and the libraries that its commands need, so that the children need not."""
    modules = [module.name for module in walk_packages([str(ROOT / "mechsim")], "mechsim.")]
    for name in (*LIBRARIES, *modules):
        if not name.endswith("__main__") and ".templates" not in name:
            import_module(name)
    # the children's garbage collector need not look at them, which would copy their pages
    gc.freeze()


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Mutated input files: a result or one clear line.")
    parser.add_argument("--mutants", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the files of each fault")
    options = parser.parse_args(arguments)
    import_everything()
    chance, codes, total = random.Random(options.seed), Counter[str](), 0
    for number in range(options.mutants):
        case = random_case(chance)
        with tempfile.TemporaryDirectory() as folder:
            code, *faults = run_in_child(case, Path(folder))
            if faults and options.keep:
                shutil.copytree(folder, options.keep / f"{options.seed}-{number}", dirs_exist_ok=True)
        codes[code] += 1
        total += bool(faults)
        for fault in faults:
            print(f"FAULT {number}: {' '.join(case.words)}: {fault}", flush=True)
    print("exit codes: " + ", ".join(f"{code}: {count}" for code, count in sorted(codes.items())))
    print(f"{options.mutants} mutants, {total} with faults")
    return 1 if total else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
