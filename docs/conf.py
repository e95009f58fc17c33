"""How Sphinx builds the pages: `make docs`. Every page's code runs, warnings are errors, no network is needed."""

import os
import re
import sys
import tempfile
from pathlib import Path

import jupyter_cache.executors.utils as execution
import nbclient
from docutils import nodes
from traitlets.config import Config

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS))

import command_line_page  # noqa: E402
import element_pages  # noqa: E402
import gallery_page  # noqa: E402

import mechsim  # noqa: E402

project = "mechsim"
author = "The mechsim maintainers"
copyright = "The mechsim maintainers; Apache-2.0"
version = release = mechsim.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
    "published_text",
    "sphinx_copybutton",
]
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]
html_theme = "furo"
html_title = "mechsim"
html_static_path = ["_static"]
html_css_files = ["mechsim.css"]
html_extra_path = ["_generated/extra"]
html_show_sphinx = False
html_math_renderer = "mathml"

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_output_stderr = "remove"
nb_merge_streams = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings state types, shapes and units
autodoc_class_signature = "separated"
# `name` in docstrings is code
default_role = "code"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
nitpicky = False
# two hyphens start an option
smartquotes_action = "qe"

# commands in pages run with this Python, as wide as a page
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
os.environ["COLUMNS"] = "90"
os.environ["IPYTHONDIR"] = str(DOCS / "_generated" / "ipython")
os.environ["MECHSIM_SOURCES"] = str(DOCS.parent)


# a shell cell prints the output of its commands without colours. It fails if they fail, or, as `%%sh exits 1`,
# if they end with another exit code
SHELL = """
import os, subprocess
from IPython.core.magic import register_cell_magic
for name in ("FORCE_COLOR", "CLICOLOR_FORCE", "CLICOLOR"):
    os.environ.pop(name, None)
@register_cell_magic
def sh(line, cell):
    run = subprocess.run(["sh", "-ec", cell], capture_output=True, text=True)
    print(run.stdout, end="")
    if run.returncode != int(line.removeprefix("exits") or 0):
        raise RuntimeError(f"exit code {run.returncode}: {run.stderr}")
"""


def _execute(notebook, **options):
    """Run a page's cells by a kernel with sockets in its own folder: parallel kernels race for free TCP ports."""
    with tempfile.TemporaryDirectory() as folder:
        sockets = {"transport": "ipc", "ip": f"{folder}/kernel"}
        return nbclient.execute(notebook, config=Config(KernelManager=sockets), **options)


execution.executenb = _execute


def _prepare():
    """Write the generated pages and the code that every kernel runs first."""
    start = DOCS / "_generated" / "ipython" / "profile_default" / "startup"
    start.mkdir(parents=True, exist_ok=True)
    (start / "00-shell.py").write_text(SHELL, encoding="utf-8")
    gallery_page.write(DOCS / "_generated")
    command_line_page.write(DOCS / "_generated")
    element_pages.write(DOCS / "_generated")


def _keep_numbers_in_one_line(_app, doctree, _page):
    """Mark short table entries, so that 1e-15 is not broken at its hyphen."""
    for entry in doctree.findall(nodes.entry):
        if len(entry.astext()) <= 12:
            entry["classes"].append("short")


def _show_what_is_typed(_app, doctree, _page):
    """Show shell cells and files without the cell's first line: `%%sh`, or `%%writefile NAME` as a comment."""
    for block in doctree.findall(nodes.literal_block):
        first, _, text = block.astext().partition("\n")
        if first.startswith("%%sh"):
            block["language"] = "sh"
        elif first.startswith("%%writefile "):
            name = first.split()[1]
            block["language"] = Path(name).suffix.removeprefix(".").replace("py", "python")
            text = (f"<!-- {name} -->" if block["language"] == "xml" else f"# {name}") + f"\n{text}"
        else:
            continue
        block.rawsource, block.children = text, [nodes.Text(text)]


def _join_paragraphs(_app, _what, _name, _object, _options, lines):
    """Align the further lines of the accuracy and the source in a docstring with the first one."""
    indent = None
    for i, line in enumerate(lines):
        text = line.strip()
        if text.startswith(("Accuracy:", "Source:")):
            indent = line[: len(line) - len(line.lstrip())]
        elif not text:
            indent = None
        elif indent is not None:
            lines[i] = indent + text


def _name_functions(_app, _what, _name, _object, _options, signature, returned):
    """Write a default that is a function by its name."""
    return signature and (re.sub(r"<function ([^>]*)>", r"\1", signature), returned)


def setup(app):
    """Write the generated pages before Sphinx reads any page."""
    app.connect("config-inited", lambda _app, _config: _prepare())
    app.connect("doctree-resolved", _keep_numbers_in_one_line)
    app.connect("doctree-resolved", _show_what_is_typed)
    app.connect("autodoc-process-docstring", _join_paragraphs)
    app.connect("autodoc-process-signature", _name_functions)
