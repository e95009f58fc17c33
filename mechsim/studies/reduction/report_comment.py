"""The report of a reduction as a comment in the reduced file."""

from mechsim.studies.reduction.search import LeftOut, Reduction


def with_comment(reduction: Reduction, name: str, tolerance: float, unit: str) -> str:
    """Return the MJCF of a reduced scene below a comment that lists what was removed and its cost.

    Args:
        reduction: the reduced scene.
        name: of the full scene's file.
        tolerance: that is satisfied.
        unit: of it.
    """
    first, second = (errors.by(reduction.by) for errors in reduction.errors)
    lines = [
        f"Reduced from {name}: {reduction.speedup:.3g} times as fast as it.",
        f"After each of its steps within {first:.2g} {unit} of it over the motion it was reduced for, "
        f"{second:.2g} {unit} over another; the tolerance is {tolerance:.3g} {unit}.",
        f"Over these motions forces differ by up to {max(errors.torque for errors in reduction.errors):.2g} "
        f"(N m, N), changes of energy by up to {max(errors.energy for errors in reduction.errors):.2g} J.",
        "Left out, with the error of each alone and its time relative to the full scene's:"
        if reduction.left_out
        else "Nothing was left out: no candidate kept the tolerance and saved time.",
    ]
    lines += [f"  {line(item, reduction.by, unit)}" for item in reduction.left_out]
    lines += [f"Taken back, since the result exceeded the tolerance: {what}" for what in reduction.undone]
    # a comment must not hold two dashes in a row
    text = "\n".join(f"  {item}" for item in lines).replace("--", "- -")
    return f"<!--\n{text}\n-->\n{reduction.text}"


def line(item: LeftOut, by: str, unit: str) -> str:
    """Return the line of an applied candidate."""
    error, ratio = item.alone_errors.by(by), item.time_ratio
    if not error < float("inf"):
        return f"{item.candidate.what}; alone it does not apply, together {item.error:.2g} {unit}"
    return f"{item.candidate.what}; {error:.2g} {unit}, {ratio:.3g}"
