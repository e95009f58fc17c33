"""Valid commands with a fault in a word or in a file."""

import random
import re
from collections import defaultdict
from dataclasses import replace
from itertools import islice

from command_outcomes import Case
from extreme_magnitudes import with_extreme_magnitude
from valid_commands import CommandCase, valid_cases

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
UNUSUAL_VALUES = ["", " ", "n" * 300, "\ud83d", *VALUES.split()]
# extension -> class of a corrupted file
FILE_CLASSES = {"toml": "broken TOML", "xml": "broken MJCF", "csv": "broken table", "py": "broken formula"}
NUMBERS = re.compile(r"(?<![A-Za-z_])-?\d+\.?\d*(?:[eE]-?\d+)?")
WORDS = re.compile(r"[A-Za-z_]{2,}")
UNUSUAL_NUMBERS = ["0", "-1", "nan", "inf", "1e300", "1e-300", "1e999", '""', "abc", "1e9", "10", "0.1", "3x"]
UNUSUAL_TEXT = ["\x00", "\ufeff", "\t", "\r", *"é#\"'[]{}=<>&,"]


def random_cases(chance: random.Random, count: int, valid_fraction: float) -> list[CommandCase]:
    """Return random cases: a fraction of them valid, the others invalid."""
    all_cases, by_command = valid_cases(), defaultdict[str, list[CommandCase]](list)
    for item in all_cases:
        by_command[item.case.words[0]].append(item)
    commands = [command for command in sorted(by_command) for _ in range(1 if command in SLOW else 3)]
    valid_ones = chance.sample(all_cases, min(len(all_cases), round(valid_fraction * count)))
    invalid_ones = (
        invalid_case(chance, chance.choice(by_command[chance.choice(commands)])) for _ in range(count)
    )
    return [*valid_ones, *islice(invalid_ones, count - len(valid_ones))]


def invalid_case(chance: random.Random, item: CommandCase) -> CommandCase:
    """Return a valid case with a fault."""
    words = list(item.case.words)
    kinds = ["value", "value", "word", *["file"] * (3 if item.breakable else 0)]
    scenes = [name for name in item.breakable if name.endswith(".xml")]
    kind = chance.choice([*kinds, *["magnitude"] * (3 if scenes else 0)])
    if kind == "magnitude":
        name = chance.choice(scenes)
        model = item.case.files[name].decode()
        for _ in range(chance.randint(1, 2)):
            model = with_extreme_magnitude(chance, model)
        return _with_file(item, "extreme magnitude", name, model.encode())
    if kind == "file":
        name = chance.choice(item.breakable)
        text = item.case.files[name]
        for _ in range(chance.randint(1, 3)):
            text = corrupted(chance, text)
        return _with_file(item, FILE_CLASSES[name.rpartition(".")[2]], name, text)
    if kind == "value":
        for option in chance.sample(options_of(words[0]), k=chance.randint(1, 2)):
            words += [option, chance.choice(UNUSUAL_VALUES)]
    else:
        i = chance.randrange(1, len(words))
        if chance.randrange(4) == 0:
            words[i] = chance.choice(UNUSUAL_VALUES)
        else:
            change_item(chance, words, i, UNUSUAL_TEXT[1:])
    kind = "unusual value" if kind == "value" else "garbled word"
    return replace(item, kind=kind, case=Case(tuple(words), item.case.files), valid=False, must_agree=False)


def _with_file(item: CommandCase, kind: str, name: str, content: bytes) -> CommandCase:
    case = Case(item.case.words, {**item.case.files, name: content})
    return replace(item, kind=kind, case=case, valid=False, must_agree=False)


def change_item(chance: random.Random, items: list[str], i: int, letters: list[str]) -> None:
    """Remove a word or row, duplicate it, or insert a letter into it."""
    change = chance.randrange(3)
    if change == 0:
        del items[i]
    elif change == 1:
        items.insert(i, items[i])
    else:
        j = chance.randrange(len(items[i]) + 1)
        items[i] = items[i][:j] + chance.choice(letters) + items[i][j:]


def corrupted(chance: random.Random, content: bytes) -> bytes:
    """Return a text with one fault."""
    text = content.decode(errors="replace")
    rows = text.splitlines(keepends=True) or [""]
    i = chance.randrange(len(rows))
    change = chance.randrange(9)
    if change < 3:
        change_item(chance, rows, i, UNUSUAL_TEXT)
    elif change == 3:
        return content[: chance.randrange(len(content) + 1)]
    elif change == 4:
        j = chance.randrange(len(rows))
        rows[i], rows[j] = rows[j], rows[i]
    elif change == 5:
        return content + bytes(chance.randrange(256) for _ in range(9))
    else:
        # replace a number or a word by another
        matches = list((NUMBERS if change < 8 else WORDS).finditer(text))
        if matches:
            match = chance.choice(matches)
            new = chance.choice(UNUSUAL_NUMBERS) if change < 8 else chance.choice(WORDS.findall(text))
            return (text[: match.start()] + new + text[match.end() :]).encode(errors="replace")
    return "".join(rows).encode(errors="replace")


def options_of(command: str) -> list[str]:
    """Return the options of a command that take a value."""
    if command not in cli.COMMANDS:
        return ["--set"]
    parameters = cli.load_command(command).params
    return [
        item.opts[0]
        for item in parameters
        if item.opts[0].startswith("-") and not getattr(item, "is_flag", True)
    ]
