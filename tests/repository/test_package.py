"""Descriptions of the package in several files agree."""

import json
import re
import tomllib
from pathlib import Path

import mechsim

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# packages with another name in conda-forge
OTHER_NAMES = {"mujoco-python": "mujoco", "matplotlib-base": "matplotlib", "netcdf4": "netCDF4"}


def lowest_versions(requirements):
    """Return package -> lowest version."""
    result = [re.fullmatch(r"([\w-]+)(?:\[.*\])?\s*>=([\w.]+)", item.strip()) for item in requirements]
    return {item[1]: item[2] for item in result if item}


def listed(recipe, key):
    """Return the lines of a list in a recipe."""
    block = re.search(rf"^  {key}:\n((?:    - .*\n)+)", recipe, re.MULTILINE)[1]
    return [line.removeprefix("    - ") for line in block.splitlines()]


def test_the_recipe_has_the_requirements_of_the_package():
    recipe = (ROOT / "recipe" / "recipe.yaml").read_text()
    extras = PROJECT["optional-dependencies"]
    run = {
        OTHER_NAMES.get(name, name): version
        for name, version in lowest_versions(listed(recipe, "run")).items()
    }
    assert run.pop("python") == PROJECT["requires-python"].removeprefix(">=")
    assert run == lowest_versions(PROJECT["dependencies"])
    constraints = {
        OTHER_NAMES.get(name, name): version
        for name, version in lowest_versions(listed(recipe, "run_constraints")).items()
    }
    from_extras = lowest_versions(
        [*extras["pictures"], *extras["tables"], *extras["sweep"], *extras["robots"]]
    )
    assert constraints.items() <= from_extras.items()
    assert set(from_extras) - set(constraints) == set()
    assert f'version: "{mechsim.__version__}"' in recipe


def test_extra_all_contains_the_others_and_tests_install_it():
    extras = PROJECT["optional-dependencies"]
    assert extras["all"] == ["mechsim[pictures,tables,sweep,robots,mcp,usd,logs]"]
    assert "mechsim[all]" in extras["test"]


def test_doi_descriptions_are_complete_and_name_the_authors():
    (author,) = re.findall(r'- name: "(.+)"', (ROOT / "CITATION.cff").read_text())
    for path, kind in ((".zenodo.json", "software"), ("reference/.zenodo.json", "dataset")):
        reported = json.loads((ROOT / path).read_text())
        assert {"title", "description", "license", "keywords"} <= set(reported)
        assert reported["upload_type"] == kind
        assert reported["creators"] == [{"name": author}]


def test_three_js_has_what_the_scripts_use_and_its_licence():
    view = ROOT / "mechsim/pictures/view"
    scripts = "".join(path.read_text() for path in sorted((view / "templates").glob("*.js")))
    used = set(re.findall(r"\bTHREE\.(\w+)", scripts))
    assert used == set(re.findall(r"\b[A-Z]\w+", (view / "three/three.entry.js").read_text()))
    bundled = (view / "three/three.min.js").read_text()
    assert [name for name in used if f"{name}:()=>" not in bundled] == []
    assert "MIT" in (view / "three/LICENSE").read_text()
