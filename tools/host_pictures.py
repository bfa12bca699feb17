"""Takes the first picture of a scan in every host, each really installed: python tools/host_pictures.py SCAN.OBJ.

Every host gets an environment of its own in a folder, with this source and its adapters as documented, and runs its
script of `tools/hosts` on a display that nobody sees. Pictures are made smaller for docs/adapters.md.
"""

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
ADAPTERS = ROOT / "adapters"
WIDTH = 560  # pixels
COLORS = 256  # of a picture: it has fewer than 60 kB then


@dataclass(frozen=True)
class Host:
    """What a host needs: a Python, packages beside this one, and what runs its script, if not that Python."""

    python: str
    packages: tuple[str, ...]
    program: str = ""
    folders: tuple[str, ...] = ()  # for Python to look in


HOSTS = {
    "pyvista": Host("python3", (f"{ADAPTERS}[pyvista]", "matplotlib")),
    "napari": Host("python3", (f"{ADAPTERS}[napari]", "pyqt6")),
    "paraview": Host("python3.11", (str(ADAPTERS),), program="pvpython"),  # the Python of Debian 12
    "blender": Host("python3.13", (str(ADAPTERS), "bpy>=5.1"), folders=(str(ADAPTERS),)),  # the Python of bpy
}


def install(host: Host, folder: Path) -> None:
    """Make the environment of a host again from nothing."""
    subprocess.run([host.python, "-m", "venv", "--clear", folder], check=True)
    subprocess.run([folder / "bin/python", "-m", "pip", "install", "--quiet", ROOT, *host.packages], check=True)


def take(name: str, scan: Path, folder: Path, picture: Path) -> None:
    """Run the script of a host."""
    host = HOSTS[name]
    (packages,) = folder.glob("lib/python3*/site-packages")
    paths = [str(packages)] if host.program else list(host.folders)
    program = host.program or str(folder / "bin/python")
    script = ROOT / "tools" / "hosts" / f"{name}_picture.py"
    command = ["xvfb-run", "-a", "-s", "-screen 0 1280x800x24", program, str(script), str(scan), str(picture)]
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "QT_"))}
    subprocess.run(command, env=environment | {"PYTHONPATH": os.pathsep.join(paths)}, check=True)


def shrink(picture: Path, target: Path) -> None:
    """Write a small PNG."""
    with Image.open(picture) as image:
        small = image.convert("RGB").resize(
            (WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS
        )
    small.quantize(COLORS, Image.Quantize.MAXCOVERAGE).save(target, optimize=True)


def main() -> None:
    """Take the pictures of some hosts, or of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scan", type=Path)
    parser.add_argument("--hosts", nargs="+", choices=HOSTS, default=list(HOSTS))
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "hosts")
    parser.add_argument("--keep", action="store_true", help="use the environments that are there")
    arguments = parser.parse_args()
    for name in arguments.hosts:
        folder = arguments.folder.resolve() / name
        if not (arguments.keep and folder.is_dir()):
            install(HOSTS[name], folder)
        picture = folder / "picture.png"
        take(name, arguments.scan.resolve(), folder, picture)
        target = ROOT / "docs" / "images" / f"host_{name}.png"
        shrink(picture, target)
        print(f"{target.relative_to(ROOT)}: {target.stat().st_size:,} bytes", file=sys.stderr)


if __name__ == "__main__":
    main()
