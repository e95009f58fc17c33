"""How Sphinx builds the pages: `make docs`. Every page's code runs, warnings are errors, no network is needed."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

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
nb_execution_timeout = 120
nb_output_stderr = "remove"
nb_merge_streams = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_class_signature = "separated"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
nitpicky = False
# two hyphens begin an option
smartquotes_action = "qe"

# the pages' own commands: of this Python, as wide as a page, on two cores
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
os.environ["COLUMNS"] = "108"
os.environ["IPYTHONDIR"] = str(HERE / "_generated" / "ipython")
os.environ["MECHSIM_SOURCES"] = str(HERE.parent)


# a shell cell prints what its commands print, at once and without colours, and fails as they do
SHELL = """
import os, subprocess
from IPython.core.magic import register_cell_magic
for name in ("FORCE_COLOR", "CLICOLOR_FORCE", "CLICOLOR"):
    os.environ.pop(name, None)
@register_cell_magic
def sh(line, cell):
    done = subprocess.run(["sh", "-ec", cell], capture_output=True, text=True)
    print(done.stdout, end="")
    if done.returncode:
        raise RuntimeError(done.stderr)
"""


def _prepare():
    """Make pictures and pages of mechanisms, and what every kernel runs first."""
    start = HERE / "_generated" / "ipython" / "profile_default" / "startup"
    start.mkdir(parents=True, exist_ok=True)
    (start / "00-shell.py").write_text(SHELL, encoding="utf-8")
    gallery_page.write(HERE / "_generated")


def _with_the_rest(_app, name, source):
    """Put pages that no table of contents names at the end of one."""
    if name == "index":
        named = set(source[0].split())
        rest = [path.stem for path in sorted(HERE.glob("*.md")) if path.stem not in {*named, "index"}]
        source[0] = source[0].replace("REST\n", "".join(f"{one}\n" for one in rest))


def setup(app):
    """Make what is made from files before the pages are read."""
    app.connect("config-inited", lambda _app, _config: _prepare())
    app.connect("source-read", _with_the_rest)
