"""Where the tools are that results are checked in, and how those that need no administrator are installed."""

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

from services.mocap.errors import UserError

_NODE_PACKAGE = "gltf-validator@2.0.0-dev.3.10"
_PYTHON_PACKAGES = ("opensim==4.6", "c3d==0.6.0")
_PATIENCE_S = 600


def tools_folder() -> Path:
    """Where tools are installed: XORMOCAP_TOOLS, or a folder beside other caches."""
    named = os.environ.get("XORMOCAP_TOOLS")
    return Path(named) if named else Path.home() / ".cache" / "xormocap" / "tools"


def blender() -> Path | None:
    """Blender's program: XORMOCAP_BLENDER, or the one on the path."""
    return _program(os.environ.get("XORMOCAP_BLENDER") or "blender")


def node() -> Path | None:
    """Node's program."""
    return _program("node")


def gltf_validator() -> Path | None:
    """The folder of Khronos' validator: XORMOCAP_GLTF_VALIDATOR, or the installed one."""
    named = os.environ.get("XORMOCAP_GLTF_VALIDATOR")
    folder = Path(named) if named else tools_folder() / "node_modules" / "gltf-validator"
    return folder if folder.is_dir() else None


def readers_python() -> Path | None:
    """The Python that has the readers of TRC and C3D files."""
    program = tools_folder() / "python" / "bin" / "python"
    return program if program.exists() else None


def install() -> None:
    """Install the validator (needs npm) and the readers into the tools' folder; raises UserError."""
    folder = tools_folder()
    folder.mkdir(parents=True, exist_ok=True)
    if _program("npm") is None:
        raise UserError("npm: is missing, and installs the glTF validator: install nodejs and npm")
    run(["npm", "install", "--silent", "--no-fund", "--no-audit", "--prefix", str(folder), _NODE_PACKAGE])
    venv.create(folder / "python", with_pip=True, clear=True)
    run([str(folder / "python/bin/python"), "-m", "pip", "install", "--quiet", *_PYTHON_PACKAGES])


def run(command: list[str], **environment: str) -> str:
    """Run a tool to its end and return what it printed; raises UserError with its last words."""
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=_PATIENCE_S,
        check=False,
        env={**os.environ, **environment},
    )
    if done.returncode != 0:
        words = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1]
        raise UserError(f"{command[0]}: failed, and said last: {words}")
    return done.stdout


def own_packages() -> str:
    """The folder of the packages that this Python has."""
    return str(Path(sys.modules["numpy"].__file__ or "").parents[1])


def _program(name: str) -> Path | None:
    found = shutil.which(name)
    return None if found is None else Path(found)
