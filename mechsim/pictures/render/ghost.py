"""Ghost: the links where the closed form puts them, with the error of a run magnified."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mechsim.model.links import Pose, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import power_of_ten
from mechsim.shapes import span

# how far the ghost may stand off, in units of the mechanism's size, and how far it may be turned in [rad]
FARTHEST, WIDEST = 0.06, 0.25


@dataclass(frozen=True, slots=True)
class Ghost:
    """Poses of a ghost.

    Attributes:
        poses: link -> poses, (n, ...); moving links only.
        by: factor on the error.
    """

    poses: Mapping[str, Pose]
    by: float

    @property
    def legend(self) -> str:
        """What a picture says about it."""
        exponent = int(np.floor(np.log10(self.by) + 1e-9))
        lead, power = self.by / 10.0**exponent, power_of_ten(exponent)
        return f"closed form dark, error × {power if round(lead, 6) == 1.0 else f'{self.by:.3g}'}"  # noqa: RUF001


def errors(
    mechanism: Mechanism, run: Mapping[str, Pose], exact: Mapping[str, Pose], spinning: frozenset[str]
) -> dict[str, tuple[Array, Array]]:
    """Return how far each moving link stands from where the closed form puts it.

    Args:
        mechanism: whose links.
        run: link -> poses drawn solid, (n, ...).
        exact: link -> poses at the same instants.
        spinning: links whose spin about the line of their joints means nothing; it is left out.

    Returns:
        Link -> displacement of its first joint, (n, 3) in [m], and turn as a vector, (n, 3) in [rad].
    """
    deviations: dict[str, tuple[Array, Array]] = {}
    for link in mechanism.links:
        run_pose, exact_pose = run[link.name], exact[link.name]
        anchor = mechanism.ends(link.name)[0].point
        if link.name in spinning:
            line = _line(mechanism, link.name)
            rotation = np.cross(run_pose.rotation @ line, exact_pose.rotation @ line)
        else:
            rotation = rotation_vectors(exact_pose.rotation @ np.swapaxes(run_pose.rotation, 1, 2))
        deviations[link.name] = exact_pose.point(anchor) - run_pose.point(anchor), rotation
    return deviations


def factor(mechanism: Mechanism, deviations: Mapping[str, tuple[Array, Array]]) -> float:
    """Return the power of ten that makes errors plain to see and leaves the ghost in the picture."""
    shift = max(float(np.abs(shift).max()) for shift, _ in deviations.values()) / (FARTHEST * span(mechanism))
    rotation = max(float(np.abs(rotation).max()) for _, rotation in deviations.values()) / WIDEST
    worst = max(shift, rotation)
    return 1.0 if not worst > 0.0 else float(10.0 ** np.floor(-np.log10(worst)))


def magnified(
    mechanism: Mechanism, run: Mapping[str, Pose], deviations: Mapping[str, tuple[Array, Array]], by: float
) -> dict[str, Pose]:
    """Return the poses of the ghost: those of the run, moved and turned by the errors times a factor.

    To first order in the error the ghost's joints hold together as the closed form's do.
    """
    from scipy.spatial.transform import Rotation

    poses: dict[str, Pose] = {}
    for link in mechanism.links:
        (shift, rotation_vector), pose = deviations[link.name], run[link.name]
        anchor: Vector = mechanism.ends(link.name)[0].point
        rotation = Rotation.from_rotvec(by * rotation_vector).as_matrix() @ pose.rotation
        poses[link.name] = Pose(pose.point(anchor) + by * shift - rotation @ np.asarray(anchor), rotation)
    return poses


def _line(mechanism: Mechanism, link: str) -> Array:
    """The unit vector between the first two joints of a link that stand apart."""
    first, *others = (np.asarray(end.point) for end in mechanism.ends(link))
    line = max((other - first for other in others), key=lambda along: float(np.linalg.norm(along)))
    return line / np.linalg.norm(line)


def rotation_vectors(rotation: Array) -> Array:
    """The vector of rotations, (n, 3, 3) -> (n, 3), to full relative accuracy for small ones."""
    twice = rotation[:, [2, 0, 1], [1, 2, 0]] - rotation[:, [1, 2, 0], [2, 0, 1]]  # 2 sin(angle) x axis
    sine = 0.5 * np.sqrt((twice**2).sum(1))
    angle = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1.0))
    return 0.5 * twice * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)[:, None]
