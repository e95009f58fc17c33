"""Tests as rows of tables: a call or a command on a model, and right values of its result.

The table `cases.toml` of a folder has a row for each test, named by a sentence. Keys of a row:

- `why`: the formula or source of the values, and what the test shows;
- `model`: a file of `tests/models/` or a name of the catalogue or gallery, with `fields` (values of its
  `${fields}`, or parameters), `changes` (pairs of an old and a new text), `more` (text at its end) and
  `load` (options of `ms.load`, or false for a call that takes the name or the file);
- `call`: a function of `mechsim`, which takes the loaded model, `arguments` and `options`, or `.NAME`, a
  method of the model; or `command`, words of a command in which MODEL stands for the file;
- `expected`: right values by the path to them, which `expected.py` describes;
- `error`: words of the message that rejects the call, in place of `expected`;
- `mujoco`: lists of changes; MuJoCo accepts the result, and rejects it for each changed model;
- `cases`: changes of the row that make a test each; `long` and `slow` mark tests that take time.
"""

import json
import shlex
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from expected import deviations, holds, require_keys
from model_files import changed_model

import mechsim as ms
from mechsim.kinematics.assur import assur_groups
from mechsim.kinematics.mobility_count import mobility
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_equilibrium, crosscheck_forward

Row = dict[str, Any]
KEYS = {"why", "model", "fields", "changes", "more", "load", "call", "arguments", "options", "command"}
KEYS |= {"expected", "error", "mujoco", "long", "slow"}


def prescribed(solver: Any, *arguments: Any, **options: Any) -> Any:
    """Return the forces of a prescribed motion."""
    return ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver), *arguments, **options)


# calls that take something else than a solver, or are in no public module
CALLS = {
    "driven": driven,
    "dynamics.prescribed": prescribed,
    "mobility": lambda solver: mobility(solver.mechanism),
    "assur_groups": lambda solver: assur_groups(solver.mechanism),
}


def merged(row: Row, changes: Row) -> Row:
    """Return a row with the values of another, tables key by key."""
    tables = {key for key in row.keys() & changes.keys() if isinstance(row[key], dict)}
    return row | changes | {key: merged(row[key], changes[key]) for key in tables}


def rows_of(table: Mapping[str, Row]) -> dict[str, Row]:
    """Return rows by name, those with `cases` as several."""
    result: dict[str, Row] = {}
    for name, row in table.items():
        alone = {key: value for key, value in row.items() if key != "cases"}
        cases = enumerate(row.get("cases", [{}]))
        result |= {f"{name}, {i}" if i else name: merged(alone, case) for i, case in cases}
    for name, row in result.items():
        require_keys(row, KEYS)
        assert row.keys() & {"expected", "error", "mujoco"}, name
    return result


def table_rows(test_file: str) -> pytest.MarkDecorator:
    """Return the parameter `row` of a test: the rows of the table in the folder of its file."""
    rows = rows_of(tomllib.loads(Path(test_file).with_name("cases.toml").read_text("utf-8")))
    parameters = [
        pytest.param(
            row, id=name, marks=[getattr(pytest.mark, key) for key in ("long", "slow") if key in row]
        )
        for name, row in rows.items()
    ]
    return pytest.mark.parametrize("row", parameters)


def file_of(row: Row, *changes: Sequence[str]) -> str:
    """Return the path of a row's model, with further changes of its text."""
    every = [*row.get("changes", ()), *changes]
    return changed_model(row["model"], *every, more=row.get("more", ""), **row.get("fields", {}))


def loaded(row: Row, *changes: Sequence[str]) -> Any:
    """Return the solver of a row's model, or its name or file, with further changes of its text."""
    plain = not {"fields", "changes", "more"} & row.keys() and not changes and "." not in row["model"]
    source, options = row["model"] if plain else file_of(row, *changes), row.get("load", {})
    return source if options is False else ms.load(source, **options)


def agree_with_mujoco(row: Row, result: Any) -> None:
    """Assert that MuJoCo accepts a result, and rejects it for each changed model."""
    for changes in ([], *row["mujoco"]):
        model = ms.dynamics.dynamic_model(loaded(row, *changes))
        if row["call"] == "dynamics.run":
            start = initial_values(model, row["options"].get("initial", {}))
            verdicts = [crosscheck_forward(result, model, start)]
        elif row["call"] == "dynamics.equilibria":
            verdicts = [crosscheck_equilibrium(each, model) for each in result]
        else:
            verdicts = [crosscheck_driven(result, model)]
        assert all(verdict.passed for verdict in verdicts) == (not changes), (changes, verdicts)


def result_of(row: Row) -> Any:
    """Return the result of a row's call."""
    solver, name = loaded(row), row["call"]
    if name.startswith("."):
        function, source = getattr(solver, name[1:]), []
    else:
        function, source = CALLS.get(name) or reduce(getattr, name.split("."), ms), [solver]
    return function(*source, *row.get("arguments", ()), **row.get("options", {}))


def run_row(row: Row, mechsim: Callable[..., Any]) -> None:
    """Run the call or the command of a row, and check its result."""
    if "command" in row:
        path = file_of(row)
        # as on the command line, where floating-point errors are no exceptions
        with np.errstate(all="ignore"):
            answer = mechsim(*(path if word == "MODEL" else word for word in shlex.split(row["command"])))
        output = {"json": json.loads(answer.out)} if "--json" in row["command"] else {"out": answer.out}
        assert deviations({"code": answer.code, "err": answer.err, **output}, row["expected"]) == []
    elif "error" in row:
        with pytest.raises(ms.MechsimError) as rejected:
            result_of(row)
        assert holds(str(rejected.value), {"has": row["error"]}), rejected.value
    else:
        result = result_of(row)
        assert deviations(result, row.get("expected", {})) == []
        if "mujoco" in row:
            agree_with_mujoco(row, result)
