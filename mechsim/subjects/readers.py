"""What a command is given, made into what moves: a name, FILE.toml, FILE.xml or FILE.py:OBJECT."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from os import PathLike, fspath
from typing import Any

from mechsim import units
from mechsim.analytic import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.derivatives.dimensions import DesignFamily, Dimension, catalog_family, placed_family
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.mobility import undetermined_joints
from mechsim.analytic.loops.start import with_closed_guess
from mechsim.errors import InputError
from mechsim.model.forces import Forces
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import State
from mechsim.subjects import gallery
from mechsim.subjects.mjcf_source import MjcfForm, read_mjcf
from mechsim.subjects.parameter_units import parameter_dependencies, parameter_units
from mechsim.subjects.prescription import Prescription, apply_prescription, started_by_laws
from mechsim.subjects.python_object import parameters_of, read_python
from mechsim.subjects.toml_reader import TomlModel, read_toml, values_of
from mechsim.subjects.toml_values import read_source


def read_catalog(name: str, changed: Mapping[str, str]) -> ClosedForm:
    """Return a catalogue mechanism with some parameters changed.

    Args:
        name: of the mechanism.
        changed: parameter -> its value as text; bare numbers are in SI.

    Raises:
        InputError: for an unknown name or parameter (with the nearest known one) or a bad value.
    """
    return catalog.make(name, **changed)


# read as MJCF; that URDF is another language is said where it is read
MJCF_EXTENSIONS = (".xml", ".urdf")


def is_file(model: str) -> bool:
    """Whether a model is meant as a file: by its ending alone, so that no file shadows a known name."""
    return model.lower().endswith((".toml", *MJCF_EXTENSIONS, ".py")) or ".py:" in model


def load(
    model: str | PathLike[str],
    set: Mapping[str, str | float] | None = None,
    *,
    drive: Mapping[str, str | State] | None = None,
    lock: Mapping[str, str | float | None] | Iterable[str] = (),
    fix_base: bool = False,
    lock_others: bool = False,
    key: str | None = None,
    track: Iterable[str] = (),
    duration: str | float | None = None,
    still: bool = False,
) -> Form:
    """Return what moves.

    Args:
        model: a name of the catalogue or the gallery, FILE.toml, FILE.xml in MJCF, or FILE.py:OBJECT, a
            Mechanism, a catalogue object, or a function that returns one, whose arguments with numbers as
            defaults are parameters. The Python file is run.
        set: parameter -> its value as text, as `--set` takes it, or a number in SI; docs/models.md states the
            rule of numbers without a unit.
        drive: coordinate -> its program: text as `--drive` takes it, or a function of times (n,) in [s] that
            returns value, rate and acceleration, (n,) each in SI.
        lock: joint or coordinate -> where it is locked, as text or in SI; None, or a name alone: where
            it starts.
        fix_base: whether what floats is held where it starts.
        lock_others: whether joints that the drivers leave undetermined are locked where they start: all those
            outside loops, and in loops as many as there are undetermined degrees of freedom.
        key: name of a keyframe to start from; of MJCF files only.
        track: the points that count, as `NAME` or `NAME,LINK@x,y,z`; all there are if left out.
        duration: of the programs, as text or in [s].
        still: whether nothing need be driven in an MJCF file, as to say what it is.

    Raises:
        InputError: for what is none of these; names the file, the line, the value and the remedy.
    """
    if not isinstance(model, str | PathLike):  # pyright: ignore[reportUnnecessaryIsInstance]
        kind = type(model).__name__
        raise InputError(f"a model is of type {kind}; give a name or a file, as 'rssr' or 'linkage.toml'")
    prescription = _prescription(drive, lock, fix_base, key, track, duration, still, lock_others)
    return _load(fspath(model), set, prescription, assembled=True)


def load_unassembled(model: str, set: Mapping[str, str | float] | None = None, **options: Any) -> Form:
    """Return what `load` does, but as it is described, where nobody asks whether it can be put together.

    Its guess is the file's own; finding one that is closed takes far longer than reading.
    """
    return _load(model, set, _prescription(**options), assembled=False)


def _prescription(
    drive: Mapping[str, str | State] | None = None,
    lock: Mapping[str, str | float | None] | Iterable[str] = (),
    fix_base: bool = False,
    key: str | None = None,
    track: Iterable[str] = (),
    duration: str | float | None = None,
    still: bool = False,
    lock_others: bool = False,
) -> Prescription:
    return Prescription(
        drive=drive or {},
        lock=lock if isinstance(lock, Mapping) else dict.fromkeys(lock),
        fix_base=fix_base,
        key=key,
        track=tuple(track),
        duration=units.parse_time(duration, "the duration") if isinstance(duration, str) else duration,
        still=still,
        lock_others=lock_others,
    )


def _load(
    model: str, set: Mapping[str, str | float] | None, prescription: Prescription, *, assembled: bool
) -> Form:
    """Return what moves, with what its drivers leave undetermined locked where that is asked for."""
    plain = replace(prescription, lock_others=False)
    if not prescription.lock_others:
        return _load_prescribed(model, set, plain, assembled=assembled)
    # on the way to a value that a joint is locked at, the others are to be locked already
    at_start = replace(plain, lock=dict.fromkeys(plain.lock))
    others = undetermined_joints(_load_prescribed(model, set, at_start, assembled=assembled).mechanism)
    locked = replace(plain, lock={**plain.lock, **dict.fromkeys(others)})
    return _load_prescribed(model, set, locked, assembled=assembled)


def _load_prescribed(
    model: str, set: Mapping[str, str | float] | None, prescription: Prescription, *, assembled: bool
) -> Form:
    changed = dict(set or {})
    model_ = _read_model(model, changed, prescription)
    if isinstance(model_, MjcfForm):
        # the reader has done the rest
        return apply_prescription(
            model_, Prescription(drive=prescription.drive, duration=prescription.duration)
        )
    form = (
        started_by_laws(model_.form, {**model_.motion_laws, **prescription.drive})
        if isinstance(model_, TomlModel)
        else model_
    )
    form = _assembled(form) if assembled and isinstance(form, LoopForm) else form
    if isinstance(model_, TomlModel):
        return apply_prescription(form, prescription, model_.motion_laws, model_.duration)
    return apply_prescription(form, prescription)


def _assembled(form: LoopForm) -> LoopForm:
    """Return a form that begins where it is put together, on MuJoCo's road too."""
    return replace(form, mechanism=with_closed_guess(form.mechanism))


def _read_model(
    model: str, changed: Mapping[str, str | float], prescription: Prescription
) -> Form | TomlModel:
    """Return what moves as it says itself."""
    if not is_file(model):
        return _named(model, changed, prescription)
    if model.lower().endswith(".toml"):
        return read_toml(model, changed, drivers=tuple(prescription.drive))
    if model.lower().endswith(MJCF_EXTENSIONS):
        if changed:
            raise InputError(f"{model}: an MJCF file has no parameters; leave out --set")
        return read_mjcf(
            model,
            drivers=tuple(prescription.drive),
            lock=prescription.lock,
            fix_base=prescription.fix_base,
            key=prescription.key,
            track=prescription.track,
            still=prescription.still,
        )
    return read_python(model, changed)


def _named(name: str, parameters: Mapping[str, str | float], prescription: Prescription) -> Form | TomlModel:
    files = gallery.files()
    if name in files and name not in catalog.DRIVES:
        return read_toml(str(files[name]), parameters, drivers=tuple(prescription.drive))
    if name not in catalog.DRIVES:
        raise InputError(f"there is no mechanism {name!r}{catalog.nearest(name, [*catalog.DRIVES, *files])}")
    return read_catalog(name, {parameter: str(value) for parameter, value in parameters.items()})


def parametric_model(
    model: str | Form | Mechanism, set: Mapping[str, str | float] | None = None, **options: Any
) -> DesignFamily:
    """Return the family of a subject: its dimensions as they stand, in SI, and what makes others.

    Of a mechanism of the catalogue and of a TOML file these are the parameters, those of a place by parts,
    as pivot.x; of a function in a Python file its arguments that have numbers as defaults, in what unit the
    file does not say; of any other subject the places of joints, as JOINT.at.x (see `joint_places`).

    Args:
        model: as `load` takes it, or what moves itself.
        set: parameter -> its value, as `load` takes it.
        asked: what else `load` takes.

    Raises:
        InputError: as `load`.
    """
    if not isinstance(model, str):
        form = LoopForm(model) if isinstance(model, Mechanism) else model
        return catalog_family(form) if isinstance(form, ClosedForm) else placed_family(form)
    changes = dict(set or {})
    form, path = load(model, changes, **options), toml_path(model)
    dimensions = _python_parameters(model, changes)
    if isinstance(form, ClosedForm) and not dimensions:
        return catalog_family(form)
    dimensions = (
        dimensions
        if path is None
        else {dimension.name: dimension for dimension in _toml_parameters(path, changes)}
    )
    if not dimensions:
        return placed_family(form)

    def changed_values(values: Mapping[str, float]) -> dict[str, str | float]:
        return changes | {name: as_text(value, dimensions[name].unit) for name, value in values.items()}

    def make(values: Mapping[str, float]) -> Form:
        return load(model, changed_values(values), **options) if values else form

    def describe(values: Mapping[str, float]) -> Form:
        return load_unassembled(model, changed_values(values), **options) if values else form

    def forces(values: Mapping[str, float]) -> Forces | None:
        form_ = describe(values)
        return form_.forces

    forces_of = forces if getattr(form, "forces", None) is not None else None
    dependencies = {} if path is None else parameter_dependencies(read_source(path).document)
    derived = {name: sources for name, sources in dependencies.items() if sources and name not in changes}
    independent = tuple(name for name in dimensions if name not in derived)
    return DesignFamily(
        form.name,
        dimensions,
        lambda values: describe(values).mechanism,
        make,
        forces_of,
        independent,
        derived,
    )


def as_text(value: float, unit: str) -> str:
    """Return the value of a dimension in SI as text that a file of any units reads to the last bit."""
    return f"{float(value)!r} {unit}" if unit in ("m", "rad") else repr(float(value))


def toml_path(model: str) -> str | None:
    """Return the TOML file that a model is read from; None where it is none."""
    if is_file(model):
        return model if model.lower().endswith(".toml") else None
    path = gallery.files().get(model)
    return None if path is None or model in catalog.DRIVES else str(path)


def _python_parameters(model: str, changes: Mapping[str, str | float]) -> dict[str, Dimension]:
    """Return the parameters of a function in a Python file, as they are given."""
    if ".py:" not in model:
        return {}
    defaults = parameters_of(model)
    values = defaults | {
        name: units.of_any_kind(value_, name)[0] if isinstance(value_, str) else value_
        for name, value_ in changes.items()
    }
    return {name: Dimension(name, float(value), "1") for name, value in values.items()}


def _toml_parameters(path: str, changed: Mapping[str, str | float]) -> Iterator[Dimension]:
    """Yield the parameters of a file; one whose use does not tell what it measures as the file has it."""
    source = read_source(path)
    parameters, units_of = source.document.get("parameters", {}), parameter_units(source.document)
    values = values_of(source).with_parameters(parameters, changed, units_of)
    for name, value in values.parameters.items():
        unit = values.unit_of(name, parameters[name], units_of)
        if unit is None:
            yield Dimension(name, value, "1")
        else:
            yield Dimension(
                name, values.in_si(value, unit), unit, values.declared_unit(parameters[name], unit)
            )
