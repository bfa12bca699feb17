"""The command line in this process: what the process that it starts does, without the seconds that imports take."""

import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from subprocess import CompletedProcess
from unittest.mock import patch

from bezier_filters.cli.commands import _run
from bezier_filters.runtime.supervision import EXIT_FAILED
from bezier_filters.runtime.worker_processes import Outcome


def run(*arguments):
    """Run a command: its exit status, and what it prints."""
    code, reason = 0, ""
    out, err = StringIO(), StringIO()
    with (
        patch.object(sys, "argv", ["bezier-filters", *map(str, arguments)]),
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        try:
            reason = _run()
        except SystemExit as end:
            code = end.code
    if reason:
        code = EXIT_FAILED
        err.write(f"bezier-filters: {reason}\n")
    return CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def in_this_process(function, jobs, **_):
    """What `worker_processes.run_in_processes` does, but for its processes, which take seconds to start."""
    for index, job in enumerate(jobs):
        try:
            outcome = Outcome(function(job), "", 0.0)
        except Exception as error:
            outcome = Outcome(None, str(error), 0.0)
        yield index, outcome
