"""What was left out of a scene, told in a comment of its file."""

from mechsim.studies.reduction.search import LeftOut, Reduction


def with_comment(found: Reduction, name: str, tolerance: float, unit: str) -> str:
    """Return the text of a scene with what was left out of it, and what each costs, above it.

    Args:
        found: what was left out.
        name: of the full scene's file.
        tolerance: that is kept.
        unit: of it.
    """
    first, second = (errors.by(found.by) for errors in found.errors)
    lines = [
        f"Reduced from {name}: {found.speedup:.3g} times as fast as it.",
        f"After each of its steps within {first:.2g} {unit} of it over the motion it was reduced for, "
        f"{second:.2g} {unit} over another; the tolerance is {tolerance:.3g} {unit}.",
        f"Over these motions efforts differ by up to {max(one.torque for one in found.errors):.2g} (N m, N), "
        f"changes of energy by up to {max(one.energy for one in found.errors):.2g} J.",
        "Left out, with the error that each alone costs and its time in parts of the full scene's:"
        if found.left_out
        else "Nothing was left out: no candidate kept the tolerance and saved time.",
    ]
    lines += [f"  {line(one, found.by, unit)}" for one in found.left_out]
    lines += [f"Brought back, for the whole was beyond the tolerance: {what}" for what in found.undone]
    # a comment must not hold two dashes in a row
    text = "\n".join(f"  {one}" for one in lines).replace("--", "- -")
    return f"<!--\n{text}\n-->\n{found.text}"


def line(one: LeftOut, by: str, unit: str) -> str:
    """Return one thing left out in words."""
    error, ratio = one.alone.by(by), one.time_ratio
    if not error < float("inf"):
        return f"{one.candidate.what}; alone it does not apply, together {one.error:.2g} {unit}"
    return f"{one.candidate.what}; {error:.2g} {unit}, {ratio:.3g}"
