"""The command `bezier-filters`."""

import signal
import sys


def main() -> None:
    """Run the command in a child process; bad input ends it with one line and exit status 2, even if a library crashes.

    Commands that read no file run without a child, which would take most of the time.
    """
    if sys.argv[1:] == ["--version"]:
        from bezier_filters._version import __version__

        print(f"bezier-filters {__version__}")
        return
    if "--help" in sys.argv:
        from bezier_filters.cli.commands import app

        app(prog_name="bezier-filters")
    from bezier_filters.runtime.supervision import run_supervised

    code = "from bezier_filters.cli.commands import serve_command_line; serve_command_line()"
    status, reason = run_supervised(code, *sys.argv[1:])
    if status == 128 + signal.SIGINT:
        reason = "interrupted; what was written before is whole, and nothing else was changed"
    if reason:
        print(f"bezier-filters: {reason}", file=sys.stderr)
    raise SystemExit(status)
