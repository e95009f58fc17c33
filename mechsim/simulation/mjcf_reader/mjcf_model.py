"""An MJCF file as read: its mechanism, and the model that MuJoCo runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco

from mechsim.mechanism.finding import Finding
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array

if TYPE_CHECKING:
    from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput


@dataclass(frozen=True)
class MjcfModel:
    """An MJCF file as a mechanism and as a MuJoCo model.

    Attributes:
        path: path of the file, or the label of the object in messages.
        mechanism: links, joints, couplings, drivers and points; the guess is the initial state.
        spec: the specification of the file: all bodies, joints and equalities have names, all tracked points
            have sites, and the joints of fixed bodies are removed. Copy it before changing it.
        qpos: initial state, (nq,).
        gap: largest loop-closure error in the initial state, in [m].
        limits: joint -> range in [m] or [rad].
        actuators: actuator -> the joints on which it acts.
        remarks: sentences on omissions and changes.
        forces: gravity, and springs, dampers and Coulomb friction of hinges and slides.
        fixed: indices of the file's ball and free joints that were removed because they are locked.
        left_out: effects that MuJoCo simulates and the dynamics of this package omit.
        source: the file or object that was read.
        with_meshes: the model with meshes if `spec` has boxes in their place; otherwise None.
        unread: findings on what of the file was not read, and MuJoCo's warnings.
        nearest: the assembly nearest to an open start, or to one outside the joint limits, (nq,); None if it
            is unknown.
        keyframes: names of the keyframes of the file.
    """

    path: str
    mechanism: Mechanism
    spec: mujoco.MjSpec
    qpos: Array
    gap: float
    limits: Mapping[str, tuple[float, float]]
    actuators: Mapping[str, Sequence[str]]
    remarks: tuple[str, ...]
    forces: Forces = Forces()
    fixed: tuple[int, ...] = ()
    left_out: tuple[str, ...] = ()
    source: "MujocoInput" = ""
    with_meshes: mujoco.MjModel | None = None
    unread: tuple[Finding, ...] = ()
    nearest: Array | None = None
    keyframes: tuple[str, ...] = ()
