"""What Khronos' glTF validator says of motion.glb."""

import json
from pathlib import Path

from bench.checks.tools import run

_SCRIPT = Path(__file__).with_name("validate_gltf.js")
_WORDS = ("error", "warning")  # and then information and hints


def complaints(node: Path, validator: Path, file: Path) -> list[str]:
    """Errors and warnings, a line each; validator: the folder of its node package."""
    report = json.loads(run([str(node), str(_SCRIPT), str(validator.resolve()), str(file)]))
    issues = report["issues"]
    found = [
        f"{_WORDS[one['severity']]} {one['code']} at {one.get('pointer', 'the file')}: {one['message']}"
        for one in issues["messages"]
        if one["severity"] < len(_WORDS)
    ]
    counted = issues["numErrors"] + issues["numWarnings"]
    return found if len(found) >= counted else [*found, f"and {counted - len(found)} more"]
