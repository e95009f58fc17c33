"""Imports MuJoCo for any MUJOCO_GL: failure of a rendering back end does not affect other functions."""

import ctypes
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mechsim.errors import MissingToolError

# the first release with mujoco.batch
REQUIRED = "mujoco>=3.17.0"
# the distributions of MuJoCo 4, which share a folder and must have the same version
DISTRIBUTIONS = ("mujoco", "mujoco-core", "mujoco-studio")


def import_mujoco() -> str:
    """Import MuJoCo, without a back end if that of MUJOCO_GL fails; return a note about that.

    Raises:
        MissingToolError: if MuJoCo is missing, too old or damaged; names the command that repairs it.
    """
    problem = _import_without_back_end()
    if find_spec("mujoco.batch") is None:
        raise MissingToolError(
            f"MuJoCo {version('mujoco')} is too old; pip install -U '{REQUIRED}' updates it"
        )
    # import mujoco.batch, which loads an XML; MuJoCo then loads again what the user loaded last
    mujoco = import_module("mujoco")
    library = next(Path(str(mujoco.__file__)).parent.glob("*mujoco.*"), None)
    with TemporaryDirectory() as folder:
        last = Path(folder, "last.xml")
        if library is not None and "mujoco.batch" not in sys.modules:
            ctypes.CDLL(str(library)).mj_saveLastXML(os.fsencode(last), None, None, 0)
        import_module("mujoco.batch")
        if last.exists():
            with suppress(ValueError):  # a file of a mesh that is not in this folder
                mujoco.MjModel.from_xml_path(str(last))
    return problem


def _import_without_back_end() -> str:
    """Import MuJoCo, without a back end if that of MUJOCO_GL fails; return a note about that."""
    platform, back_end = (os.environ.get(name) for name in ("PYOPENGL_PLATFORM", "MUJOCO_GL"))
    try:
        _import()
    except Exception as error:  # a missing or broken library may raise any type
        if not back_end:
            raise _unusable(error) from error
        # undo the choice of a back end that PyOpenGL made when it was first imported
        if platform is None:
            os.environ.pop("PYOPENGL_PLATFORM", None)
        for name in [name for name in sys.modules if name.split(".")[0] == "OpenGL"]:
            del sys.modules[name]
        os.environ["MUJOCO_GL"] = "off"
        try:
            _import()
        except Exception as error_without_back_end:
            raise _unusable(error_without_back_end) from error_without_back_end
        finally:
            os.environ["MUJOCO_GL"] = back_end
        return f"MUJOCO_GL={back_end} does not work here; pictures use another back end, if there is one"
    return ""


def _import() -> None:
    # a folder without its files still imports, as an empty package
    if not hasattr(import_module("mujoco"), "MjModel"):
        raise ImportError("the package mujoco has no MjModel")


def _unusable(error: Exception) -> MissingToolError:
    """Return the error of a MuJoCo that is missing or damaged, with the command that repairs it.

    pip damages MuJoCo when it replaces version 3 by version 4: it installs mujoco-core first and then
    removes the files of the old mujoco, which have the same names.
    """
    try:
        installed = version("mujoco")
    except PackageNotFoundError:
        return MissingToolError(f"MuJoCo is not installed; pip install '{REQUIRED}' installs it")
    names = DISTRIBUTIONS if int(installed.split(".")[0]) >= 4 else DISTRIBUTIONS[:1]
    pins = " ".join(f"{name}=={installed}" for name in names)
    cause = error.__cause__ or error
    return MissingToolError(
        f"MuJoCo {installed} is installed, but it cannot be imported ({cause}), as after an update by pip "
        f"from version 3; pip install --force-reinstall --no-deps {pins} repairs it"
    )


@contextmanager
def quiet() -> Generator[None]:
    """Silence MuJoCo's log; its warnings are read from its counters and reported as an outcome.

    By default MuJoCo writes MUJOCO_LOG.TXT into the current folder.
    """
    mujoco: Any = import_module("mujoco")
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_console = silent.logto_file = False
    silent.set()
    try:
        yield
    finally:
        before.set()


PROBLEM = import_mujoco()
