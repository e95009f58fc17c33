"""Random command lines: models, parameters and options of the commands, a third with invalid words."""

import tomllib
from pathlib import Path

from command_outcomes import Case
from hypothesis import strategies as st

from mechsim import catalog
from mechsim.cli import COMMANDS, load_command

FOLDER = Path(__file__).parent
# runs of each command, and valid values of each option
TABLE = tomllib.loads((FOLDER / "options_without_effect.toml").read_text(encoding="utf-8"))
FILES = {path.name: path.read_bytes() for path in (FOLDER / "mutated").iterdir()}
FILES["scene.xml"] = (FOLDER / "options_without_effect.xml").read_bytes()
# minutes a run, or no end
SLOW = {"certify", "extremes", "fit", "mcp", "reduce", "report", "tradeoff", "tune"}
RUNS = [
    f"{command} {run}"
    for command in COMMANDS
    if command not in SLOW
    for run in TABLE["runs"].get(command, TABLE["runs"]["others"])
]
invalid = st.one_of(
    st.sampled_from(["", "0", "-1", "nan", "1e300", "1e999", "0x10", "1,5", "٣", "--", ".", "n" * 304]),
    st.sampled_from(["no/out.csv", ".csv", "ä b.csv", "::", "0:1e9:1", "a:b:c", "3 parsecs", "m**9**9**9"]),
    st.floats().map(repr),
    st.text(max_size=6),
)


@st.composite
def scaled_parameters(draw: st.DrawFn, name: str) -> list[str]:
    """Return `--set` options that scale parameters by up to a half, or far more."""
    words: list[str] = []
    for parameter, kind in catalog.parameters(name).items():
        if not isinstance(kind.default, float) or draw(st.integers(0, 2)):
            continue
        extreme = st.sampled_from([1e-9, 1e-3, 30.0, 1e6, -1.0])
        factor = draw(st.one_of(st.floats(0.7, 1.4), st.floats(0.9, 1.1), extreme))
        words += ["--set", f"{parameter}={float(kind.default * factor)!r}"]
    return words


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Return a command line: a third of them with invalid words, the others of valid ones."""
    valid = draw(st.integers(0, 2)) > 0
    run = draw(st.sampled_from(RUNS))
    command = next(name for name in sorted(COMMANDS, key=len, reverse=True) if run.startswith(name))
    words = run.split()
    if "four_bar" in words:
        name = draw(st.sampled_from(list(catalog.MECHANISMS)))
        words = [name if word == "four_bar" else word for word in words] + draw(scaled_parameters(name))
    options = [item for item in load_command(command).params if item.param_type_name == "option"]
    for option in draw(st.lists(st.sampled_from(options), max_size=3, unique=True)):
        name = max(option.opts, key=len)
        values = TABLE["values"].get(name.lstrip("-"), [])
        if name in words or name in ("--help", "--output"):
            continue
        words.append(name)
        if not option.is_flag:
            words.append(draw(st.sampled_from(values) if valid and values else invalid))
    if not valid:
        words.insert(draw(st.integers(1, len(words))), draw(invalid))
    return Case(tuple(words), FILES)
