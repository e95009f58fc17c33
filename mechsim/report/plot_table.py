"""Table of all kinds of plots: their data, their options, and whether the page of a validation shows them.

A new plot is a function in `pictures/plots`, or in its study, and a row of `PLOTS` here; `mechsim plot`,
its help and the page read the table.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import DynamicModel, dynamic_model
from mechsim.kinetics.prescribed_motion import prescribed_along
from mechsim.mechanism.masses import LinkMass
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.quantities import numeric_quantity
from mechsim.mechanism.quantity import TRANSMISSION, Quantity, record_columns, unwrapped
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.pictures import plots
from mechsim.pictures.number_text import readable
from mechsim.studies.drawn_motion import drawn_motion, initial_pose, is_undriven
from mechsim.studies.motions import profile_of
from mechsim.studies.release import Release

if TYPE_CHECKING:
    from mechsim.kinetics import InverseDynamics
    from mechsim.pictures.plots.figure import Figure

# intervals of a plotted motion: one a degree of a revolution
SAMPLES = 360
# kinds that show a run from the start of what only its own forces move
OF_RUNS = ("motion", "curve", "schematic", "quantities")
# duration of a run that shows its start, in [s]
INSTANT = 1e-9
# number of samples of a run whose errors are drawn, fewer because errors are smooth
ERROR_SAMPLES = 180


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotSource:
    """The source of a plot: a mechanism, and motions of it, computed on first use.

    Attributes:
        solver: of the mechanism.
        speed: of the crank in [rad/s].
        quantities: names of the quantities that a plot of them draws.
        motions: method -> an existing motion.
        bounds: method -> tolerance on the positions of its points in [m].
        masses: filled in by plots that need them.
        model: masses and forces of the mechanism for a prescribed motion.
        release: of a mechanism that only its own forces move, for the kinds in `OF_RUNS`.
    """

    solver: KinematicSolver
    speed: float
    quantities: Sequence[str] = ()
    motions: dict[str, Motion] = field(default_factory=dict[str, Motion])
    bounds: Mapping[str, float] = field(default_factory=dict[str, float])
    masses: list[LinkMass] = field(default_factory=list[LinkMass])
    model: Callable[[KinematicSolver], DynamicModel] = dynamic_model
    release: Release | None = None

    def motion(self, method: str, samples: int = SAMPLES) -> Motion:
        """Return a motion by the "closed" form, "simulated" in time, or "posed" angle by angle."""
        if self.release is not None:
            return _over_time(self.release.shown_run(samples).motion)
        if is_undriven(self.solver):
            return initial_pose(self.solver.mechanism)
        if method not in self.motions:
            profile = profile_of(self.solver, self.speed, 1.0)
            self.motions[method] = drawn_motion(self.solver, method, profile, samples)
        return self.motions[method]

    def start(self) -> Motion:
        """Return the start of a run; of other mechanisms the motion, in which a diagram finds a pose."""
        if self.release is None:
            return self.motion("closed")
        return replace(self.release, duration=INSTANT).shown_run(1).motion

    @property
    def title(self) -> str:
        """The mechanism, and its crank speed or the duration of its motion laws."""
        laws, name = self.solver.motion_laws, self.solver.name
        if self.release is not None:
            return f"{name}, {self.release.title}"
        if not laws.crank:
            return f"{name}, {laws.duration:.4g} s by its motion laws"
        if is_undriven(self.solver):
            return f"{name} at its start"
        return f"{name}, crank at {self.speed * 60.0 / REVOLUTION:.4g} rpm"

    def study(self) -> "InverseDynamics":
        """Return drive torque and reactions under the default forces of `mechsim dynamics`."""
        profile = profile_of(self.solver, self.speed, 1.0)
        time = np.linspace(0.0, profile.duration, SAMPLES + 1)
        analysis = prescribed_along(self.model(self.solver), *profile.state(time), time=time)
        self.masses.extend(analysis.masses)
        return analysis


@dataclass(frozen=True, slots=True)
class PlotKind:
    """A row of the table.

    Attributes:
        about: short description of the plot; its caption.
        draw: function of a source.
        on_page: whether the page of a validation shows it.
        transmission: whether it needs a transmission angle.
        of_quantities: whether it draws named quantities.
    """

    about: str
    draw: Callable[[PlotSource], "Figure"]
    of_quantities: bool = False
    on_page: bool = False
    transmission: bool = False

    def figure(self, source: PlotSource) -> "Figure":
        """Return the plot, titled with mechanism and speed."""
        figure = self.draw(source)
        figure.suptitle(source.title, x=0.01, ha="left", fontsize=9.0, parse_math=False)
        return figure


def plot_kind(kind: str, quantities: Sequence[str] | None) -> PlotKind:
    """Return a row of the table.

    Raises:
        InputError: for an unknown kind, or named quantities for a plot that draws none.
    """
    if kind not in PLOTS:
        raise InputError(f"there is no plot {kind!r}; choose from {', '.join(PLOTS)}")
    if quantities is not None and not PLOTS[kind].of_quantities:
        kinds = ", ".join(name for name, row in PLOTS.items() if row.of_quantities)
        raise InputError(f"plot {kind!r} takes no --of, which is of {kinds}; leave it out")
    return PLOTS[kind]


def _errors(source: PlotSource, method: str) -> "Figure":
    run = source.motion(method, ERROR_SAMPLES)
    exact = source.solver.solve_as(run)
    errors, tolerance, timed = run.position_errors(exact), source.bounds.get(method), bool(run.drivers)
    abscissa = run.time if timed and run.time is not None else run.angle
    return plots.error_plot(abscissa, errors, tolerance=tolerance, timed=timed)


def _transmission(source: PlotSource) -> "Figure":
    angles = source.motion("closed").angle
    return plots.transmission_plot(angles, source.solver.required_transmission_angle(angles))


def _quantities(source: PlotSource) -> "Figure":
    names = source.quantities
    if not names:
        raise InputError("no quantity is named; give --of, as in --of distance:P,Q,rocker.v")
    if source.release is not None:
        run = source.release.shown_run(SAMPLES)
        return plots.quantity_plot(_over_time(run.motion), _labelled(source.release.values(run, names)))
    motion = source.motion("closed")
    quantities = [numeric_quantity(name, source.solver.mechanism) for name in names]
    columns = record_columns(motion, quantities)
    if any(quantity.kind == TRANSMISSION for quantity in quantities):
        columns[TRANSMISSION] = source.solver.required_transmission_angle(motion.angle)
    if any(quantity.loaded for quantity in quantities):
        columns |= dict(source.study().columns())
    values = {quantity: quantity.number(columns) for quantity in quantities}
    return plots.quantity_plot(motion, _labelled(values))


def _over_time(motion: Motion) -> Motion:
    """Return the motion of a run, which is drawn over time even if nothing can be driven."""
    return replace(motion, drivers=motion.drivers or tuple(motion.joints))


def _labelled(values: Mapping[Quantity, Array]) -> dict[str, Array]:
    """Return label with unit -> values, angles without jumps of revolutions."""
    labelled: dict[str, Array] = {}
    for quantity, column in values.items():
        column = unwrapped(column) if quantity.angle else column
        factor, unit = readable(column, quantity.unit)
        labelled[f"{quantity.name} [{unit}]"] = column / factor
    return labelled


PLOTS = {
    "error": PlotKind(
        "position error of the stepped run", partial(_errors, method="simulated"), on_page=True
    ),
    "poses": PlotKind("position error of the solved poses", partial(_errors, method="posed"), on_page=True),
    "motion": PlotKind(
        "displacement, velocity and acceleration",
        lambda source: plots.motion_plot(source.motion("closed")),
        on_page=True,
    ),
    "curve": PlotKind(
        "paths of the tracked points",
        lambda source: plots.coupler_curve(source.solver.mechanism, source.motion("closed")),
        on_page=True,
    ),
    "schematic": PlotKind(
        "kinematic diagram",
        lambda source: plots.schematic_plot(source.solver.mechanism, source.start(), source.solver.forces),
    ),
    "transmission": PlotKind("transmission angle", _transmission, on_page=True, transmission=True),
    "quantities": PlotKind("quantities that --of names, over the motion", _quantities, of_quantities=True),
}
