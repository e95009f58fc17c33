"""Masses, centres of mass, moments of inertia, friction and motor constants from a log of torques.

The torque of a prescribed motion is linear in the mass of each link, its first moments and its moments of
inertia about the link's origin, and in the coefficients of friction (C. Atkeson, C. An and J. Hollerbach,
Estimation of inertial parameters of manipulator loads and links, International Journal of Robotics Research
5(3), 1986, 101-119). Combinations of them that the log determines follow from the rank of the derivatives
(M. Gautier and W. Khalil, Direct calculation of minimum set of inertial parameters of serial robots, IEEE
Transactions on Robotics and Automation 6(3), 1990, 368-373).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.io.catalog import nearest
from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics.applied_forces import add_friction
from mechsim.kinetics.model import DynamicModel, dynamic_model
from mechsim.kinetics.prescribed_motion import BATCH_SIZE, prescribed_along
from mechsim.kinetics.reactions import linear_drives
from mechsim.kinetics.reduced_equation import require_constant_friction
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.forces import Friction, forces_of
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.masses import with_inertia
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import JointMotion, Motion, select_instants, short_repr
from mechsim.mechanism.motion_laws import State
from mechsim.mechanism.motors import DCMotor, Geared
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.rank import RANK_TOLERANCE
from mechsim.studies.measured_table import TableColumn, table_columns

# fraction of the rows, the last ones, that are predicted instead of fitted
PREDICTED_FRACTION = 0.25
# error of the held-out rows relative to that of the fitted ones above which the model does not predict them
MAX_RATIO = 2.0
# error relative to the largest measured value below which it is rounding; relative change at convergence
ROUNDED, CONVERGED = 1e-9, 1e-12
# smallest number of rows, and fraction of the rows at each end without usable derivatives of positions
MIN_ROWS, END_FRACTION = 10, 0.05
# smallest coefficient of a parameter in a combination, relative to the parameters' scales
MIN_SHARE = 1e-4
# measured of a step in the imaginary direction, which gives exact derivatives
STEP = 1e-30
# the elements of a symmetric matrix, and the parameters of a link with their units
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
ELEMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
LINK_NAMES = ("mass", "com.x", "com.y", "com.z", *(f"inertia.{element}" for element in ELEMENTS))
LINK_UNITS = ("kg", "m", "m", "m", *("kg m2",) * 6)
FRICTION = re.compile(r"\.(viscous|coulomb)(_turn)?$")
NOT_NEGATIVE = re.compile(r"\.(mass|inertia\.(xx|yy|zz)|(viscous|coulomb)(_turn)?|constant)$")


@dataclass(frozen=True)
class Combination:
    """A sum of parameters that a log determines, although not each of them.

    Attributes:
        factors: parameter -> its factor.
        value: of the sum, in units of its first parameter.
        deviation: its standard deviation.
    """

    JSON: ClassVar[tuple[str, ...]] = ("text", "factors", "value", "deviation")

    factors: Mapping[str, float]
    value: float
    deviation: float

    @property
    def text(self) -> str:
        """The sum as an expression."""
        return " + ".join(
            name if factor == 1.0 else f"{factor:.6g} {name}" for name, factor in self.factors.items()
        ).replace("+ -", "- ")


@dataclass(frozen=True)
class Identification:
    """Parameters of a dynamic model that fit a log of torques or currents best.

    Attributes:
        model: the dynamic model at its initial parameters.
        outcome: "underdetermined" if the log does not determine all parameters; "not predicted" if the error
            in the held-out rows is much larger than in the fitted ones.
        start: parameter -> initial value, in SI.
        values: parameter -> identified value; one of many of undetermined parameters.
        units: parameter -> its unit.
        deviations: determined parameter -> standard deviation.
        covariance: of the parameters in their order, (p, p), for determined directions.
        combinations: base parameters: sums of undetermined parameters that the log determines; of links whose
            centre is identified, sums of first moments `mass*com.x` and of moments about the link's origin.
        without_effect: parameters on which no torque depends.
        rms: column -> root mean square error of the fitted rows, in SI.
        prediction_error: column -> the same of the held-out rows.
        rows: numbers of fitted and of held-out rows.
        unused: columns of the log without a use.
    """

    JSON: ClassVar[tuple[str, ...]] = (
        *("mechanism", "outcome", "values", "deviations", "within_95", "start", "units", "covariance"),
        *("combinations", "without_effect", "impossible", "rms", "prediction_error", "rows", "unused"),
    )

    model: DynamicModel
    outcome: Literal["fitted", "underdetermined", "not predicted"]
    start: Mapping[str, float]
    values: Mapping[str, float]
    units: Mapping[str, str]
    deviations: Mapping[str, float]
    covariance: Sequence[Sequence[float]]
    combinations: Sequence[Combination]
    without_effect: Sequence[str]
    rms: Mapping[str, float]
    prediction_error: Mapping[str, float]
    rows: tuple[int, int]
    unused: Sequence[str]

    __repr__ = short_repr

    @property
    def mechanism(self) -> str:
        """Name of the mechanism."""
        return self.model.mechanism.name

    @property
    def within_95(self) -> dict[str, float]:
        """Half the width of the 95 % interval of each determined parameter, by Student's t."""
        from scipy.stats import t

        factor = float(t.ppf(0.975, self.rows[0] * len(self.rms) - len(self.values)))
        return {name: factor * deviation for name, deviation in self.deviations.items()}

    @property
    def impossible(self) -> list[str]:
        """Determined parameters that are below zero by more than two deviations, which nothing can have."""
        return [
            name
            for name, deviation in self.deviations.items()
            if NOT_NEGATIVE.search(name) and self.values[name] < -2.0 * deviation
        ]


def identify(
    model: Any,
    table: Mapping[str, Array],
    vary: Sequence[str],
    *,
    where: str = "the log",
    **options: Any,
) -> Identification:
    """Return parameters of the dynamic model for which a mechanism needs the measured torques.

    The positions count as exact. The last quarter of the rows is predicted with the result.

    Args:
        model: as for `load`; its masses and friction are those of parameters that are not identified.
        table: columns t [s], J.q, torque:J (or force:J) or current:J [A] of each driver J; J.v and J.a if
            both are known, else a smoothing spline replaces the positions. Those of a single driver may be
            called angle, speed, acceleration, torque, current. A column torque:J± has standard deviations.
        vary: parameters LINK.mass, LINK.com.x, LINK.inertia.zz (about the centre of mass), JOINT.viscous,
            JOINT.coulomb, motor.constant (DRIVER.motor.constant of several); LINK.com, LINK.inertia stand
            for all their components.
        where: name of the log in messages.
        options: further arguments of `load`.

    Raises:
        InputError: for an invalid log, an unknown parameter, or friction that depends on the load.
        AssemblyError: if the mechanism cannot follow the log.
    """
    still = load(model, **options, still=True)
    log = _log_of(table_columns(table, where), still.mechanism, where)
    moving = load(model, **options, drive=log.laws, duration=float(log.time[-1]))
    dynamics = dynamic_model(moving, forces_of(moving).under_drivers(moving.mechanism.drivers))
    require_constant_friction(dynamics, "an identification")
    nominal = _parameters(still, log)
    names = _chosen(vary, nominal)
    for _, constant in log.measured.values():
        if constant and not nominal[constant][0] and constant not in names:
            raise InputError(
                f"{where} has currents, but the motor constant is unknown; add {constant} to the parameters, "
                "or give torques"
            )
    return _TorqueFit(dynamics, log, names, nominal).result(vary)


@dataclass(frozen=True)
class _Log:
    """A log: times (n,), the motion of each driver with a law through it, and c measured columns, (c, n).

    `measured` gives the driver of a column, and the name of the motor constant of a current. Unknown
    deviations are NaN.
    """

    time: Array
    motion: Mapping[str, JointMotion]
    laws: Mapping[str, State]
    measured: Mapping[str, tuple[str, str]]
    columns: Array
    deviations: Array
    smoothed: bool
    unused: tuple[str, ...]


def _law(time: Array, value: Array, rate: Array | None = None) -> State:
    """Return a law through values and rates; without rates a smoothing spline, by cross-validation."""
    from scipy.interpolate import CubicHermiteSpline, make_smoothing_spline

    spline: Any = (
        make_smoothing_spline(time, value) if rate is None else CubicHermiteSpline(time, value, rate)
    )
    first, second = spline.derivative(), spline.derivative(2)
    return lambda t: (spline(t), first(t), second(t))


def _log_of(columns: dict[str, TableColumn], mechanism: Mechanism, where: str) -> _Log:
    """Return the log in the columns of a table."""
    joints = [name for joint in mechanism.joints if KINDS[joint.kind].drivable for name in joint.coordinates]
    aliases = {f"force:{name}": f"torque:{name}" for name in joints}
    aliases |= {f"drive {name}": f"torque:{name}" for name in joints} | {name: f"{name}.q" for name in joints}
    if len(mechanism.drivers) == 1:
        name = mechanism.drivers[0]
        aliases |= {"angle": f"{name}.q", "speed": f"{name}.v", "acceleration": f"{name}.a"}
        aliases |= {"torque": f"torque:{name}", "current": f"current:{name}"}
    columns = {aliases.get(name, name): column for name, column in columns.items()}
    driven = {name for name in joints if {f"torque:{name}", f"current:{name}"} & {*columns}}
    measured: dict[str, tuple[str, str]] = {}
    for name in sorted(driven, key=joints.index):
        constant = "motor.constant" if len(driven) == 1 else f"{name}.motor.constant"
        both = {f"torque:{name}": (name, ""), f"current:{name}": (name, constant)}
        measured |= {column: meaning for column, meaning in both.items() if column in columns}
    missing = [name for name in ("t", *(f"{joint}.q" for joint in driven)) if name not in columns]
    if not measured:
        missing = [f"torque:J or current:J with J of {', '.join(joints)}"]
    if missing:
        raise InputError(f"{where} has no column {', '.join(missing)}; it has {', '.join(columns)}")
    time = columns.pop("t").values
    if len(time) < MIN_ROWS or not (np.diff(time) > 0.0).all():
        raise InputError(
            f"{where}: times in column t must increase over {MIN_ROWS} rows or more; sort or add rows"
        )
    time = time - time[0]
    motion: dict[str, JointMotion] = {}
    smoothed = not all(f"{name}.{letter}" in columns for name in driven for letter in "va")
    for name in driven:
        states = [columns.pop(f"{name}.{letter}").values for letter in ("q" if smoothed else "qva")]
        unit: Any = mechanism.unit(name)
        motion[name] = JointMotion(*(_law(time, *states)(time) if smoothed else states), unit=unit)
    laws = {name: _law(time, joint.value, joint.rate) for name, joint in motion.items()}
    recorded = [columns.pop(name) for name in measured]
    stated = [column.uncertainty for column in recorded]
    return _Log(
        time,
        motion,
        laws,
        measured,
        np.array([column.values for column in recorded]),
        np.array([np.full(len(time), np.nan) if own is None else own for own in stated]),
        smoothed,
        tuple(columns),
    )


def _parameters(solver: KinematicSolver, log: _Log) -> dict[str, tuple[float, str]]:
    """Return all parameters with their initial values and units."""
    mechanism, forces = with_inertia(solver.mechanism), forces_of(solver)
    rows: dict[str, tuple[float, str]] = {}
    for link in mechanism.links:
        if link.inertia is not None and link.is_body:
            inertia = link.inertia
            numbers = (inertia.mass, *inertia.centre, *(inertia.moments[i][j] for i, j in PAIRS))
            for name, value, unit in zip(LINK_NAMES, numbers, LINK_UNITS, strict=True):
                rows[f"{link.name}.{name}"] = value, unit
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        units = {"": ("N", "N s/m") if kind.slides else ("N m", "N m s/rad")}
        units |= {"_turn": ("N m", "N m s/rad")} if kind.mixed else {}
        for suffix, (effort, per_rate) in units.items() if kind.dof not in (0, 6) else ():
            for name, unit in ((f"viscous{suffix}", per_rate), (f"coulomb{suffix}", effort)):
                own = [friction for friction in forces.friction if friction.joint == joint.name]
                rows[f"{joint.name}.{name}"] = sum(getattr(friction, name) for friction in own), unit
    ratio, motor = 1.0, forces.motor
    if isinstance(motor, Geared):
        ratio, motor = motor.ratio, motor.motor
    for driver, name in log.measured.values():
        if name:
            unit = "N/A" if mechanism.unit(driver) == "m" else "N m/A"
            rows[name] = ratio * motor.constant if isinstance(motor, DCMotor) else 0.0, unit
    return rows


def _chosen(vary: Sequence[str], nominal: Mapping[str, object]) -> list[str]:
    """Return the parameters of names, each once; LINK.com stands for its components."""
    chosen: dict[str, None] = {}
    for name in vary:
        matching = [own for own in nominal if own == name or own.startswith(f"{name}.")]
        if not matching:
            raise InputError(f"there is no parameter {name!r}{nearest(name, [*nominal])}")
        chosen |= dict.fromkeys(matching)
    return [*chosen]


class _TorqueFit:
    """The functions that least squares needs; c measured columns have n rows, and p parameters vary."""

    def __init__(
        self, model: DynamicModel, log: _Log, names: list[str], nominal: Mapping[str, tuple[float, str]]
    ):
        self.log, self.names = log, names
        self.units = {name: nominal[name][1] for name in names}
        self.all = {name: value for name, (value, _) in nominal.items()}
        self.links = [
            link.name
            for link in model.mechanism.links
            if any(f"{link.name}.{own}" in names for own in LINK_NAMES)
        ]
        # parameters of links whose centre of mass is unknown -> their places among the linear parameters
        self.moved = {
            f"{link}.{name}": 10 * i + k
            for i, link in enumerate(self.links)
            if any(f"{link}.com.{x}" in names for x in "xyz")
            for k, name in enumerate(LINK_NAMES)
        }
        self.frictions = [name for name in names if FRICTION.search(name)]
        laws = model.solver.motion_laws
        parameter, rate = laws.parameter(log.time), np.full(len(log.time), laws.rate)
        motion = Motion(
            "pose", parameter, rate, 0.0 * rate, {}, joints=log.motion, time=log.time, drivers=laws.drivers
        )
        self.model = model.starting_at(parameter, laws.rate)
        drives = prescribed_along(self.model, parameter, rate, time=log.time, as_run=motion).forces.drives
        self.base = np.array([drives[name] for name in laws.drivers])
        rows = [slice(first, first + BATCH_SIZE) for first in range(0, len(rate), BATCH_SIZE)]
        self.by = np.concatenate([self._by_parameter(select_instants(motion, chunk)) for chunk in rows])
        self.columns = [(laws.drivers.index(driver), constant) for driver, constant in log.measured.values()]
        for (driver, constant), values in zip(self.columns, log.columns, strict=True):
            if constant and not self.all[constant]:
                self.all[constant] = abs(float(values @ self.base[driver] / (values @ values or 1.0))) or 1.0
        self.start = np.array([self.all[name] for name in names])
        self.mass = max(link.inertia.mass for link in model.mechanism.links if link.inertia) or 1.0
        length, effort = model.mechanism.characteristic_length, float(np.abs(self.base).max()) or 1.0
        fastest = max(float(np.abs(driver.rate).max()) for driver in log.motion.values()) or 1.0
        sizes = {"kg": self.mass, "m": length, "kg m2": self.mass * length**2, "N": effort, "N m": effort}
        self.scale = np.array([sizes.get(self.units[name], effort / fastest) for name in names])
        motors = np.array(["motor" in name for name in names])
        self.scale[motors] = self.start[motors]

    def _by_parameter(self, motion: Motion) -> Array:
        """Return the drivers' torques and forces per unit of each linear parameter, (n, drivers, k)."""
        unit, rate = self.model.unit_motion(motion.angle, motion), motion.speed[0]
        gravity, first = np.array(self.model.forces.gravity), 10 * len(self.links)
        needed = np.zeros((*unit.twist.shape, first + len(self.frictions)))
        for i, link in enumerate(self.links):
            slot: Any = unit.slot(link)
            needed[:, slot, :, 10 * i : 10 * i + 10] = inertial_columns(unit, slot, rate, gravity)
        for i, name in enumerate(self.frictions, first):
            joint, _, kind = name.rpartition(".")
            damping, coulomb = np.zeros_like(unit.twist), np.zeros_like(unit.twist)
            coefficient: Any = {kind: 1.0}
            add_friction(unit, damping, coulomb, Friction(joint, **coefficient))
            needed[..., i] = -rate * damping - coulomb
        return linear_drives(unit, needed)

    def _linear(self, values: Mapping[str, Any]) -> Any:
        """Return the linear parameters: of each link mass, first moments and moments about its origin."""
        linear: list[Any] = []
        for link in self.links:
            own = np.array([values[f"{link}.{name}"] for name in LINK_NAMES])
            mass, centre = own[0], own[1:4]
            products = np.array([centre[i] * centre[j] for i, j in PAIRS])
            spread = np.array([1.0] * 3 + [0.0] * 3) * (centre @ centre) - products
            linear += [mass, *(mass * centre), *(own[4:] + mass * spread)]
        return np.array([*linear, *(values[name] for name in self.frictions)])

    def _errors(self, numbers: Any) -> Any:
        """Return predicted less measured columns at parameters (p,), which may have complex steps, (c, n)."""
        values = {**self.all, **dict(zip(self.names, numbers, strict=True))}
        forces = self.base + (self.by @ (self._linear(values) - self._linear(self.all))).T
        constants = [values[name] if name else 1.0 for _, name in self.columns]
        return forces[[i for i, _ in self.columns]] / np.array(constants)[:, None] - self.log.columns

    def _fitted(self, x: Array, rows: slice, weights: Array) -> tuple[Array, Array]:
        """Return the scaled parameters with the least sum of squares, and derivatives there, (m, p)."""
        from scipy.optimize import least_squares

        def residuals(x: Any) -> Any:
            return (self._errors(self.start + self.scale * x) / weights)[:, rows].ravel()

        def derivatives(x: Array) -> Any:
            steps = 1j * STEP * np.eye(len(x))
            return np.array([residuals(x + step).imag for step in steps]).T / STEP

        tolerances = dict.fromkeys(("xtol", "ftol", "gtol"), CONVERGED)
        exact: Any = derivatives
        solution: Any = least_squares(residuals, x, exact, **tolerances)
        return solution.x, derivatives(solution.x)

    def result(self, explicit: Sequence[str]) -> Identification:
        """Return the identified parameters; unknown deviations are the errors of a first fit."""
        count, parameters = len(self.log.time), len(self.names)
        end = int(END_FRACTION * count) if self.log.smoothed else 0
        split = end + int((1.0 - PREDICTED_FRACTION) * (count - 2 * end))
        rows, rest = slice(end, split), slice(split, count - end)
        measured = (split - end) * len(self.columns)
        if measured <= parameters:
            raise InputError(
                f"{measured} measured values do not determine {parameters} parameters; measure more"
            )

        def rms(numbers: Array, rows: slice) -> Array:
            return np.sqrt((self._errors(numbers)[:, rows] ** 2).mean(1))

        peaks = np.maximum(np.abs(self.log.columns).max(1), np.finfo(np.float64).tiny)

        def weights(unknown: Array) -> Array:
            stated = self.log.deviations
            return np.where(np.isnan(stated), unknown[:, None], stated)

        x, _ = self._fitted(np.zeros(parameters), rows, weights(peaks))
        spread = np.sqrt(measured / (measured - parameters)) * rms(self.start + self.scale * x, rows)
        x, matrix = self._fitted(x, rows, weights(np.maximum(spread, ROUNDED * peaks)))
        idle = np.abs(matrix).max(0) <= RANK_TOLERANCE * np.abs(matrix).max()
        numbers = np.where(idle, self.start, self.start + self.scale * x)
        _, singular, right = np.linalg.svd(matrix, full_matrices=False)
        determined = singular > RANK_TOLERANCE * singular[0]
        covariance = (right[determined].T / singular[determined] ** 2) @ right[determined]
        loose = np.sqrt((right[determined] ** 2).sum(0)) < 1.0 - MIN_SHARE**2
        combinations = self._combinations(matrix, numbers, covariance, loose & ~idle)
        without_effect = [name for name, none in zip(self.names, idle, strict=True) if none]
        fitted, prediction_error = rms(numbers, rows), rms(numbers, rest)
        unpredicted = (prediction_error > np.maximum(MAX_RATIO * fitted, ROUNDED * peaks)).any()
        undetermined = combinations or {*without_effect} & {*explicit}
        deviations = self.scale * np.sqrt(np.diag(covariance))
        columns = [*self.log.measured]
        return Identification(
            model=self.model,
            outcome="underdetermined" if undetermined else "not predicted" if unpredicted else "fitted",
            start=dict(zip(self.names, self.start.tolist(), strict=True)),
            values=dict(zip(self.names, numbers.tolist(), strict=True)),
            units=self.units,
            deviations={name: float(deviations[i]) for i, name in enumerate(self.names) if not loose[i]},
            covariance=(covariance * np.outer(self.scale, self.scale)).tolist(),
            combinations=combinations,
            without_effect=without_effect,
            rms=dict(zip(columns, fitted.tolist(), strict=True)),
            prediction_error=dict(zip(columns, prediction_error.tolist(), strict=True)),
            rows=(split - end, count - end - split),
            unused=self.log.unused,
        )

    def _base(self, numbers: Any) -> Any:
        """Return the parameters; of links with an unknown centre the first moments, and about the origin."""
        values = dict(zip(self.names, numbers, strict=True))
        linear = self._linear({**self.all, **values})
        return np.array([linear[self.moved[name]] if name in self.moved else values[name] for name in values])

    def _combinations(
        self, matrix: Array, numbers: Array, covariance: Array, loose: NDArray[np.bool_]
    ) -> tuple[Combination, ...]:
        """Return the base parameters among undetermined ones, by a QR decomposition with pivots."""
        from scipy.linalg import qr

        if not loose.any():
            return ()
        steps = 1j * STEP * np.diag(self.scale)
        by_scaled = np.array([self._base(numbers + step).imag for step in steps]).T / STEP
        factor = [self.mass if ".com." in name else 1.0 for name in self.names]
        scale = self.scale * factor
        own: Any = (matrix @ np.linalg.inv(by_scaled / scale[:, None]))[:, loose]
        decomposed: Any = qr(own, mode="economic", pivoting=True)
        _, upper, order = decomposed
        rank = int((np.abs(np.diag(upper)) > RANK_TOLERANCE * np.abs(matrix).max()).sum())
        shares = np.linalg.solve(upper[:rank, :rank], upper[:rank, rank:])
        shares[np.abs(shares) < MIN_SHARE] = 0.0
        positions, covariance = np.flatnonzero(loose)[order], by_scaled @ covariance @ by_scaled.T
        names = [
            name.replace(".com.", ".mass*com.").replace(".inertia.", ".inertia_about_origin.")
            if name in self.moved
            else name
            for name in self.names
        ]
        result: list[Combination] = []
        for i, row in zip(positions[:rank], shares, strict=True):
            factors = np.zeros(len(self.names))
            factors[i], factors[positions[rank:]] = 1.0, row * scale[i] / scale[positions[rank:]]
            named = {names[j]: float(factors[j]) for j in (i, *positions[rank:]) if factors[j]}
            deviation = float(np.sqrt(factors @ covariance @ factors))
            result.append(Combination(named, float(factors @ self._base(numbers)), deviation))
        return tuple(result)


def inertial_columns(unit: UnitMotion, slot: int, rate: float, gravity: Array) -> Array:
    """Return the wrenches that a link needs per unit of its linear parameters, about its origin, (n, 6, 10).

    m (a - g) + alpha x s + omega x (omega x s), and s x (a - g) + I alpha + omega x I omega, with the mass m,
    first moments s and the inertia matrix I about the origin, whose elements are those of `PAIRS`.

    Args:
        unit: the motion, at a constant rate of its path parameter.
        slot: number of the link.
        rate: of the path parameter, per second.
        gravity: acceleration of gravity in [m/s2], (3,).
    """
    bias, rotation = rate**2 * unit.bias[:, slot], unit.rotation[:, slot]
    lift, alpha, omega = bias[:, :3] - gravity, bias[:, 3:], rate * unit.twist[:, slot, 3:]
    out = np.zeros((len(unit), 6, 10))
    out[:, :3, 0] = lift
    for k in range(3):
        arm = rotation[:, :, k]
        out[:, :3, 1 + k] = cross(alpha, arm) + cross(omega, cross(omega, arm))
        out[:, 3:, 1 + k] = cross(arm, lift)
    for k, (i, j) in enumerate(PAIRS, 4):
        local = np.zeros((3, 3))
        local[i, j] = local[j, i] = 1.0
        element = rotation @ local @ np.swapaxes(rotation, 1, 2)
        about_alpha, about_omega = ((element @ vector[..., None])[..., 0] for vector in (alpha, omega))
        out[:, 3:, k] = about_alpha + cross(omega, about_omega)
    return out
