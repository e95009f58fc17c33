"""The lines of Python by which a tuned file is run in plain MuJoCo; its comment says them, too."""

from collections.abc import Callable, Mapping
from pathlib import Path

from mechsim.studies.scenes.plain_settings import FLAGS
from mechsim.studies.scenes.user_scene import RK4, UserScene

FUNCTIONS = "acos, asin, atan, atan2, cos, exp, log, pi, sin, sqrt, tan"
# option -> its value as MuJoCo's Python has it
NUMBERS: dict[str, Callable[[object], str]] = {
    "integrator": lambda value: f"mujoco.mjtIntegrator.mjINT_{str(value).upper()}",
    "solver": lambda value: f"mujoco.mjtSolver.mjSOL_{str(value).upper()}",
    "jacobian": lambda value: f"mujoco.mjtJacobian.mjJAC_{str(value).upper()}",
}


def feeding(scene: UserScene, said: Mapping[str, str]) -> list[str]:
    """Return the lines that give MuJoCo its inputs before each step, t being the time and h the step.

    Args:
        scene: the scene, its model with the settings by which it is stepped.
        said: joint or actuator -> its program as an expression of t.
    """
    model = scene.model
    lines = [f"data.ctrl[{of}] = {said[name]}" for name, of in zip(scene.ctrl, scene.fed, strict=True)]
    for name, dof in zip(scene.drive, scene.driven_dofs, strict=True):
        force = f"data.qfrc_applied[{dof}] = {scene.wheels[name][0]!r}"
        if model.opt.integrator == RK4:
            lines.append(f"{force} * (rate({name!r}, t + h) - rate({name!r}, t)) / h")
        else:
            place = int(model.jnt_qposadr[scene.driven_joints[name]])
            lines.append(f"{force} * ((q({name!r}, t + h) - data.qpos[{place}]) / h - data.qvel[{dof}]) / h")
    return lines


def python_of(
    scene: UserScene,
    file: Path,
    said: Mapping[str, str],
    *,
    changed: Mapping[str, object] | None = None,
    heading: str = "Runs a tuned scene in plain MuJoCo.",
) -> str:
    """Return a script that runs a tuned file in plain MuJoCo; its `steps()` yields the data after every step.

    Args:
        scene: the scene of the file, its model with the settings by which it is stepped.
        file: its path; the script lies beside it.
        said: joint or actuator -> its program as an expression of t.
        changed: settings that differ from the file's, as `PlainSettings` has them.
        heading: its docstring.
    """
    lines = [f'"""{heading}"""', "", f"from math import {FUNCTIONS}  # noqa: F401"]
    lines += ["from pathlib import Path", "", "import mujoco"]
    tables = any("table(" in one for one in said.values())
    lines += ["import numpy as np", "from scipy.interpolate import make_interp_spline"] if tables else []
    lines += ["", f'model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("{file.name}")))']
    lines += _changed(changed or {})
    if tables:
        lines += _table_lines()
    if scene.drive:
        lines += _program_lines(scene, said)
    lines += ["", "", f"def steps(duration={scene.duration!r}):"]
    lines += ['    """Yield MuJoCo\'s data after every step."""']
    lines += ["    data, h = mujoco.MjData(model), model.opt.timestep"]
    if scene.key is not None:
        lines.append(f"    mujoco.mj_resetDataKeyframe(model, data, model.key({scene.key!r}).id)")
    lines += ["    for step in range(round(duration / h)):", "        t = step * h"]
    lines += [f"        {line}" for line in feeding(scene, said)]
    lines += ["        mujoco.mj_step(model, data)", "        yield data", "", ""]
    lines += ['if __name__ == "__main__":', "    for data in steps():", "        pass"]
    lines += ["    print(data.time, data.qpos)", ""]
    return "\n".join(lines)


def _changed(settings: Mapping[str, object]) -> list[str]:
    """Return the lines that change settings of a loaded model."""
    lines: list[str] = []
    for name, value in settings.items():
        if name in FLAGS:
            bit, off = FLAGS[name]
            field = "disableflags" if off else "enableflags"
            lines.append(f"model.opt.{field} {f'|= {bit}' if value != off else f'&= ~{bit}'}  # {name}")
        elif name in ("solref", "solimp"):
            lines.append(f"model.eq_{name}[:] = {value!r}")
        elif name == "compliance":
            lines += [
                "# softness is scaled by these weights, and no file can say them",
                f"model.body_invweight0[:] *= {value:g}",
                f"model.dof_invweight0[:] *= {value:g}",
            ]
        else:
            number = NUMBERS[name](value) if name in NUMBERS else repr(value)
            lines.append(f"model.opt.{name} = {number}")
    return lines


def _program_lines(scene: UserScene, said: Mapping[str, str]) -> list[str]:
    """Return the functions that say where prescribed joints are, and how fast."""
    lines = ["", "", "def q(joint, t):", '    """Where a prescribed joint is."""']
    lines += [f"    if joint == {name!r}:\n        return {said[name]}" for name in scene.drive]
    lines += ["    raise KeyError(joint)"]
    if scene.model.opt.integrator == RK4:
        near = "8 * (q(joint, t + d) - q(joint, t - d)) - q(joint, t + 2 * d) + q(joint, t - 2 * d)"
        lines += ["", "", "def rate(joint, t, d=1e-4):", '    """How fast it is there."""']
        lines += [f"    return ({near}) / (12 * d)"]
    return lines


def _table_lines() -> list[str]:
    """Return the function that reads a program from a table of t and value, joined as mechsim joins it."""
    return [
        "",
        "",
        "def table(path):",
        '    """Return a function of t from the columns of a file."""',
        '    columns = np.genfromtxt(path, delimiter=",", names=True)',
        '    value = next(name for name in columns.dtype.names if name not in ("t", "time"))',
        "    return make_interp_spline(columns[columns.dtype.names[0]], columns[value], k=5)",
    ]
