"""Agents call the commands as tools, confined to a folder."""

import asyncio
import json
import sys

import pytest
from mcp.client.client import Client
from mcp.client.stdio import StdioServerParameters, stdio_client
from model_files import model_text
from processes import MAIN, mechsim_run

from mechsim.cli.confined import require_confined
from mechsim.cli.mcp import TOOLS, run_tool
from mechsim.errors import InputError

# tool -> its options, and a key of its answer
CALLS = {
    "list_models": ([], "mechanisms"),
    "show": (["four_bar", "--set", "crank=40mm"], "mobility"),
    "check": (["scene.xml"], "findings"),
    "solve": (["four_bar", "--angles", "0:90:45deg"], "columns"),
    "validate": (["four_bar"], "mechanisms"),
    "dynamics_inverse": (["four_bar", "--samples", "12"], "mechanism"),
    "dynamics_forward": (["four_bar", "--motor", "constant:0.5", "--duration", "0.02"], "outcome"),
    "dynamics_statics": (["four_bar"], "equilibria"),
    "dynamics_modes": (["four_bar"], "modes"),
    "sweep": (
        ["four_bar", "--vary", "crank=30mm:40mm:3", "--measure", "range:rocker", "-o", "designs.csv"],
        "output",
    ),
    "render": (["four_bar", "--size", "64x48", "-o", "bar.png"], "text"),
}
OUTSIDE = {"render": ["four_bar", "-o", "../bar.png"], "sweep": ["four_bar", "-o", "../designs.csv"]}


@pytest.mark.long
def test_a_client_lists_and_calls_the_tools(tmp_path):
    (tmp_path / "scene.xml").write_text(model_text("rules_sound.xml"))

    async def session():
        words = ["-c", MAIN, "mcp", "--root", str(tmp_path)]
        parameters = StdioServerParameters(command=sys.executable, args=words)
        async with Client(stdio_client(parameters)) as client:
            tools = (await client.list_tools()).tools
            called = {name: await client.call_tool(name, {"options": CALLS[name][0]}) for name in CALLS}
            outside = {
                name: await client.call_tool(name, {"options": OUTSIDE.get(name, ["../scene.xml"])})
                for name in CALLS
            }
            rejected = await client.call_tool("show", {"model": "four_bar", "options": ["--set", "crank=-1"]})
            return [tool.name for tool in tools], called, outside, rejected

    names, called, outside, rejected = asyncio.run(session())
    assert names == list(TOOLS) == list(CALLS)
    for name, (_, key) in CALLS.items():
        assert not called[name].is_error, called[name].content
        assert key in called[name].structured_content, [*called[name].structured_content]
        assert outside[name].is_error
        assert "outside" in outside[name].content[0].text
    printed = mechsim_run("show", *CALLS["show"][0], "--json")
    assert called["show"].structured_content == json.loads(printed.stdout)
    assert (tmp_path / "designs.csv").stat().st_size > 0
    assert (tmp_path / "bar.png").stat().st_size > 0
    assert rejected.is_error
    assert "crank" in rejected.content[0].text


@pytest.fixture
def folder(tmp_path):
    inside = tmp_path / "served"
    inside.mkdir()
    (tmp_path / "secret.xml").write_text("<mujocoinclude/>")
    (inside / "link.toml").symlink_to(tmp_path / "secret.xml")
    (inside / "includes.xml").write_text('<mujoco><include file="more.txt"/></mujoco>')
    (inside / "more.txt").write_text('<mujocoinclude><include file="../secret.xml"/></mujocoinclude>')
    (inside / "mesh.xml").write_text('<mujoco><compiler meshdir="/"/></mujoco>')
    (inside / "escaped.xml").write_text('<mujoco><include file="&#46;&#46;/secret.xml"/></mujoco>')
    (inside / "sky.xml").write_text('<mujoco><texture type="cube" fileup="../sky.png"/></mujoco>')
    (inside / "good.xml").write_text('<mujoco><include file="good.xml"/><mesh file="part.obj"/></mujoco>')
    return inside


@pytest.mark.parametrize(
    "argument",
    [
        "../secret.xml",
        "/etc/hostname",
        "crank=../law.csv",
        "--against=f.py:position",
        "~/x.toml",
        "link.toml",
        "includes.xml",
        "mesh.xml",
        "escaped.xml",
        "sky.xml",
        "f.PY:position",
    ],
)
def test_files_outside_the_folder_are_rejected(folder, argument):
    with pytest.raises(InputError, match=r"outside|code"):
        require_confined([argument], folder)


def test_what_is_inside_is_accepted(folder):
    require_confined(
        ["good.xml", "bar.pylinkage.json", "four_bar", "--gravity", "0,0,-9.81/2", "--angles", "0:360:5deg"],
        folder,
    )


@pytest.mark.long
def test_a_table_that_a_description_names_outside_the_folder_is_not_read(folder):
    (folder.parent / "gear.csv").write_text("q,value\n0,0\n1,1\n")
    (folder / "pair.toml").write_text(
        "name = 'pair'\n[joints]\n"
        "crank = { kind = 'revolute', a = { link = 'ground' }, b = { link = 'bar' } }\n"
        "slide = { kind = 'prismatic', a = { link = 'ground' }, b = { link = 'rod' } }\n"
        "[couplings.gear]\ndriver = 'crank'\ndriven = 'slide'\nfunction = '../gear.csv'\n"
    )
    with pytest.raises(InputError, match=r"gear\.csv.*outside"):
        run_tool("show", ["pair.toml"], folder, 60.0)


def test_a_long_command_is_stopped(folder):
    with pytest.raises(InputError, match=r"more than 0\.01 s"):
        run_tool("show", ["four_bar"], folder, 0.01)
