"""Random command lines: commands, options, values, parameters and files, a third of them invalid."""

from command_outcomes import Case
from hypothesis import strategies as st

from mechsim import catalog

# values: valid, unusual, invalid
numbers = st.one_of(
    st.floats(-1e3, 1e3).map(repr),
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.sampled_from(["0", "-0", "1e-300", "1e300", "nan", "inf", "", "1e999", "0x10", "1,5", "5e-324", "٣"]),
)
units = st.sampled_from(
    [
        *("", "mm", "m", "deg", "rad", "rpm", "s", "ms", "um", " mm", "parsecs", "kg", "%", "1/m"),
        *("mm!", "mm=1", "mm#x", "m**9**9**9", "m**2", "(m)"),
    ]
)
quantities = st.builds(lambda number, unit: f"{number}{unit}", numbers, units)
lengths = st.integers(1, 400).map(lambda value: f"{0.5 * value}mm")
texts = st.one_of(quantities, st.text(max_size=8), st.sampled_from(["on", "off", "1", "-1", "+1", "2,3,4mm"]))
names = st.one_of(
    st.sampled_from(list(catalog.MECHANISMS)),
    st.sampled_from(["rsr", "", "four-bar", "RSSR", "--", "n" * 304, "."]),
    st.text(max_size=6),
)


@st.composite
def set_options(draw: st.DrawFn, name: str) -> list[str]:
    """Return `--set` options, valid and invalid."""
    listed = list(catalog.parameters(name)) if name in catalog.MECHANISMS else ["crank"]
    words: list[str] = []
    for _ in range(draw(st.integers(0, 3))):
        parameter = draw(st.one_of(st.sampled_from(listed), st.sampled_from(listed), st.text(max_size=5)))
        equals = draw(st.sampled_from(["=", "=", "=", "=", "", "=="]))
        words += ["--set", f"{parameter}{equals}{draw(st.one_of(lengths, texts))}"]
    return words


outputs = st.sampled_from(
    [
        "out.csv",
        "out.npz",
        "out.xml",
        "out.svg",
        "out.png",
        "out.pdf",
        "out",
        ".csv",
        "no/out.csv",
        ".",
        "out.CSV",
        "ä b.csv",
        "n" * 300 + ".csv",
    ]
)
amounts = st.sampled_from(["1", "0.1", "0", "-1", "nan", "1e300", "1e29", "1e-308", "x", ""])
angles = st.one_of(
    st.sampled_from(
        ["0:360:5deg", "0:1:0.1", "30deg", "0:360:0deg", "360:0:-30deg", "a:b:c", "0:1e9:1", "::", "1:2"]
    ),
    st.builds(lambda a, b, c: f"{a}:{b}:{c}", quantities, quantities, quantities),
    quantities,
)
speeds = st.one_of(st.sampled_from(["600rpm", "-1rpm", "1e5rpm", "0", "3mm"]), quantities)
small = st.integers(-3, 400).map(str)

# command -> option -> values
OPTIONS: dict[str, dict[str, st.SearchStrategy[str]]] = {
    "list": {},
    "show": {
        "--angle": quantities,
        "--driver": st.one_of(st.sampled_from(["crank", "rocker", "rod3"]), texts),
    },
    "solve": {"--angles": angles, "--speed": speeds, "-o": outputs},
    "export": {
        "--scene": st.sampled_from(["pose", "motion", "dynamics", "picture", "other", ""]),
        "--cut": st.one_of(st.sampled_from(["A", "B", "P3", "A,B", "crank", ""]), st.text(max_size=4)),
        "-o": outputs,
    },
    "simulate": {
        "--speed": speeds,
        "--turns": st.one_of(
            st.sampled_from(["1", "0.3", "0", "-1", "nan", "inf"]), numbers.filter(lambda n: len(n) < 4)
        ),
        "--tolerance": st.sampled_from(["1um", "1e-3", "0", "-1", "nan", "1deg", "1mm"]),
        "--timestep": st.sampled_from(["1ms", "0.1ms", "0", "1s", "-1", "nan", "1mm"]),
        "--setting": st.one_of(
            small.map("steps_per_turn={}".format),
            st.sampled_from(["RK4", "Euler", "implicitfast", "discrete", "verlet", ""]).map(
                "integrator={}".format
            ),
            st.sampled_from(["0.02,1", "-1e4,-100", "0,0", "nan,1", "1", "a,b"]).map("solref={}".format),
            st.sampled_from(["0.9,0.95,0.001", "0,0", "2,2", "nan,1", "0.9,0.9,0,0,0"]).map(
                "solimp={}".format
            ),
        ),
        "--compliance": st.sampled_from(["1", "1e-8", "0", "nan", "1e300", "x"]),
        "--method": st.sampled_from(["step", "pose", "guess"]),
        "--profile": st.sampled_from(["crank.csv", "crank.npz", "no.csv", "."]),
        "--scene": st.sampled_from(["motion", "dynamics", "picture", "pose", "other"]),
        "-o": outputs,
    },
    "plot": {
        "--kind": st.sampled_from(["motion", "curve", "transmission", "x"]),
        "--points": st.one_of(st.sampled_from(["A", "B", "P3", "A,B"]), st.text(max_size=4)),
        "--angle": quantities,
        "-o": outputs,
    },
    "synthesize": {
        "--through": st.one_of(st.just("12.8751,29.9574mm"), texts),
        "--tilt": st.one_of(st.just("1.3905deg"), quantities),
        "--length": st.one_of(st.just("4mm"), quantities),
    },
    "validate": {"--speed": speeds},
    "render": {
        "-o": st.sampled_from(["out.bmp", "no/out.png", "no/" + "n" * 304]),
        "--size": st.sampled_from(["big", "1x1", "²x²", "1x" + "9" * 5000, "640x480x3"]),
    },
    "dynamics forward": {
        "--motor": st.sampled_from(
            ["constant:1e20", "line:1e4,600rpm", "dc:12,1,0.05", "constant:0", "line:1", "dc:1,0,1", "x:1"]
        ),
        "--gear": amounts,
        "--turns": st.sampled_from(["1", "0.01", "1e-308", "0", "nan"]),
    },
    "dynamics inverse": {
        "--flywheel": amounts,
        "--density": amounts,
        "--diameter": amounts,
        "--turns": st.sampled_from(["1", "0.01", "1e-308", "0", "nan", "9999"]),
        "--samples": st.sampled_from(["36", "1", "0", "100000"]),
        "--gravity": st.sampled_from(["0,-9.81,0", "1e300,0,0", "0,0", "nan,0,0"]),
        "--friction": amounts.map("crank={}".format),
        "--coefficient": amounts,
        "--method": st.sampled_from(["pose", "none", "none", "x"]),
    },
    "tradeoff": {"--budget": st.sampled_from(["0", "-1s", "nan", "x"]), "--by": st.just("colour")},
    "extremes": {"--report": st.sampled_from(["no/out", "n" * 304])},
}
FREQUENT = ["show", "solve", "solve", "export", "export", "simulate", "simulate", "simulate", "plot", "list"]
RARE = ["synthesize", "validate", "render", "dynamics inverse", "dynamics inverse", "dynamics forward"]
# slow commands -> the option that makes them invalid
ALWAYS_INVALID = {"tradeoff": "--budget", "extremes": "--report", "render": "-o"}


# values that are valid alone; a combination may still be rejected
VALID: dict[str, list[str]] = {
    "--angle": ["30deg", "1", "-400deg"],
    "--angles": ["0:360:5deg", "0:1:0.1", "30deg", "-10:10:3"],
    "--speed": ["600rpm", "-1rpm", "1e5rpm", "1e-3"],
    "--scene": ["pose", "motion", "dynamics", "picture"],
    "--turns": ["1", "0.3", "3"],
    "--tolerance": ["1um", "1e-3", "1mm", "1e-9"],
    "--timestep": ["1ms", "0.1ms"],
    "--setting": [
        *(f"steps_per_turn={count}" for count in (4, 17, 100, 1000)),
        *(f"integrator={name}" for name in ("RK4", "Euler", "implicitfast", "implicit", "discrete")),
        *("solref=0.02,1", "solref=-1e4,-100", "solimp=0.9,0.95,0.001", "solimp=0.5,0.6"),
    ],
    "--compliance": ["1", "1e-8", "1e-2", "1e3"],
    "--method": ["step", "pose"],
    "--kind": ["motion", "curve", "transmission"],
    "--motor": ["constant:1", "line:2,600rpm", "dc:12,1,0.05"],
    "--flywheel": ["0", "1e-3", "1e3"],
    "--density": ["7850", "1", "1e6"],
    "--samples": ["36", "1", "200"],
}


FILES: dict[str, list[str]] = {"render": [], "export": ["out.xml"], "plot": ["out.svg", "out.png", "out.pdf"]}
REQUIRED: dict[str, tuple[str, ...]] = {
    "plot": ("-o", "out.svg"),
    "synthesize": ("--through", "12.8751,29.9574mm", "--tilt", "1.3905deg", "--length", "4mm"),
}
WITH_JSON = ("list", "show", "solve", "simulate", "validate", "synthesize")


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Return a command line: a third of them with invalid components, the others of valid ones."""
    valid = draw(st.integers(0, 2)) > 0
    command = draw(st.sampled_from(FREQUENT * 3 + RARE + ["tradeoff", "extremes"]))
    valid = valid and command not in ALWAYS_INVALID
    words = command.split()
    if command != "list":
        name = draw(st.sampled_from(list(catalog.MECHANISMS)) if valid else names)
        words.append(name)
        words += draw(scaled_parameters(name) if valid else set_options(name))
    choices = OPTIONS[command]
    for option in (
        draw(st.lists(st.sampled_from(sorted(choices)), max_size=4, unique=True)) if choices else []
    ):
        values = FILES.get(command, ["out.csv", "out.npz"]) if option == "-o" else VALID.get(option, [])
        if not valid or values:
            words += [option, draw(st.sampled_from(values) if valid else choices[option])]
    if command in ALWAYS_INVALID and ALWAYS_INVALID[command] not in words:
        words += [ALWAYS_INVALID[command], draw(choices[ALWAYS_INVALID[command]])]
    if valid and not set(REQUIRED.get(command, ())) & set(words):
        words += REQUIRED.get(command, ())
    if (not valid or command in WITH_JSON) and draw(st.integers(0, 3)) == 0:
        words.append("--json")
    if not valid and draw(st.integers(0, 9)) == 0:
        words.append(draw(st.text(max_size=6)))
    return Case(tuple(words), draw(profiles()) if "--profile" in words else {})


@st.composite
def scaled_parameters(draw: st.DrawFn, name: str) -> list[str]:
    """Return `--set` options that scale parameters by up to a half, or far more."""
    words: list[str] = []
    for parameter, kind in catalog.parameters(name).items():
        if not isinstance(kind.default, float) or draw(st.integers(0, 2)):
            continue
        extreme = st.sampled_from([1e-9, 1e-3, 30.0, 1e6, -1.0])
        factor = draw(st.one_of(st.floats(0.7, 1.4), st.floats(0.5, 1.5), st.floats(0.9, 1.1), extreme))
        words += ["--set", f"{parameter}={float(kind.default * factor)!r}"]
    return words


@st.composite
def profiles(draw: st.DrawFn) -> dict[str, bytes]:
    """Return crank profiles, valid and invalid."""
    rows = draw(
        st.lists(st.tuples(st.floats(-1, 1), st.floats(-10, 10)), max_size=12)
        | st.integers(6, 30).map(lambda n: [(0.01 * i, 0.03 * i) for i in range(n)])
    )
    head = draw(st.sampled_from(["time,angle", "time, angle", "\ufefftime,angle", "angle,time", "t,a", ""]))
    text = "\n".join([head, *(f"{t!r},{a!r}" for t, a in rows)])
    content = draw(
        st.sampled_from([text.encode(), text.encode()[:-3], b"\xff\xfe\x00", b"", text.encode("utf-16")])
    )
    return {"crank.csv": content, "crank.npz": draw(st.binary(max_size=40))}
