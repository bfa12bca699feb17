"""Draws the pictures of the documentation: python docs/images/make.py."""

from pathlib import Path
from tempfile import TemporaryDirectory

from bezier_filters.pictures.demo import picture_path, run_demo

FOLDER = Path(__file__).parent


def main() -> None:
    """Draw the bunny of the README."""
    with TemporaryDirectory() as folder:
        for _ in run_demo(Path(folder), size=(300, 300)):
            pass
        (FOLDER / "bunny.png").write_bytes(picture_path(Path(folder)).read_bytes())


if __name__ == "__main__":
    main()
