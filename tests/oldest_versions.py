"""Print the oldest versions of the dependencies of users that pyproject.toml allows, as constraints for pip.

The tools of the dependency groups may be as new as they like.

python tests/oldest_versions.py > constraints.txt
"""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def oldest_versions(project: dict[str, object]) -> dict[str, str]:
    """Lower bounds of the dependencies of a ``[project]`` table, by name.

    >>> oldest_versions({"dependencies": ["numpy>=1.26", "rich[all]>=13,<99"], "optional-dependencies": {}})
    {'numpy': '1.26', 'rich': '13'}
    """
    extras = project["optional-dependencies"].values()
    requirements = [*project["dependencies"], *(line for extra in extras for line in extra)]
    return {found[1]: found[2] for line in requirements if (found := re.match(r"([\w.-]+)(?:\[.*\])?>=([\w.]+)", line))}


if __name__ == "__main__":
    import tomllib  # since Python 3.11

    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for name, version in oldest_versions(pyproject["project"]).items():
        print(f"{name}=={version}")
