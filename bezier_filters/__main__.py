"""``python -m bezier_filters`` is the command line."""

from bezier_filters.cli import main

if __name__ == "__main__":
    main()
