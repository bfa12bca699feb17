"""Print the oldest versions of the dependencies that pyproject.toml allows, as constraints for pip.

python tests/oldest_versions.py > constraints.txt
"""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
EXTRAS = ("viz", "convert", "scale")
"""What users can install; the tools of the other extras may be as new as they like."""


def oldest_versions(project: dict[str, object]) -> dict[str, str]:
    """Lower bounds of the dependencies of a ``[project]`` table, by name.

    >>> oldest_versions({"dependencies": ["numpy>=1.26", "rich[all]>=13,<99"], "optional-dependencies": {}})
    {'numpy': '1.26', 'rich': '13'}
    """
    extras = project["optional-dependencies"]
    requirements = [*project["dependencies"], *(line for name in EXTRAS for line in extras.get(name, []))]
    return {found[1]: found[2] for line in requirements if (found := re.match(r"([\w.-]+)(?:\[.*\])?>=([\w.]+)", line))}


if __name__ == "__main__":
    import tomllib  # since Python 3.11

    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for name, version in oldest_versions(pyproject["project"]).items():
        print(f"{name}=={version}")
