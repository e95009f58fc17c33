"""Findings in the MJCF file of a mechanism."""

from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.finding import Finding
from mechsim.mechanism.motion_laws import MotionLaws


def scene_findings(solver: KinematicSolver, laws: MotionLaws | None = None) -> tuple[Finding, ...] | None:
    """Return the findings in an MJCF file, the most severe first; None for any other mechanism.

    Args:
        solver: the mechanism.
        laws: motion laws of the drivers; the default is those of the mechanism.
    """
    if solver.source is None:
        return None
    # MuJoCo is loaded for MJCF files only
    from mechsim.simulation.findings import findings
    from mechsim.simulation.mjcf.compiling import quiet

    with quiet():
        return findings(solver.source, laws or solver.motion_laws)
