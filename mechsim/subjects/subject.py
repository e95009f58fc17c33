"""What a command is given, made into what moves: a name, FILE.toml, FILE.xml or FILE.py:OBJECT."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from os import PathLike, fspath
from typing import Any

from mechsim import units
from mechsim.analytic import catalog
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.determinacy import undetermined_joints
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.start_values import with_closed_guess
from mechsim.errors import InputError
from mechsim.model.motion_laws import State
from mechsim.subjects import gallery
from mechsim.subjects.catalog_object import read_catalog
from mechsim.subjects.mjcf_source import MjcfForm, read_mjcf
from mechsim.subjects.prescription import Prescription, apply_prescription, started_by_laws
from mechsim.subjects.python_object import read_python
from mechsim.subjects.toml_reader import TomlModel, read_toml

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
