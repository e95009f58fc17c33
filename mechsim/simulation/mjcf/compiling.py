"""Specification to model, without the one shortcut of MuJoCo's compiler that depends on absolute lengths."""

import warnings

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.simulation.mjcf.silence import wordless

NONE, BODY, INERTIA = (
    int(frame)
    for frame in (
        mujoco.mjtSameFrame.mjSAMEFRAME_NONE,
        mujoco.mjtSameFrame.mjSAMEFRAME_BODY,
        mujoco.mjtSameFrame.mjSAMEFRAME_INERTIA,
    )
)


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the compiled model, its points where the specification puts them however small it is.

    The compiler takes a site or geom less than a micrometre from its body's origin, and a centre of mass
    as near, for being there: in a linkage of 5 um a joint is then off by a fifth of a link, without a
    word (docs/extremes.md). Where the two are not the same to the last bit, they are kept apart. What the
    compiler warns of, a run will meet and report.

    Raises:
        InputError: for a model that MuJoCo refuses, such as one with a massless body.
    """
    try:
        model = plainly_compiled(spec)
    except ValueError as error:
        raise InputError(f"MuJoCo refuses the model: {' '.join(str(error).split())}") from error
    for kind in ("site", "geom"):
        same_frame, positions = getattr(model, f"{kind}_sameframe"), getattr(model, f"{kind}_pos")
        centre = model.body_ipos[getattr(model, f"{kind}_bodyid")]
        distinct = (same_frame == BODY) & (positions != 0.0).any(1) | (same_frame == INERTIA) & (
            positions != centre
        ).any(1)
        same_frame[distinct] = NONE
    model.body_sameframe[(model.body_sameframe == BODY) & np.any(model.body_ipos != 0.0, axis=1)] = NONE
    return model


def plainly_compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model as MuJoCo compiles it, without what it and Qhull print on the way."""
    with warnings.catch_warnings(action="ignore"), wordless():
        return spec.compile()
