"""Invalid calls in Python: an error of the stated kind, in one line that says what is wrong."""

import tomllib
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path

import mujoco
import numpy as np
import pytest
from model_files import FOLDER, model_text

import mechsim as ms

REJECTED = FOLDER.parent / "rejected"
TABLES = tomllib.loads((REJECTED / "calls.toml").read_text(encoding="utf-8"))
# values of the fields of files of tests/models
VALUES = tomllib.loads((REJECTED / "models.toml").read_text(encoding="utf-8"))["values"]
TEXTS = tomllib.loads((REJECTED / "texts.toml").read_text(encoding="utf-8"))
CASES = [
    (names, kind, row) for names, kinds in TABLES.items() for kind, rows in kinds.items() for row in rows
]
# the key of a table of texts is the call
CASES += [
    (names, "InputError", [call.replace("TEXT", repr(text)), *words])
    for names, calls in TEXTS.items()
    for call, rows in calls.items()
    for text, *words in rows
]


def file(name, content):
    """Write a file into the folder of the test; return its name."""
    Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return name


def model(name, *changes, csv="", **values):
    """Write a file of tests/models with replaced texts, and a table that it names; return its name."""
    text = model_text(name, **VALUES.get(name, {}) | values)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file("table.csv", csv)
    return file(name, text)


@cache
def common_names():
    """Return the names that calls contain: public ones, and some models."""
    pivot = ms.Joint("crank", "revolute", ms.End("ground"), ms.End("bob"))
    four_bar = ms.catalog.make("four_bar").mechanism
    points = ms.catalog.make("four_bar").positions(np.linspace(0.0, 6.0, 13))["C"]
    nothing = ms.Inertia(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    weight = ms.Forces(gravity=(0.0, -9.81, 0.0))
    return {
        "ms": ms,
        "np": np,
        "nan": np.nan,
        "inf": np.inf,
        "mujoco": mujoco,
        "Path": Path,
        "replace": replace,
        "file": file,
        "model": model,
        # aliases of aliases in YAML: nine lists of nine, eleven deep
        "bomb": "a0: &a0 [x]\n"
        + "".join(f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)),
        "loops": tomllib.loads(model_text("urdf_loops_dialects.toml")),
        # points of the coupler of a four-bar
        "measured": {"angle": np.linspace(0.0, 6.0, 13), "C.x": points[:, 0], "C.y": points[:, 1]},
        "rssr": ms.catalog.make("rssr"),
        "four_bar": four_bar,
        # without any mass
        "massless": replace(four_bar, links=tuple(replace(link, inertia=nothing) for link in four_bar.links)),
        # a pendulum without extent
        "dot": ms.Mechanism("dot", (ms.Link("bob"),), (pivot,), "crank", {"P": ("bob", (0.0, 0.0, 0.0))}),
        "push": ms.load_profile.constant((1.0, 0.0, 0.0)),
        "weight": weight,
        "heavy": ms.dynamics.dynamic_model("four_bar", weight),
        # its motion law has a period of 1 s
        "swung": ms.load("four_bar", drive={"crank": "0.3*sin(2*pi*t)"}, duration=1.0),
    }


@pytest.mark.parametrize(("names", "kind", "row"), CASES)
def test_an_invalid_call_is_rejected_in_one_line(names, kind, row, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, *words = row
    tables = [vars(import_module(name)) for name in names.split(", ")]
    with pytest.raises(getattr(ms.errors, kind)) as rejected:
        eval(call, {name: value for table in (*tables, common_names()) for name, value in table.items()})
    message = str(rejected.value)
    assert "\n" not in message
    assert len(message) < 1000
    assert [word for word in words if word not in message] == []
