"""The pages in docs/: every public name is documented, every page is listed, every link exists."""

import re
import shlex
from pathlib import Path
from types import ModuleType

import command_line_page
import gallery_page
import pytest

import mechsim

DOCS = Path(__file__).parents[2] / "docs"
README = DOCS.parent / "README.md"
PAGES = [path for path in sorted(DOCS.rglob("*.md")) if not {"_build", "_generated"} & set(path.parts)]
PYTHON = "".join(path.read_text() for path in sorted((DOCS / "reference" / "python").glob("*.md")))
MODULES = {"catalog", "closure", "course", "dynamics", "motors", "plots", "render", "rods", "simulation"}
MODULES |= {"formulas", "testing", "units"}
GENERATED = {"_generated/gallery", "_generated/command_line", "_generated/elements"}
# tutorials, how-to and Python pages run their code; reference tables and measurements need not
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


def test_every_public_name_is_documented_with_an_example():
    assert undocumented(PYTHON) == set()


def test_a_missing_public_name_is_detected():
    assert undocumented(PYTHON.replace("ms.crosscheck(", "crosscheck(")) == {"crosscheck"}
    assert undocumented(PYTHON.replace(":: mechsim.sweep", ":: mechsim.swept")) == {"sweep"}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_a_page_starts_with_its_title(page):
    text = re.sub(r"\A---\nfile_format: mystnb\n.*?\n---\n", "", page.read_text(), flags=re.DOTALL)
    assert text.startswith(("# ", "```{include}"))
    assert len(re.findall(r"^# ", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)) <= 1


def test_every_page_is_in_the_contents():
    trees = re.findall(r"```\{toctree\}\n(.*?)```", (DOCS / "index.md").read_text(), re.DOTALL)
    listed = {line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")}
    notebooks = (DOCS / "tutorials").glob("*.ipynb")
    pages = {path.relative_to(DOCS).with_suffix("").as_posix() for path in [*PAGES, *notebooks]} - {"index"}
    assert listed == pages | GENERATED


@pytest.mark.parametrize("page", [*PAGES, README], ids=lambda path: path.name)
def test_links_and_pictures_of_a_page_exist(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if not re.match(r"https?:|mailto:|(\.\./)*_generated/|llms.txt$|\.\./\.\./actions/", link):
            assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda path: path.relative_to(DOCS).as_posix())
def test_pages_with_code_run_it(page):
    text = page.read_text()
    assert text.startswith("---\nfile_format: mystnb\n")
    assert text.count("```{code-cell}") >= 1


def test_tutorials_and_how_to_pages_contain_assertions():
    asserts = re.compile(r"\bassert\b|^test ", re.MULTILINE)
    pages = [page for page in WITH_CODE if page.parent.name != "python"]
    assert [page.name for page in pages if not asserts.search(code_of(page.read_text()))] == []


def test_each_command_has_a_page_with_every_option(tmp_path):
    command_line_page.write(tmp_path)
    listed = (tmp_path / "command_line.md").read_text()
    for name, command in command_line_page.commands().items():
        label = f"mechsim-{name.replace(' ', '-')}"
        page = (tmp_path / "commands" / f"{label}.md").read_text()
        assert f"commands/{label}\n" in listed
        assert page.startswith(f"({label})=\n# mechsim {name}\n")
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert parameter.opts[0] in page, (name, parameter.opts)


def test_pictures_in_docs_are_used():
    text = "".join(path.read_text() for path in [*PAGES, README])
    pictures = [path.name for path in DOCS.iterdir() if path.suffix in (".png", ".gif")]
    assert [name for name in pictures if name not in text] == []


def shell_lines(text: str) -> list[str]:
    """Return the lines of a page's shell blocks and shell segments that run mechsim."""
    blocks = re.findall(r"```(?:sh|console)[^\n]*\n(.*?)```", text, re.DOTALL)
    blocks += re.findall(r"```\{code-cell\}[^\n]*\n(?::tags:[^\n]*\n)?%%sh[^\n]*\n(.*?)```", text, re.DOTALL)
    lines = [line.strip().removeprefix("$ ") for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("mechsim ")]


def unknown_options(line: str) -> list[str]:
    """Return the commands and options of a line that mechsim does not have."""
    command, *words = shlex.split(line.split("|")[0].split(">")[0], comments=True)[1:]
    if command == "dynamics":
        command, words = f"dynamics {words[0]}", words[1:]
    if command not in command_line_page.commands():
        return [command]
    parameters = command_line_page.commands()[command].params
    existing = {option for parameter in parameters for option in (*parameter.opts, *parameter.secondary_opts)}
    return [word for word in words if re.match(r"-[a-zA-Z-]", word) and word.split("=")[0] not in existing]


def unknown_names(code: str) -> list[str]:
    """Return the names below `ms` in code that mechsim does not have."""
    names = set(re.findall(r"\bms((?:\.[a-zA-Z_]\w*)+)", code))
    missing = []
    for name in sorted(names):
        value = mechsim
        for component in name.strip(".").split("."):
            if not hasattr(value, component):
                missing.append(f"ms{name}")
                break
            value = getattr(value, component)
            # results of calls are not checked
            if not isinstance(value, ModuleType):
                break
    return missing


@pytest.mark.parametrize("page", [*PAGES, README], ids=lambda path: path.name)
def test_commands_options_and_names_of_a_page_exist(page):
    text = page.read_text()
    assert [(line, wrong) for line in shell_lines(text) if (wrong := unknown_options(line))] == []
    code = code_of(text) + "".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
    assert unknown_names(code) == []


def test_a_missing_command_option_or_name_is_detected():
    assert shell_lines("```sh\nmechsim show rssr\n```\n") == ["mechsim show rssr"]
    assert shell_lines("```{code-cell} ipython3\n%%sh exits 1\nmechsim show rssr\n```") == [
        "mechsim show rssr"
    ]
    assert unknown_options("mechsim plot rssr --kind curve -o a.svg | head") == []
    assert unknown_options("mechsim plot rssr --kinds curve") == ["--kinds"]
    assert unknown_options("mechsim plots rssr") == ["plots"]
    assert unknown_names("ms.catalog.make(1).a; ms.catalog.made(2); ms.solve") == [
        "ms.catalog.made",
        "ms.solve",
    ]


def test_a_gallery_card_links_its_view_and_respects_reduced_motion(tmp_path):
    (tmp_path / "extra" / "pictures").mkdir(parents=True)
    (tmp_path / "extra" / "pictures" / "klann.gif").write_bytes(b"0" * 2_000_000)
    text = gallery_page.card(tmp_path / "extra", "klann", "Klann's leg")
    assert text.startswith('<a href="../views/klann.html">')
    assert '<source media="(prefers-reduced-motion: reduce)" srcset="../pictures/klann.png">' in text
    assert gallery_page.megabytes(tmp_path, "*.gif") == 2.0
