"""Draws the pictures of the documentation: python docs/images/make.py."""

from pathlib import Path
from tempfile import TemporaryDirectory

from bezier_filters.pictures.demo import paths, run_demo

FOLDER = Path(__file__).parent


def main() -> None:
    """Draw the bunny of the quick start."""
    with TemporaryDirectory() as folder:
        for _ in run_demo(Path(folder)):
            pass
        *_, picture = paths(Path(folder))
        (FOLDER / "bunny.png").write_bytes(picture.read_bytes())


if __name__ == "__main__":
    main()
