"""Command `mechsim doctor`: installed and missing software on this machine."""

import platform
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

from mechsim.cli.command import Result, command
from mechsim.cli.output import print_table, print_text
from mechsim.errors import MissingToolError, install_command
from mechsim.numerics import c_library

# extra of mechsim -> the libraries that its commands import
EXTRAS = {
    "pictures": ("matplotlib", "mediapy", "jinja2", "PIL"),
    "tables": ("pandas", "xarray"),
    "sweep": ("xarray", "netCDF4"),
    "robots": ("yaml",),
}
# cost of a missing compiler: `ms.dynamics.run` of a four-bar released for 1 s takes 0.89 s in numpy and
# 0.049 s in C (medians of five, on two idle cores)
WITHOUT_COMPILER = (
    "runs from an initial state integrate in numpy, up to 18 times slower, and controllers cost MuJoCo's "
    "steps 12 times as much; `compile` writes text only"
)


@command
def doctor() -> Result:
    """Report versions, OpenGL back ends, ffmpeg and missing libraries, and how to install what is missing.

    Examples:
    mechsim doctor
    mechsim doctor --json
    """
    data = examine()

    def text() -> None:
        print_table("Versions", ("library", "version"), data["versions"].items())
        rows = [
            (row["name"], row["driver"] or "does not work", "software" if row["software"] else "")
            for row in data["opengl"]
        ]
        print_table("OpenGL without a screen", ("back end", "driver", ""), rows)
        print_text(f"ffmpeg: {data['ffmpeg'] or 'none'}")
        print_text(f"C compiler: {data['compiler'] or f'none, so {WITHOUT_COMPILER}'}")
        for extra, libraries in EXTRAS.items():
            if missing(libraries):
                print_text(f"not installed: {', '.join(missing(libraries))} ({extra})")
        print_text(
            f"to install what is missing: {data['remedy']}" if data["remedy"] else "nothing is missing"
        )

    return Result(data, text)


def missing(libraries: Sequence[str]) -> list[str]:
    """Return the libraries that are not installed."""
    return [library for library in libraries if find_spec(library) is None]


def examine() -> dict[str, Any]:
    """Return the software of this machine, as plain data."""
    from mechsim.pictures.render import describe_backend, find_ffmpeg
    from mechsim.report.page import versions

    backends = describe_backend()
    remedies = [install_command(extra) for extra, libraries in EXTRAS.items() if missing(libraries)]
    if not any(backend["works"] for backend in backends):
        packages = " ".join(str(backend["package"]) for backend in backends if backend["package"])
        remedies.append(f"apt-get install {packages}")
    tools: dict[str, str | None] = {}
    for name, find, remedy in (
        ("ffmpeg", find_ffmpeg, "pip install imageio-ffmpeg"),
        ("compiler", c_library.compiler, "apt-get install gcc"),
    ):
        try:
            tools[name] = find()
        except MissingToolError:
            tools[name] = None
            remedies.append(remedy)
    return {
        "versions": versions() | {"machine": platform.platform()},
        "opengl": backends,  # pyright: ignore[reportReturnType]
        **tools,
        "remedy": " && ".join(remedies),
    }
