"""The pages in docs/: every public name is documented, every page is listed, every link leads somewhere."""

import re
import sys
from pathlib import Path

import pytest

import mechsim

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [path for path in sorted(DOCS.rglob("*.md")) if not {"_build", "_generated"} & set(path.parts)]
PYTHON = "".join(path.read_text() for path in sorted((DOCS / "reference" / "python").glob("*.md")))
MODULES = {"catalog", "closure", "course", "dynamics", "motors", "plots", "render", "rods", "simulation"}
MODULES |= {"testing", "units"}
GENERATED = {"_generated/gallery", "_generated/command_line"}
# pages that teach or answer run what they show; reference tables and measurements need not
WITH_CODE = [path for path in PAGES if path.parent.name in ("tutorials", "howto", "python")]


def code_of(page: str) -> str:
    """Return the code that a page runs."""
    return "\n".join(re.findall(r"```\{code-cell\}.*?\n(.*?)```", page, re.DOTALL))


def undocumented(page: str) -> set[str]:
    """Return public names that a page neither documents nor uses in code that runs."""
    used = set(re.findall(r"\bms\.(\w+)", code_of(page)))
    documented = set(re.findall(r"\.\. auto\w+:: mechsim\.(\w+)", page))
    public = set(mechsim.__all__)
    return (public - used) | (public - documented - MODULES - {"__version__"})


def test_every_public_name_is_documented_with_an_example_that_runs():
    assert undocumented(PYTHON) == set()


def test_a_missing_public_name_is_noticed():
    assert undocumented(PYTHON.replace("ms.crosscheck(", "crosscheck(")) == {"crosscheck"}
    assert undocumented(PYTHON.replace(":: mechsim.sweep", ":: mechsim.swept")) == {"sweep"}


def test_every_page_is_in_the_contents():
    trees = re.findall(r"```\{toctree\}\n(.*?)```", (DOCS / "index.md").read_text(), re.DOTALL)
    listed = {line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")}
    pages = {path.relative_to(DOCS).with_suffix("").as_posix() for path in PAGES} - {"index"}
    assert listed == pages | GENERATED


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(DOCS).as_posix())
def test_links_and_pictures_of_a_page_exist(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if not re.match(r"https?:|mailto:|(\.\./)*_generated/|llms.txt$", link):
            assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda path: path.relative_to(DOCS).as_posix())
def test_pages_that_teach_run_what_they_show(page):
    text = page.read_text()
    assert text.startswith("---\nfile_format: mystnb\n")
    assert text.count("```{code-cell}") >= 1


def test_tutorials_and_how_to_pages_assert_what_they_state():
    asserts = re.compile(r"\bassert\b|^test ", re.MULTILINE)
    pages = [page for page in WITH_CODE if page.parent.name != "python"]
    assert [page.name for page in pages if not asserts.search(code_of(page.read_text()))] == []


def test_the_command_line_page_has_every_command_and_option(tmp_path):
    sys.path.insert(0, str(DOCS))
    import command_line_page

    command_line_page.write(tmp_path)
    text = (tmp_path / "command_line.md").read_text()
    for name, command in command_line_page.commands().items():
        section = text.split(f"\n## {name}\n")[1].split("\n## ")[0]
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert parameter.opts[0] in section, (name, parameter.opts)


def test_pictures_in_docs_are_used():
    text = "".join(path.read_text() for path in [*PAGES, DOCS.parent / "README.md"])
    pictures = [path.name for path in DOCS.iterdir() if path.suffix in (".png", ".gif")]
    assert [name for name in pictures if name not in text] == []


def test_the_glossary_has_thirty_terms_at_most_and_is_that_of_contributing():
    sys.path.insert(0, str(DOCS))
    from published_text import with_included

    text = with_included((DOCS / "reference" / "glossary.md").read_text(), DOCS / "reference")
    terms = re.findall(r"^\| ([^|]+) \|", text, re.MULTILINE)[1:]
    assert 20 <= len(terms) <= 30
    assert "assembly mode" in terms
