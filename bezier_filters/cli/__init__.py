"""The command `bezier-filters`."""

import sys


def main() -> None:
    """Run it in a child process; bad input ends it with one line and exit status 2, also where a library crashes."""
    from bezier_filters.runtime.supervision import run_supervised

    code = "from bezier_filters.cli.commands import serve_command_line; serve_command_line()"
    status, reason = run_supervised(code, *sys.argv[1:])
    if reason:
        print(f"bezier-filters: {reason}", file=sys.stderr)
    raise SystemExit(status)
