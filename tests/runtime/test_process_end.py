"""Processes end when they are asked to, whatever they run, and with the process that started them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bezier_filters.runtime.process_end import GRACE_SECONDS, REPEAT_SECONDS

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name != "posix", reason="signals")]

# Compiled code that runs for a minute, while the interpreter is free for other threads, or is not.
LONG = {
    "other threads go on": "hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)",
    "nothing goes on": "sum(itertools.repeat(1, 10**11))",
}
SUPERVISED = '''
from bezier_filters.runtime.supervision import run_supervised
code = """
import hashlib, itertools, os, sys
from pathlib import Path
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.supervision import serve
def work():
    with atomic_write("result.ply") as path:
        path.write_text("half")
        Path("pid").write_text(str(os.getpid()))
        {work}
    return ""
serve(work)
"""
print(run_supervised(code))
'''


def start(code, folder, **options):
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=folder, stdout=subprocess.PIPE, encoding="utf-8", **options
    )
    wait_for((folder / "pid").exists)
    wait_for((folder / "pid").read_text)
    return process, int((folder / "pid").read_text())


def wait_for(happened, patience=30.0):
    end = time.monotonic() + patience
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.01)


def has_ended(process):
    """Whether a process that is no child of this one has ended, or is a zombie that nobody waits for here."""
    try:
        os.kill(process, 0)
        status = Path(f"/proc/{process}/stat")
        return status.exists() and status.read_text().rpartition(")")[2].split()[0] == "Z"
    except ProcessLookupError:  # of both: it may end between them
        return True


@pytest.mark.parametrize(("work", "number"), list(zip(LONG.values(), [2, 15], strict=True)), ids=LONG)
def test_one_signal_ends_compiled_code_after_three_seconds(work, number, tmp_path):
    process, child = start(SUPERVISED.replace("{work}", work), tmp_path)
    begin = time.monotonic()
    process.send_signal(number)
    assert process.communicate(timeout=30)[0].strip() == f"({128 + number}, '')"
    assert GRACE_SECONDS - 0.5 < time.monotonic() - begin < GRACE_SECONDS + 5.0
    assert has_ended(child)
    if work == LONG["other threads go on"]:
        assert [path.name for path in tmp_path.iterdir()] == ["pid"]  # and what it was writing is removed


@pytest.mark.parametrize("work", LONG.values(), ids=LONG)
def test_a_second_signal_ends_compiled_code_at_once(work, tmp_path):
    process, child = start(SUPERVISED.replace("{work}", work), tmp_path)
    begin = time.monotonic()
    process.send_signal(signal.SIGINT)
    time.sleep(2.0 * REPEAT_SECONDS)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=30)[0].strip() == "(130, '')"
    assert time.monotonic() - begin < GRACE_SECONDS - 0.5
    assert has_ended(child)


def test_a_signal_that_comes_twice_at_once_counts_once(tmp_path):
    """As of `timeout`, which tells its child and then the whole group of processes."""
    slow = "try: __import__('time').sleep(60)\n        finally: __import__('time').sleep(1.5); Path('end').touch()"
    process, _ = start(SUPERVISED.replace("{work}", slow), tmp_path)
    for _ in range(3):
        process.send_signal(signal.SIGTERM)
    assert process.communicate(timeout=30)[0].strip() == "(143, '')"
    assert (tmp_path / "end").exists()


def test_what_ignores_a_signal_goes_on(tmp_path):
    """As nohup has it."""
    work = "__import__('time').sleep(4.5)"
    ignore = f"import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n{SUPERVISED.replace('{work}', work)}"
    process, _ = start(ignore, tmp_path)
    process.send_signal(signal.SIGHUP)
    assert process.communicate(timeout=30)[0].strip() == "(0, '')"
    assert (tmp_path / "result.ply").read_text() == "half"


def test_compiled_code_ends_when_its_parent_is_killed(tmp_path):
    process, child = start(SUPERVISED.replace("{work}", LONG["other threads go on"]), tmp_path)
    process.kill()
    wait_for(lambda: has_ended(child))
    process.communicate()
    assert [path.name for path in tmp_path.iterdir()] == ["pid"]


def test_a_command_of_ours_ends_with_the_process_that_started_it(tmp_path):
    """`watch`, and Dask's workers, start whole commands."""
    command = f"""
import subprocess, sys
from bezier_filters.runtime.process_end import child_environment
subprocess.run([sys.executable, "-c", {SUPERVISED.replace("{work}", LONG["other threads go on"])!r}],
    env=child_environment())
"""
    process, child = start(command, tmp_path)
    process.kill()
    wait_for(lambda: has_ended(child))
    process.communicate()


WORKERS = """
import hashlib, os
from pathlib import Path
def work(folder):
    from bezier_filters.runtime.atomic import atomic_write
    with atomic_write(f"{folder}/result.ply") as path:
        path.write_text("half")
        Path(f"{folder}/pid").write_text(str(os.getpid()))
        hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)
if __name__ == "__main__":
    START
"""
STARTS = {
    "batch": """
    from bezier_filters.runtime.worker_processes import run_in_processes
    list(run_in_processes(work, [os.getcwd()], processes=1))""",
    "dask processes": """
    from bezier_filters.scale.scheduling import run_tasks
    list(run_tasks("processes", work, [os.getcwd()], workers=2))""",
}


@pytest.mark.parametrize("how", STARTS)
def test_workers_end_with_their_parent(how, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(WORKERS.replace("START", STARTS[how].strip()))
    process = subprocess.Popen([sys.executable, script], cwd=tmp_path, stderr=subprocess.DEVNULL)
    wait_for(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
    workers = children_of(process.pid)
    process.kill()
    process.wait()
    wait_for(lambda: all(map(has_ended, workers)))


def children_of(process):
    """Processes that a process has started, without those of its own machinery that end with its pipes."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, encoding="utf-8", check=True).stdout
    return [int(pid) for pid, parent in map(str.split, listed.splitlines()) if int(parent) == process]


def test_workers_in_compiled_code_do_not_hold_up_an_interrupt(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(WORKERS.replace("START", STARTS["batch"].strip()))
    process = subprocess.Popen([sys.executable, script], cwd=tmp_path, stderr=subprocess.DEVNULL)
    wait_for(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
    begin = time.monotonic()
    process.send_signal(signal.SIGINT)
    process.wait(timeout=30)
    assert time.monotonic() - begin < GRACE_SECONDS
    assert {path.name for path in tmp_path.iterdir()} <= {"pid", "script.py", "__pycache__"}
