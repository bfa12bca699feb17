"""The command `bezier-filters`."""


def main() -> None:
    """Run it, with the arguments of this process."""
    from bezier_filters.cli.commands import main as run

    run()
