"""Paths of a mechanism's assembly along its driver motion, by numerical continuation."""

import numpy as np

from mechsim.analytic.loops.constraints import TreeLoops
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.model.limits import require_travel
from mechsim.model.links import VIRTUAL_PREFIX
from mechsim.numerics.continuation import ContinuationPath


class LoopPath(ContinuationPath[TreeLoops, Coordinates]):
    """A path of one mechanism or of several designs, traced by the loop equations."""

    def require_travel(self, start: float, target: float) -> None:
        """Reject a path that is too long for one motion."""
        names = self.words
        who = f"{self.name}: {names.mover}"
        require_travel(who, names.position(start), names.position(target), abs(target - start))

    def remaining_text(self, current: float, target: float) -> str:
        """Return the remaining distance of prescribed points or links to their target; empty for joints."""
        mechanism = self.loops.tree.mechanism
        before, after = (self.prescribed(np.array([s]))[:, 0] for s in (current, target))
        poses = [joint.b.link.startswith(VIRTUAL_PREFIX) for joint in mechanism.driven_joints]
        slides = [mechanism.unit(name) == "m" for name in mechanism.drivers]
        change = [
            abs(b - a)
            for a, b, pose, slide in zip(before, after, poses, slides, strict=False)
            if pose and slide
        ]
        return f"; the target is {np.linalg.norm(change):.3g} m beyond" if change else ""
