"""The workflows for hosted CI run what the repository has."""

import re
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))


def steps(name):
    """Return the commands of a workflow, one text for each job."""
    jobs = yaml.safe_load((ROOT / f".github/workflows/{name}.yml").read_text())["jobs"]
    return {job: "\n".join(step.get("run", "") for step in content["steps"]) for job, content in jobs.items()}


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_has_only_the_rights_that_it_states_and_ends(path):
    workflow = yaml.safe_load(path.read_text())
    assert set(workflow["permissions"]) == {"contents"}
    for job in workflow["jobs"].values():
        assert all(("uses" in step) != ("run" in step) for step in job["steps"])
        # an action is named with a version
        assert all(
            re.fullmatch(r"[\w-]+/[\w-]+@[\w/.]+", step["uses"]) for step in job["steps"] if "uses" in step
        )


def test_the_suite_runs_on_the_lowest_python_and_three_systems():
    readme = re.search(r"## Test\n\n```sh\n(.*)\n", (ROOT / "README.md").read_text())[1]
    assert readme.rsplit("python ", 1)[1] in steps("tests")["suite"]
    lowest = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"].removeprefix(
        ">="
    )
    matrix = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text())["jobs"]["suite"]["strategy"][
        "matrix"
    ]
    assert lowest in matrix["python"]
    assert len(matrix["os"]) == 3


def test_the_workflows_name_files_and_targets_that_exist():
    (script,) = re.findall(r"bash (\S+)", steps("tests")["whole"])
    assert (ROOT / script).is_file()
    (target,) = re.findall(r"make (\w+)", steps("pages")["pages"])
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE)


@pytest.mark.parametrize(("tag", "code"), [("", 0), ("9", 1)])
def test_a_tag_must_name_the_version(tag, code):
    version = re.search(r'"(.*)"', (ROOT / "mechsim/_version.py").read_text().split("__version__")[1])[1]
    check = next(line for line in steps("release")["build"].splitlines() if "GITHUB_REF_NAME" in line)
    run = subprocess.run(
        ["bash", "-c", check], cwd=ROOT, env={"GITHUB_REF_NAME": f"v{version}{tag}", "PATH": "/usr/bin:/bin"}
    )
    assert run.returncode == code
