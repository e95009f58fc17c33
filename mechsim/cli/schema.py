"""JSON Schemas of what commands print with --json; numbers that JSON does not have are null in it."""

from typing import Annotated, Any, get_args

import typer

from mechsim import files
from mechsim.cli.options import Json, Output, writable
from mechsim.cli.output import print_json
from mechsim.errors import InputError
from mechsim.model.finding import Outcome
from mechsim.model.masses import Source
from mechsim.subjects.toml_keys import schema as schema_of
from mechsim.verdict.tolerances import InstantUnit


def schema(
    command: Annotated[
        str | None,
        typer.Argument(
            metavar="[COMMAND]", help="Whose --json output is meant; none: a mechanism's TOML file."
        ),
    ] = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Print the JSON Schema of mechanisms in TOML, or of what a command prints with --json.

    Editors complete and check such files by it.
    """
    if command is not None and command not in OUTPUTS:
        raise InputError(f"there is no schema of {command!r}; known are {', '.join(sorted(OUTPUTS))}")
    told = schema_of() if command is None else output_schema(command)
    if output is None:
        print_json(told)
        return
    files.write_json(writable(output, ".json"), told)
    if as_json:
        print_json({"output": output})


Schema = dict[str, Any]


def maybe(one: Schema) -> Schema:
    """Return the schema of something that may be null."""
    return {"anyOf": [one, {"type": "null"}]}


def record(optional: dict[str, Schema] | None = None, /, **required: Schema) -> Schema:
    """Return the schema of an object with these keys, of which the optional may be missing."""
    return {"type": "object", "properties": required | (optional or {}), "required": list(required)}


def named(one: Schema) -> Schema:
    """Return the schema of an object whose keys are names: of mechanisms, joints, parameters."""
    return {"type": "object", "additionalProperties": one}


def many(one: Schema) -> Schema:
    """Return the schema of a list."""
    return {"type": "array", "items": one}


TEXT: Schema = {"type": "string"}
WHOLE: Schema = {"type": "integer"}
YES: Schema = {"type": "boolean"}
ANY: Schema = {}
NUMBER: Schema = {"type": ["number", "null"]}
TEXTS, NUMBERS = many(TEXT), many(NUMBER)
OUTCOME: Schema = {"enum": list(get_args(Outcome))}
CHECK = record(
    quantity=TEXT,
    method=TEXT,
    unit=TEXT,
    worst=NUMBER,
    at=NUMBER,
    at_unit={"enum": list(get_args(InstantUnit))},
    rms=NUMBER,
    tolerance=NUMBER,
    reason=TEXT,
    passed=YES,
)
SETTINGS = record({"timestep": NUMBER}) | {"additionalProperties": ANY}
FINDING = record(
    {"remedy": TEXT, "line": maybe(WHOLE), "file": TEXT, "certain": YES},
    kind=TEXT,
    what=TEXT,
    by=NUMBER,
    explains=NUMBER,
    message=TEXT,
)
NOISE_TEST = record(squares=NUMBER, degrees=WHOLE, probability=NUMBER, worst=NUMBER, limit=NUMBER, passed=YES)
NOISE = record(
    sigma=NUMBER,
    systematic=YES,
    chi_squared=NUMBER,
    degrees=WHOLE,
    probability=NUMBER,
    false_alarm=NUMBER,
    report=TEXT,
    quantities=named(
        record(
            passed=YES,
            sigma=NUMBER,
            deviation=NUMBER,
            chi_squared=NOISE_TEST,
            smooth=NOISE_TEST,
            largest=NOISE_TEST,
        )
    ),
)
PUBLISHED = record(settings=SETTINGS, driven=TEXT, loop_closure=NUMBER, error=NUMBER, note=TEXT)
PEAK = record({"at_angle": NUMBER, "at_time": NUMBER}, largest=NUMBER)
EFFORT = record(
    {"at_angle": NUMBER, "at_time": NUMBER, "unit": TEXT}, largest=NUMBER, mean=NUMBER, rms=NUMBER
)
TURN = record(mean=NUMBER, coefficient=NUMBER, torque=NUMBER, excess=NUMBER, flywheel=NUMBER)
PROMISE = record(
    {
        "order": NUMBER,
        "trials": WHOLE,
        "settings": maybe(SETTINGS),
        "torque": NUMBER,
        "reactions": NUMBER,
        "halving": NUMBER,
        "balance": NUMBER,
    },
    of=TEXT,
    by=TEXT,
    reason=TEXT,
    tolerance=NUMBER,
    satisfied=YES,
    estimate=NUMBER,
    margin=NUMBER,
    steps=WHOLE,
)
MOBILITY = record(freedoms=WHOLE, drivers=TEXTS, open=TEXTS, redundant_drivers=TEXTS, redundant=WHOLE)
LINE = record(frame=NUMBER, frame_angle=NUMBER, rocker=NUMBER, deviation=NUMBER)
ADVICE = record(command=maybe(TEXT), export=maybe(TEXT), xml=maybe(TEXT), python=TEXT)
POINT = record(
    {"settings": SETTINGS},
    family=TEXT,
    integrator=TEXT,
    steps_per_turn=WHOLE,
    defaults=YES,
    drive=TEXT,
    reduction=TEXT,
    seconds_per_turn=NUMBER,
    position_error=NUMBER,
    velocity_error=NUMBER,
    acceleration_error=NUMBER,
)
FEW_DIGITS = {
    "few_digits": maybe(record(digits=WHOLE, at=NUMBER, over={"enum": ["angle", "t"]}, conditioning=NUMBER))
}

MASSES = many(
    record(
        link=TEXT,
        mass=NUMBER,
        source={"enum": list(get_args(Source))},
        length=maybe(NUMBER),
        diameter=maybe(NUMBER),
        density=maybe(NUMBER),
    )
)

# command -> what it prints
OUTPUTS: dict[str, Schema] = {
    "list": record(mechanisms=named(TEXT), gallery=named(TEXT)),
    "doctor": record(
        versions=named(TEXT),
        opengl=many(
            record(name=TEXT, works=YES, software=maybe(YES), driver=TEXT, version=TEXT, package=TEXT)
        ),
        ffmpeg=maybe(TEXT),
        remedy=TEXT,
    ),
    "show": record(
        {
            "outcome": {"enum": ["determined", "underdetermined", "overdetermined"]},
            "programs": named(TEXT),
            "duration": NUMBER,
            "crank_range": TEXT,
            "crank_ranges": many(NUMBERS),
            "dead_centres": NUMBERS,
            "change_points": NUMBERS,
            "turns_to_come_round": WHOLE,
            "transmission_angle": maybe(record(least=NUMBER, at_angle=NUMBER)),
            "angle": NUMBER,
            "assemblies": many(record({"branch": WHOLE}, points=named(NUMBERS))),
            "assur_groups": many(record(**{"class": WHOLE, "order": WHOLE, "links": TEXTS})),
            "assur_explained": TEXTS,
            "findings": many(FINDING),
        },
        name=TEXT,
        about=TEXT,
        parameters=named(record(value=ANY, unit=TEXT, doc=TEXT)),
        points=TEXTS,
        links=TEXTS,
        joints=many(record(name=TEXT, kind=TEXT, links=TEXTS)),
        couplings=many(record(name=TEXT, driven=named(NUMBER), driver=named(NUMBER), coefficients=NUMBERS)),
        locked=named(NUMBER),
        mobility={"anyOf": [WHOLE, MOBILITY]},
        mobility_explained=TEXTS,
    ),
    "solve": record(FEW_DIGITS, mechanism=TEXT, rows=WHOLE, output=maybe(TEXT), columns=named(NUMBERS)),
    "simulate": record(
        FEW_DIGITS,
        mechanism=TEXT,
        outcome=OUTCOME,
        tolerance=NUMBER,
        estimate=NUMBER,
        steps=WHOLE,
        seconds=NUMBER,
        method={"enum": ["pose", "step"]},
        note=TEXT,
        settings=SETTINGS,
        output=maybe(TEXT),
        rows=WHOLE,
    ),
    "dynamics": record(
        {
            "torque": EFFORT,
            "drives": named(EFFORT),
            "routes": NUMBER,
            "reactions": named(
                record(
                    on=TEXT, by=TEXT, force=PEAK, moment=PEAK, not_determined=TEXTS, partly_determined=TEXTS
                )
            ),
            "couplings": named(
                record(
                    {"force": PEAK},
                    effort=PEAK,
                    unit=TEXT,
                    determined=YES,
                    by={"enum": ["teeth", "thread", "ideal transmission"]},
                    links=TEXTS,
                )
            ),
            "indeterminacy": WHOLE,
            "shaking_force": PEAK,
            "shaking_moment": PEAK,
            "inertia": record(least=NUMBER, largest=NUMBER),
            "power_balance": NUMBER,
            "note": TEXT,
            "fluctuation": maybe(TURN),
            "with_flywheel": maybe(TURN),
            "free": record(
                outcome=OUTCOME,
                reason=TEXT,
                seconds=NUMBER,
                turns=NUMBER,
                speed=NUMBER,
                work=NUMBER,
                lost=NUMBER,
                energy_error=NUMBER,
            ),
        },
        mechanism=TEXT,
        masses=MASSES,
        promise=maybe(PROMISE),
        passed=maybe(YES),
        outcome=maybe(OUTCOME),
        method=TEXT,
        checks=many(CHECK),
    ),
    "synthesize": LINE | {"properties": LINE["properties"] | {"straightest": LINE}},
    "trace": record(
        mechanism=TEXT,
        starts=WHOLE,
        seed=WHOLE,
        closed=WHOLE,
        components=many(
            record(
                component=WHOLE,
                own=YES,
                found=WHOLE,
                length=NUMBER,
                turns=WHOLE,
                dead_centres=NUMBERS,
                turning_points=many(
                    record(coordinate=TEXT, which=TEXT, value=NUMBER, arc=NUMBER, angle=NUMBER)
                ),
            )
        ),
        branch_points=many(ANY),
        left_out=many(ANY),
        output=maybe(TEXT),
        plot=maybe(TEXT),
    ),
    "tradeoff": record(
        mechanism=TEXT,
        reference=TEXT,
        reference_error=named(NUMBER),
        quantity=TEXT,
        stroke=NUMBER,
        trials=WHOLE,
        left_out=WHOLE,
        unbuilt=WHOLE,
        untried=TEXTS,
        seconds=NUMBER,
        recommended=many(record(bound=NUMBER, point=maybe(POINT), advice=maybe(ADVICE))),
        pareto=many(POINT),
        orders=named(maybe(record(order=NUMBER, low=NUMBER, high=NUMBER))),
        points=many(POINT),
        seed=WHOLE,
        budget=NUMBER,
        output=maybe(TEXT),
        plot=maybe(TEXT),
    ),
    "extremes": record(
        passed=YES,
        borders=many(
            record(axis=TEXT, mechanism=TEXT, inside=NUMBER, outside=NUMBER, before=TEXT, after=TEXT)
        ),
        drifts=many(record(mechanism=TEXT, turns=NUMBER, first=NUMBER, last=NUMBER, passed=YES)),
        trials=many(record(axis=TEXT, mechanism=TEXT, value=NUMBER, outcome=TEXT, passed=YES)),
    ),
    "validate": record(
        passed=YES,
        mechanisms=named(
            record(
                {
                    "reason": TEXT,
                    "why": TEXT,
                    "against": TEXT,
                    "steps": WHOLE,
                    "seconds": NUMBER,
                    "compliance": NUMBER,
                    "attribution": named(ANY),
                    "noise": NOISE,
                    "published": PUBLISHED,
                    "findings": many(FINDING),
                    "masses": MASSES,
                },
                passed=YES,
                outcome=OUTCOME,
                checks=many(CHECK),
            )
        ),
    ),
}
OUTPUTS["export"] = record(
    {
        "mechanism": TEXT,
        "format": {"enum": ["xml", "toml"]},
        "text": maybe(TEXT),
        "missed": TEXT,
        "mechanisms": TEXTS,
    },
    output=maybe(TEXT),
)
OUTPUTS["schema"] = {"type": "object"}
OUTPUTS["plot"] = record({"masses": MASSES}, mechanism=TEXT, kind=TEXT, output=TEXT)
OUTPUTS["render"] = record({"masses": MASSES}, mechanism=TEXT, output=TEXT, frames=maybe(WHOLE))
OUTPUTS["view"] = record(mechanism=TEXT, output=TEXT, opened=YES)
REDUCED = record(trajectory=NUMBER, torque=NUMBER, energy=NUMBER)
OUTPUTS["reduce"] = record(
    left_out=many(record({"family": TEXT, "together": NUMBER}, what=TEXT, error=NUMBER, time_ratio=NUMBER)),
    error=NUMBER,
    speedup=NUMBER,
    motion=REDUCED,
    second_motion=REDUCED,
    ms_per_s=record(full=NUMBER, reduced=NUMBER),
    tried=WHOLE,
    undone=TEXTS,
    tolerance=NUMBER,
    by=TEXT,
    unit=TEXT,
    output=maybe(TEXT),
)
TRIED = record(error=NUMBER, ms_per_s=NUMBER, settings=named(ANY), errors=named(ANY))
OUTPUTS["tune"] = record(
    mechanism=TEXT,
    by=TEXT,
    tolerance=NUMBER,
    unit=TEXT,
    reached=YES,
    summary=TEXTS,
    published=record(error=NUMBER, ms_per_s=NUMBER, settings=named(ANY), errors=named(ANY), reached=YES),
    tuned=record(error=NUMBER, estimate=NUMBER, ms_per_s=NUMBER, settings=named(ANY), errors=named(ANY)),
    by_python=maybe(TRIED),
    limit=record(what=TEXT, error=NUMBER, effort_error=NUMBER),
    put_in=many(ANY),
    diff=ANY,
    seconds=NUMBER,
    tried=many(TRIED),
    output=maybe(TEXT),
    python=maybe(TEXT),
)
OUTPUTS["sweep"] = record(
    {"masses": MASSES}, model=TEXT, output=TEXT, designs=WHOLE, built=WHOLE, seconds=NUMBER
)
OUTPUTS["sensitivity"] = record(
    {
        "tolerances": record(
            {"monte_carlo": maybe(named(ANY))},
            bounds=named(NUMBER),
            distribution=TEXT,
            quantities=named(ANY),
            paths=named(ANY),
        ),
        "masses": MASSES,
    },
    mechanism=TEXT,
    rows=WHOLE,
    over={"enum": ["angle", "t"]},
    dimensions=named(record(value=NUMBER, unit=TEXT)),
    units=named(TEXT),
    columns=named(NUMBERS),
    left_out=named(ANY),
    output=maybe(TEXT),
    plot=maybe(TEXT),
)
OUTPUTS["fit"] = record(
    mechanism=TEXT,
    outcome=TEXT,
    dimensions=named(record(value=NUMBER, deviation=NUMBER, within_95=NUMBER, start=NUMBER, unit=TEXT)),
    covariance=many(NUMBERS),
    correlations=named(NUMBER),
    not_told_apart=many(TEXTS),
    rms=named(NUMBER),
    spread=NUMBER,
    weighed=YES,
    condition=NUMBER,
    rows=WHOLE,
    numbers=WHOLE,
    tried=WHOLE,
    output=maybe(TEXT),
)


def output_schema(command: str) -> Schema:
    """Return the JSON Schema of what a command prints with --json; KeyError where it has none."""
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"What `mechsim {command} --json` prints",
        "description": "Numbers are in SI, angles in rad; null stands for a number that is not finite.",
    }
    return head | OUTPUTS[command]
