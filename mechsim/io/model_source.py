"""Sources of models: a row of READERS for each file format and each type of object."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

from mechsim.errors import InputError

if TYPE_CHECKING:
    from mechsim.io.toml_coordinates import FileMotionLaw
    from mechsim.kinematics.designs import Dimension
    from mechsim.kinematics.solvers import KinematicSolver
    from mechsim.mechanism.links import Vector
    from mechsim.mechanism.motion_laws import State

    LockedAt = str | float | Vector | None


@dataclass(frozen=True)
class ModelDescription:
    """A mechanism as its source describes it.

    Attributes:
        solver: its solver, without the motion laws in `motion_laws`.
        motion_laws: driver -> motion law in the source.
        duration: duration of these motion laws in [s]; None if the source has none.
        prescribed: whether locks, fixed bases, keyframes and tracked points are applied already.
    """

    solver: "KinematicSolver"
    motion_laws: Mapping[str, "FileMotionLaw"] = field(default_factory=dict[str, "FileMotionLaw"])
    duration: float | None = None
    prescribed: bool = False


@dataclass(frozen=True)
class Parameters:
    """The parameters of a model.

    Attributes:
        dimensions: parameter -> its value and unit.
        derived: parameter -> parameters in its expression.
        intended_use: question that the model answers; empty if the source states none.
    """

    dimensions: Mapping[str, "Dimension"] = field(default_factory=dict[str, "Dimension"])
    derived: Mapping[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    intended_use: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prescription:
    """Requests of the user in addition to the model's own description.

    Attributes:
        drive: coordinate -> its motion law, as text (see `parse_motion_law`) or a function of time.
        lock: joint or coordinate -> its constant value, as text or in SI; None is the initial value, and a
            vector the axis of one rotation of a spherical joint, as in `spin_rod`.
        start: joint -> value as text or in SI; the nearest assembly is the initial one.
        fix_base: whether floating bases are fixed at their initial pose.
        lock_others: whether coordinates that the drivers do not determine are locked at their initial values.
        key: name of the keyframe to start from.
        track: points to record, as `NAME` or `NAME,LINK@x,y,z`; empty for all points of the model.
        duration: duration of the motion laws in [s].
        still: whether drivers may be missing; if `drive` has laws of some drivers, the others are free.
        loops: path of a sidecar file with the loop closures of a URDF file.
    """

    drive: Mapping[str, "str | State"] = field(default_factory=dict[str, "str | State"])
    lock: Mapping[str, "LockedAt"] = field(default_factory=dict[str, "LockedAt"])
    start: Mapping[str, str | float] = field(default_factory=dict[str, "str | float"])
    fix_base: bool = False
    lock_others: bool = False
    key: str | None = None
    track: tuple[str, ...] = ()
    duration: float | None = None
    still: bool = False
    loops: str | None = None


class ModelSource(ABC):
    """An opened model. Its file is read once and described for each set of parameters."""

    @abstractmethod
    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism.

        Args:
            changed: parameter -> its value as text or in SI.
            prescription: drivers, locks, keyframe and points that the user requests. A source that applies
                them all, except motion laws, sets `prescribed`; `load` applies them for other sources.

        Raises:
            InputError: for a model that cannot be read, in one sentence.
        """

    def parameters(self, changed: Mapping[str, str | float]) -> Parameters:
        """Return the parameters; a source without parameters has the joint positions as dimensions."""
        return Parameters()


@dataclass(frozen=True)
class PlainFile(ModelSource):
    """A file without parameters, motion laws and a prescription of its own.

    Attributes:
        path: its path.
        read: path -> its mechanism.
    """

    path: str
    read: Callable[[str], "KinematicSolver"]

    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism; an error names the file."""
        if changed:
            raise InputError(f"{self.path} has no parameters; leave out --set, or export it to TOML")
        try:
            return ModelDescription(self.read(self.path))
        except InputError as error:
            raise error if self.path in str(error) else InputError(f"{self.path}: {error}") from None


@dataclass(frozen=True, slots=True)
class Reader:
    """A reader of one kind of model.

    Attributes:
        opens: returns a `ModelSource` for a path or an object; a function, or "module:function", which is
            imported when the first model of this kind is opened. Of plain files it returns the mechanism.
        plain: whether the files have no parameters, motion laws and prescriptions.
        suffixes: suffixes of its files in lower case, such as ".toml"; "FILE.py:OBJECT" counts as ".py".
        types: types of its objects, as package and class, such as "mujoco.MjSpec".
    """

    opens: str | Callable[[Any], ModelSource]
    suffixes: tuple[str, ...] = ()
    types: tuple[str, ...] = ()
    plain: bool = False

    def open(self, model: Any) -> ModelSource:
        """Return the source of a model."""
        if callable(self.opens):
            return self.opens(model)
        module, _, name = self.opens.partition(":")
        opens = getattr(import_module(module), name)
        return PlainFile(model, opens) if self.plain else opens(model)


READERS: list[Reader] = [
    Reader("mechsim.io.formula_file:open_toml", suffixes=(".toml",)),
    Reader(
        "mechsim.io.mjcf_source:MujocoSource",
        suffixes=(".xml", ".urdf"),
        types=("mujoco.MjSpec", "mujoco.MjModel", "mechsim.UrdfFile"),
    ),
    Reader("mechsim.io.formula_file:open_python", suffixes=(".py",)),
    Reader("mechsim.io.sdf:read_sdf", suffixes=(".sdf",), plain=True),
    Reader("mechsim.io.usd_reader:read_usd", suffixes=(".usda", ".usdc", ".usdz", ".usd"), plain=True),
    Reader("mechsim.io.planar_json:read_json", suffixes=(".json", ".pmks"), plain=True),
    Reader("mechsim.io.python_object:GivenObject", types=("mechsim.Mechanism", "mechsim.KinematicSolver")),
]


def file_reader(path: str) -> Reader | None:
    """Return the reader for the suffix of a path, or None; it does not look for the file."""
    for reader in READERS:
        if any(path.lower().endswith(suffix) or f"{suffix}:" in path for suffix in reader.suffixes):
            return reader
    return None


def object_reader(model: object) -> Reader | None:
    """Return the reader for the type of an object, or None."""
    types = {f"{base.__module__.partition('.')[0]}.{base.__name__}" for base in type(model).__mro__}
    return next((reader for reader in READERS if types.intersection(reader.types)), None)
