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

# the pages' own commands: of this Python, as wide as a page, on two cores
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
os.environ["COLUMNS"] = "96"
os.environ["MECHSIM_SOURCES"] = str(HERE.parent)


def setup(app):
    """Make what is made from files before the pages are read."""
    app.connect("config-inited", lambda _app, _config: gallery_page.write(HERE / "_generated"))
