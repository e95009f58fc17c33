"""Command `mechsim mcp`: commands as tools for programs, by the Model Context Protocol."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mechsim._version import __version__
from mechsim.cli.command import command
from mechsim.cli.confined import require_confined
from mechsim.errors import InputError, MechsimError, require_extra
from mechsim.units import option

# tool -> command, and what it is for
TOOLS = {
    "list_models": ("list", "List the mechanisms that mechsim brings; no model."),
    "show": (
        "show",
        "Parameters, joints, drivers, mobility, range, dead centres and assemblies. Ask this first.",
    ),
    "check": ("check", "Common mistakes in a closed-loop MJCF or URDF file, each with its remedy."),
    "solve": ("solve", "Exact motion: points and joints over the driver's position."),
    "validate": (
        "validate",
        "Compare exact motion and MuJoCo, or a table (--against FILE.csv); name the cause.",
    ),
    "dynamics_inverse": ("dynamics inverse", "Torques and reactions of a prescribed motion."),
    "dynamics_forward": ("dynamics forward", "A run from an initial state, with motors."),
    "dynamics_statics": ("dynamics statics", "Equilibria and holding torques."),
    "dynamics_modes": ("dynamics modes", "Natural frequencies and mode shapes."),
    "sweep": ("sweep", "Measure many designs; write the table with -o."),
    "render": ("render", "Draw or animate the mechanism; needs -o FILE.png or FILE.mp4."),
}
WITHOUT_JSON = ("render",)
# what an agent asks first, and how it reads a finding
SKILL = Path(__file__).parents[1] / "SKILL.md"
# of what one answer may hold: an agent reads it all; more goes into a file with -o
MAX_CHARACTERS = 200_000
# time in [s] after which a command is stopped
LIMIT = 120.0


def run_tool(name: str, words: list[str], folder: Path, limit: float) -> dict[str, Any]:
    """Return the JSON object of a command that runs in a process of its own, confined to a folder.

    Args:
        name: of the tool.
        words: model and options.
        folder: where files are read and written.
        limit: seconds after which the command is stopped.

    Raises:
        InputError: with the command's sentence, or for a file outside the folder, a command that needs more
            time, an answer of too many characters.
    """
    require_confined(words, folder)
    has_json = name not in WITHOUT_JSON and "--help" not in words
    argv = [*TOOLS[name][0].split(), *words]
    argv += ["--json"] * (has_json and "--json" not in words)
    argv += ["--no-formula"] * (has_json and name == "validate")
    with tempfile.TemporaryDirectory() as scratch:
        try:
            ended = subprocess.run(
                [sys.executable, "-c", "from mechsim.cli.confined import run; run()", str(folder), *argv],
                capture_output=True,
                encoding="utf-8",
                timeout=limit,
                env=os.environ | {"TMPDIR": scratch, "TEMP": scratch, "PYTHONIOENCODING": "utf-8"},
                stdin=subprocess.DEVNULL,
            )
        except subprocess.TimeoutExpired:
            raise InputError(f"{name} took more than {limit:g} s and was stopped; ask for less") from None
    if ended.returncode not in (0, 1) or (has_json and not ended.stdout):
        reason = ended.stderr.strip().removeprefix("mechsim: ")
        raise InputError(reason or f"{name} ended with {ended.returncode}")
    if len(ended.stdout) > MAX_CHARACTERS:
        raise InputError(
            f"the answer has {len(ended.stdout)} characters of at most {MAX_CHARACTERS}; write it with -o"
        )
    return json.loads(ended.stdout) if has_json else {"text": ended.stdout}


def server(folder: Path, limit: float) -> Any:
    """Return the server whose tools are commands confined to a folder."""
    require_extra("mcp", "mcp")
    from mcp.server.mcpserver import MCPServer
    from mcp.server.mcpserver.exceptions import ToolError

    instructions = SKILL.read_text(encoding="utf-8").rpartition("---\n")[2]
    served = MCPServer("mechsim", version=__version__, instructions=instructions, log_level="ERROR")

    def tool_of(name: str) -> Callable[..., dict[str, Any]]:
        def tool(model: str = "", options: list[str] | None = None) -> dict[str, Any]:
            try:
                return run_tool(name, [*filter(None, [model]), *(options or [])], folder, limit)
            except MechsimError as error:
                raise ToolError(str(error)) from None

        return tool

    for name, (_, text) in TOOLS.items():
        served.add_tool(tool_of(name), name=name, description=text)
    return served


@command
def serve(
    *,
    root: str = option(".", "Folder whose files are read and written.", metavar="FOLDER"),
) -> None:
    """Serve commands as tools for agents, on standard input and output (Model Context Protocol).

    Examples:
    mechsim mcp
    mechsim mcp --root models/
    """
    folder = Path(root).resolve()
    if not folder.is_dir():
        raise InputError(f"there is no folder {root}; name one that exists")
    server(folder, LIMIT).run()
