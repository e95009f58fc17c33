"""Sound commands with something wrong: in what is typed, or in a file."""

import random
import re
from collections import defaultdict
from dataclasses import replace
from itertools import islice

from command_outcomes import Case
from extreme_magnitudes import odd
from valid_commands import Tried, sound_cases

from mechsim import cli

SLOW = ("tune", "reduce", "tradeoff", "trace", "validate", "view", "render", "fit")
VALUES = """
0 -1 nan inf 1e300 1e-300 1e999 -0 x é ٣ 1,5 0x10 13mm 1;2 1:2 0:1:0.1 0:360:0deg a:b:c :: 1=2 = A A,B
A,,B crank crank= crank= crank=1 crank=nan crank=600rpm crank=t/0 crank=1/t crank=sin( crank=FILE.csv
crank=crank.csv crank=1e300rpm crank=t**t**t crank=__import__('os') crank=1:2:3 all . no/out.csv out.csv
out.xml out.json out.nc crank.csv law.py:law law.py:none law.py no.py:law max:C.x range: range:crank
at:1:C.x at:x:C.x max: max: sobol:4 sobol:0 sobol:x latin:-1 normal uniform smooth fold step pose
trajectory torque closure 1um 1deg 1e-6 1s 0.1s -1s 600rpm 0rpm 5deg 0rpm 5deg 0,-9.81,0 0,0 constant:1
dc:1,0,1 line:1 A:B=1,0 crank=1,2 crank=-1,0
"""
STRANGE = ["", " ", "n" * 300, "\ud83d", *VALUES.split()]
# extension -> what a file with something wrong is counted as
BROKEN = {"toml": "broken TOML", "xml": "broken MJCF", "csv": "broken table", "py": "broken formula"}
NUMBERS = re.compile(r"(?<![A-Za-z_])-?\d+\.?\d*(?:[eE]-?\d+)?")
WORDS = re.compile(r"[A-Za-z_]{2,}")
ODD_NUMBERS = ["0", "-1", "nan", "inf", "1e300", "1e-300", "1e999", '""', "abc", "1e9", "10", "0.1", "3x"]
ODD_TEXT = ["\x00", "\ufeff", "\t", "\r", *"é#\"'[]{}=<>&,"]


def drawn(chance: random.Random, count: int, sound: float) -> list[Tried]:
    """Return cases, a part of them sound, the rest with something wrong."""
    every, by_command = sound_cases(), defaultdict[str, list[Tried]](list)
    for item in every:
        by_command[item.case.words[0]].append(item)
    often = [command for command in sorted(by_command) for _ in range(1 if command in SLOW else 3)]
    whole = chance.sample(every, min(len(every), round(sound * count)))
    wrong = (spoilt(chance, chance.choice(by_command[chance.choice(often)])) for _ in range(count))
    return [*whole, *islice(wrong, count - len(whole))]


def spoilt(chance: random.Random, item: Tried) -> Tried:
    """Return a sound case with something wrong."""
    words = list(item.case.words)
    kinds = ["value", "value", "word", *["file"] * (3 if item.breakable else 0)]
    scenes = [name for name in item.breakable if name.endswith(".xml")]
    kind = chance.choice([*kinds, *["odd"] * (3 if scenes else 0)])
    if kind == "odd":
        name = chance.choice(scenes)
        made = item.case.files[name].decode()
        for _ in range(chance.randint(1, 2)):
            made = odd(chance, made)
        return _with_file(item, "odd magnitude", name, made.encode())
    if kind == "file":
        name = chance.choice(item.breakable)
        text = item.case.files[name]
        for _ in range(chance.randint(1, 3)):
            text = broken(chance, text)
        return _with_file(item, BROKEN[name.rpartition(".")[2]], name, text)
    if kind == "value":
        for option in chance.sample(options_of(words[0]), k=chance.randint(1, 2)):
            words += [option, chance.choice(STRANGE)]
    else:
        at = chance.randrange(1, len(words))
        if chance.randrange(4) == 0:
            words[at] = chance.choice(STRANGE)
        else:
            _slip(chance, words, at, ODD_TEXT[1:])
    kind = "strange value" if kind == "value" else "garbled word"
    return replace(
        item, kind=kind, case=Case(tuple(words), item.case.files), sound=False, missed_is_wrong=False
    )


def _with_file(item: Tried, kind: str, name: str, content: bytes) -> Tried:
    made = Case(item.case.words, {**item.case.files, name: content})
    return replace(item, kind=kind, case=made, sound=False, missed_is_wrong=False)


def _slip(chance: random.Random, parts: list[str], at: int, letters: list[str]) -> None:
    """Lose one of some words or rows, double it, or put a letter into it."""
    change = chance.randrange(3)
    if change == 0:
        del parts[at]
    elif change == 1:
        parts.insert(at, parts[at])
    else:
        cut = chance.randrange(len(parts[at]) + 1)
        parts[at] = parts[at][:cut] + chance.choice(letters) + parts[at][cut:]


def broken(chance: random.Random, content: bytes) -> bytes:
    """Return a text with one thing wrong with it."""
    text = content.decode(errors="replace")
    rows = text.splitlines(keepends=True) or [""]
    at = chance.randrange(len(rows))
    change = chance.randrange(9)
    if change < 3:
        _slip(chance, rows, at, ODD_TEXT)
    elif change == 3:
        return content[: chance.randrange(len(content) + 1)]
    elif change == 4:
        other = chance.randrange(len(rows))
        rows[at], rows[other] = rows[other], rows[at]
    elif change == 5:
        return content + bytes(chance.randrange(256) for _ in range(9))
    else:
        # half of all: a number, or a word, for another
        result = list((NUMBERS if change < 8 else WORDS).finditer(text))
        if result:
            place = chance.choice(result)
            new = chance.choice(ODD_NUMBERS) if change < 8 else chance.choice(WORDS.findall(text))
            return (text[: place.start()] + new + text[place.end() :]).encode(errors="replace")
    return "".join(rows).encode(errors="replace")


def options_of(command: str) -> list[str]:
    """Return the options of a command that take a value."""
    if command not in cli.COMMANDS:
        return ["--set"]
    made = cli.load_command(command).params
    return [
        item.opts[0] for item in made if item.opts[0].startswith("-") and not getattr(item, "is_flag", True)
    ]
