"""Every command with valid models: catalogue names, gallery files, exported models."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from command_outcomes import Case

from mechsim import catalog

ROOT = Path(__file__).resolve().parents[2]
GALLERY = ROOT / "models" / "gallery"
SWINGING = "peaucellier_lipkin.toml"
EXPORTED = ("four_bar", "slider_crank", "rssr", "rrsrr", "looper", "bennett")
# catalogue name -> a point, a dimension and its range
VARIED = {
    "four_bar": ("C", "rocker", "70mm:78mm"),
    "slider_crank": ("B", "rod", "0.19:0.21"),
    "rssr": ("P3", "rocker", "26mm:28mm"),
    "rrsrr": ("C", "link", "38.5mm:39.5mm"),
    "looper": ("E", "rocker", "31.5mm:32.5mm"),
    "bennett": ("A", "twist0", "33deg:35deg"),
}
FORMULA_TEXT = """import numpy as np

def law(angle):
    return {"A": np.stack([0.032 * np.cos(angle), 0.032 * np.sin(angle), 0 * angle], 1)}
"""


@dataclass(frozen=True)
class CommandCase:
    """A case, its class, the files that may be corrupted, and what counts as a fault."""

    kind: str
    case: Case
    breakable: tuple[str, ...] = ()
    valid: bool = False
    must_agree: bool = False


def subjects() -> Iterator[tuple[str, dict[str, bytes]]]:
    """Yield valid models: the argument, and the files it needs."""
    for name in catalog.MECHANISMS:
        yield name, {}
    python_files = {path.name: path.read_bytes() for path in GALLERY.glob("*.py")}
    for path in sorted(GALLERY.glob("*.toml")):
        yield path.name, {path.name: path.read_bytes(), **python_files}
    for name in EXPORTED:
        yield f"{name}.xml", {f"{name}.xml": (ROOT / "models" / f"{name}.xml").read_bytes()}


def command_lines(model: str) -> Iterator[str]:
    """Yield the commands that must accept a valid model."""
    # a full revolution of a swinging crank is correctly rejected
    angles = " --angles -60deg:60deg:5deg" if model == SWINGING else ""
    yield from (f"show {model} --json", f"solve {model}{angles} -o out.csv", f"solve {model}{angles} --json")
    yield f"view {model} -o out.html"
    if not angles:
        yield f"simulate {model} -o out.npz"
    yield from (f"plot {model} -o out.svg", f"render {model} -o out.png --size 64x48")
    if not model.endswith(".xml"):
        yield from (f"export {model} -o out.xml", f"export {model} --format toml -o out.toml")
        yield from (f"dynamics inverse {model} --json", f"validate {model} --json")
    else:
        run = f"{model} --drive crank=600rpm --duration 0.1"
        yield from (
            f"simulate {run} -o out.csv",
            f"validate {run} --json",
            f"trace {model} --starts 9 --json",
        )
    if model == "four_bar.xml":
        run = f"{model} --drive crank=600rpm --duration 0.1 --tolerance 1mm -o out.xml --json"
        yield from (f"tune {run} --budget 1s", f"reduce {run}")
    if model in VARIED:
        point, dimension, values = VARIED[model]
        yield f"sweep {model} --vary {dimension}={values}:4 --measure stroke:{point} -o out.csv --samples 12"
        yield f"sweep {model} --vary {dimension}={values} --sample sobol:4 --measure max:{point}.x -o out.nc"
        yield f"sensitivity {model} --of {point} --to {dimension} -o out.csv"
        tolerance = "0.01deg" if values.endswith("deg") else "1um"
        yield f"sensitivity {model} --of {point}.v --tolerances {dimension}={tolerance} --samples 100 --json"
        yield f"fit {model} --to measured.csv --vary {dimension} -o out.json --json"
        yield f"trace {model} -o out.csv --starts 9"
        yield f"validate {model} --against measured.csv --json"
        yield f"simulate {model} --profile crank.csv -o out.csv"
        yield f"tradeoff {model} --budget 9s --json"
    if model == "four_bar":
        yield f"validate {model} --against law.py:law --json"
        yield f"sweep {model} --design designs.csv --measure range:rocker -o out.csv"


def valid_cases() -> list[CommandCase]:
    """Return every command with every valid model."""
    rows = "".join(f"{0.01 * i},{0.03 * i}\n" for i in range(12))
    tables = {"crank.csv": f"time,angle\n{rows}".encode(), "law.py": FORMULA_TEXT.encode()}
    tables["designs.csv"] = b"crank,rocker\n0.03,0.07\n0.032,0.075\n"
    result: list[CommandCase] = []
    for model, model_files in subjects():
        own = dict(tables)
        if model in VARIED:
            own["measured.csv"] = measured(model)
        for line in command_lines(model):
            words = tuple(line.split())
            files = model_files | {
                name: content for name, content in own.items() if any(name in word for word in words)
            }
            breakable = tuple(name for name in files if name in line)
            compared = words[0] == "validate"
            result.append(CommandCase("valid", Case(words, files), breakable, True, must_agree=compared))
    return result


def measured(name: str) -> bytes:
    """Return a table of the motion of a catalogue mechanism."""
    point = VARIED[name][0]
    solver = catalog.make(name)
    angles = [6.0 * (0.1 + 0.04 * i) for i in range(20)]
    positions = solver.positions(angles)[point]
    head = f"angle,{point}.x,{point}.y,{point}.z"
    rows = [",".join(repr(float(v)) for v in (a, *p)) for a, p in zip(angles, positions, strict=True)]
    return "\n".join([head, *rows]).encode()
