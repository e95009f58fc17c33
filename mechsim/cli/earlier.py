"""What became better or worse since an earlier `mechsim validate --json`."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Any

from mechsim.cli.command import Result
from mechsim.cli.output import print_text
from mechsim.errors import InputError
from mechsim.files import plain, read_text
from mechsim.pictures.number_text import quantity_text

Key = tuple[str, str, str]
# change of an error that is reported, in tolerances of the check: a hundred such changes fail it
REPORTED = 0.01
# in the order in which changes are listed
CHANGES = ("worse", "better", "gone", "new")


def _checks(data: Mapping[str, Any]) -> dict[Key, dict[str, Any]]:
    """Return (mechanism, quantity, method) -> check."""
    return {
        (name, check["quantity"], check["method"]): check
        for name, case in data["mechanisms"].items()
        for check in case["checks"]
    }


def earlier_checks(path: str) -> dict[Key, dict[str, Any]]:
    """Return the checks in a file that `mechsim validate --json` printed.

    Raises:
        InputError: for a file that cannot be read or is no such output.
    """
    text = read_text(path, "an output of validate --json")
    try:
        checks = _checks(json.loads(text))
        if all(
            {"unit", "passed", "tolerance"} <= check.keys() and "worst" in check for check in checks.values()
        ):
            return checks
    except (ValueError, KeyError, TypeError, AttributeError):
        pass
    raise InputError(f"{path} is no output of `mechsim validate --json`; write one with it")


def changes_since(earlier: Mapping[Key, dict[str, Any]], data: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the checks that changed, worse ones first.

    Args:
        earlier: checks of an earlier run (see `earlier_checks`).
        data: JSON of this run.
    """
    now = _checks(plain(data))
    changes: list[dict[str, Any]] = []
    for key in dict.fromkeys([*now, *earlier]):
        was, check = earlier.get(key), now.get(key)
        if change := _change(was, check):
            mechanism, quantity, method = key
            row = {"mechanism": mechanism, "quantity": quantity, "method": method}
            row |= {"unit": (check or was or {})["unit"], "before": was and was["worst"]}
            changes.append(row | {"now": check and check["worst"], "change": change})
    return sorted(changes, key=lambda row: CHANGES.index(row["change"]))


def _change(was: dict[str, Any] | None, check: dict[str, Any] | None) -> Any:
    """Return what changed about a check; None if nothing of significance did."""
    if was is None or check is None:
        return "new" if was is None else "gone"
    if was["passed"] != check["passed"]:
        return "better" if check["passed"] else "worse"
    before, now = (inf if item["worst"] is None else float(item["worst"]) for item in (was, check))
    if before == now or abs(now - before) <= REPORTED * float(check["tolerance"]):
        return None
    return "better" if now < before else "worse"


def compared_with(path: str, earlier: Mapping[Key, dict[str, Any]], result: Result) -> Result:
    """Return a result of validate with what changed since an earlier one."""
    changes = changes_since(earlier, result.data)

    def text() -> None:
        result.text()
        count = Counter(row["change"] for row in changes)
        print_text(f"compared with {path}: " + ", ".join(f"{count[kind]} {kind}" for kind in CHANGES))
        for row in changes:
            before, now = (
                "-" if value is None else quantity_text(value, row["unit"])
                for value in (row["before"], row["now"])
            )
            name = f"{row['mechanism']}, {row['quantity']} ({row['method']})"
            print_text(f"  {row['change']}: {name}: {before} -> {now}")

    return replace(result, data={**result.data, "compared": changes}, text=text)
