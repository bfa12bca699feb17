"""What ends the process of the work: the process that waits says so in plain words."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bezier_filters.cli.batch import RECORDS
from bezier_filters.runtime.supervision import (
    MIN_READ_BYTES,
    child_exit,
    crash_message,
    hold_interrupts,
    limit_memory,
    limit_time,
    note_activity,
)

SAMPLES = Path(__file__).parents[2] / "sample_meshes"
MODULE = [sys.executable, "-m", "bezier_filters"]
posix = pytest.mark.skipif(os.name != "posix", reason="signals")
linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts the memory of a process")


def in_python(code, **options):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", **options)


WORK = """
import os, signal, sys
from bezier_filters.runtime.supervision import note_activity, limit_time, serve
def work():
    {work}
    return ""
serve(work)
"""


def supervised(work, *arguments):
    """Code that runs the lines of a function in a child process, and prints what became of it."""
    given = (WORK.format(work=work), *arguments)
    return f"from bezier_filters.runtime.supervision import run_supervised; print(run_supervised(*{given!r}))"


@posix
@pytest.mark.parametrize(
    ("work", "printed"),
    [
        ("pass", "(0, '')"),
        ("return 'radius: got -1'", "(2, 'radius: got -1')"),
        ("sys.exit(3)", "(3, '')"),
        ("sys.exit('no')", "(1, '')"),
        ("raise KeyError", "(1, '')"),
        ("raise KeyboardInterrupt", "(130, '')"),
        ("os.kill(os.getpid(), signal.SIGTERM)", "(143, '')"),
        ("os.kill(os.getppid(), signal.SIGINT); signal.pause()", "(130, '')"),
        (
            "with note_activity('reading a.obj'): signal.raise_signal(signal.SIGSEGV)",
            f"(2, {crash_message(-signal.SIGSEGV, 'reading a.obj')!r})",
        ),
        ("os.kill(os.getpid(), signal.SIGKILL)", f"(2, {crash_message(-signal.SIGKILL)!r})"),
        (
            "with note_activity('reading a.3ds'), limit_time(0.05):\n        while True: pass",
            f"(2, {crash_message(-signal.SIGPROF, 'reading a.3ds')!r})",
        ),
        (
            "with note_activity('reading a.obj'), limit_time(0.05): os.read(os.pipe()[0], 1)",
            f"(2, {crash_message(-signal.SIGALRM, 'reading a.obj')!r})",
        ),
        ("with limit_time(0.05): pass\n    sum(range(10**7))", "(0, '')"),
        ("os.abort()", f"(2, {crash_message(-signal.SIGABRT)!r})"),
    ],
)
def test_every_end_has_a_status_and_a_reason(work, printed):
    result = in_python(supervised(work))
    assert result.returncode == 0
    assert result.stdout.strip() == printed
    assert ("KeyError" in result.stderr) == ("KeyError" in work)


@posix
def test_a_second_interrupt_does_not_disturb_the_end():
    work = """
    import time
    try:
        os.kill(os.getpid(), signal.SIGINT)
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            os.kill(os.getpid(), number)
        print("cleaned up", flush=True)"""
    assert in_python(supervised(work)).stdout.split("\n")[:2] == ["cleaned up", "(130, '')"]


@posix
def test_an_interrupt_between_two_processes_is_not_lost():
    """It comes when there is a second process already, and the first does not wait for it yet."""
    interrupting = """
import os, signal, subprocess
start = subprocess.Popen
def start_and_interrupt(*arguments, **options):
    child = start(*arguments, **options)
    os.kill(os.getpid(), signal.SIGINT)
    return child
subprocess.Popen = start_and_interrupt
"""
    result = in_python(interrupting + supervised("import time; time.sleep(60)"))
    assert result.stdout.strip() == "(130, '')", result.stderr


@posix
def test_the_work_ends_when_its_parent_is_killed(tmp_path):
    work = f"""
    import time
    try:
        open({str(tmp_path / "pid")!r}, "w").close()
        time.sleep(60)
    finally:
        open({str(tmp_path / "cleaned")!r}, "w").close()"""
    process = subprocess.Popen([sys.executable, "-c", supervised(work)])
    wait_for((tmp_path / "pid").exists)
    process.kill()
    process.wait()
    wait_for((tmp_path / "cleaned").exists)


def wait_for(happened, patience=60.0):
    end = time.monotonic() + patience
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.01)


@posix
def test_an_interrupt_before_the_work_has_begun_ends_it_in_silence():
    """A terminal sends it to the child as well, whose interpreter may just be starting."""
    interrupting = """
import os, signal, subprocess
start = subprocess.Popen
def start_and_interrupt(*arguments, **options):
    child = start(*arguments, **options)
    child.send_signal(signal.SIGINT)
    return child
subprocess.Popen = start_and_interrupt
"""
    result = in_python(interrupting + supervised("import time; time.sleep(60)"))
    assert (result.stdout.strip(), result.stderr) == ("(130, '')", "")


def test_the_child_has_the_modules_and_arguments_of_its_parent(tmp_path):
    """And not those of the folder that the user is in."""
    (tmp_path / "json.py").write_text("raise SystemExit('wrong module')")
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "only_here.py").touch()
    work = "import json, only_here; return ' '.join(sys.argv[1:])"
    code = f"import sys; sys.path[0] = {str(tmp_path / 'here')!r}; {supervised(work, 'a b', '-c')}"
    result = in_python(code, cwd=tmp_path)
    assert result.stdout.strip() == "(2, 'a b -c')", result.stderr


@posix
def test_notes_of_any_number_and_what_children_of_the_child_hold_do_not_matter():
    """More than a pipe holds, and a process that lives on."""
    work = """
    import subprocess
    for number in range(20000):
        with note_activity(f"reading {number}.ply"):
            pass
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(30)"], stdout=subprocess.DEVNULL,
                     stderr=subprocess.DEVNULL)
    return "done\\nat last" """
    begin = time.monotonic()
    assert in_python(supervised(work)).stdout.strip() == "(2, 'done\\nat last')"
    assert time.monotonic() - begin < 20


def test_messages_name_what_was_done():
    assert "while reading a.ply: the file is damaged" in crash_message(-signal.SIGABRT, "reading a.ply")
    assert "see whether the disk is full" in crash_message(-signal.SIGABRT, "writing a.3mf")
    assert "nothing was written" in crash_message(-signal.SIGSEGV)
    if os.name == "posix":
        assert "want of memory" in crash_message(-signal.SIGKILL, "reading a.ply")


@pytest.mark.parametrize(
    ("status", "notes", "end"),
    [
        (0, b"", (0, "")),
        (2, b"reading a.ply\0\0cannot read\0", (2, "cannot read")),
        (2, b"", (2, "")),  # the command line has said why
        (1, b"\0", (1, "")),
        (-signal.SIGTERM, b"reading a.ply\0", (128 + signal.SIGTERM, "")),
        (0xC0000005, b"reading a.ply\0\0read", (2, crash_message(0xC0000005))),
        (0xC0000005, b"reading a.ply\0", (2, crash_message(0xC0000005, "reading a.ply"))),
    ],
)
def test_ends_on_every_system(status, notes, end):
    assert child_exit(status, notes) == end


def test_the_process_that_waits_loads_nothing_else():
    code = "import sys, bezier_filters.cli, bezier_filters.runtime.supervision; print(*sys.modules)"
    assert not {"numpy", "typer", "rich", "numba"} & set(in_python(code).stdout.split())


def test_what_nobody_waits_for_is_not_limited():
    with note_activity("reading"), limit_time(1e-9):  # nobody would say how this process ended
        sum(range(10**5))


BROKEN = {
    "an_index_out_of_range.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999\n",
    "a_negative_index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -99999999\n",
    "an_index_out_of_range.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99999999\n",
}


@posix
@pytest.mark.parametrize("name", list(BROKEN)[:1])
def test_a_reader_that_crashes_is_reported_in_one_line(tmp_path, name):
    """pymeshlab follows these indices out of its memory."""
    (tmp_path / name).write_bytes(BROKEN[name])
    (tmp_path / "out.ply").write_bytes(b"old")
    command = [*MODULE, "curvature", name, "out.ply"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8")
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.startswith("bezier-filters: c")
    assert result.stderr.count("\n") == 1
    assert name in result.stderr
    assert (tmp_path / "out.ply").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "out.ply"])


@posix
@pytest.mark.slow
def test_a_batch_goes_on_after_crashes(tmp_path):
    for number, content in enumerate(BROKEN.values()):
        (tmp_path / f"broken{number}{list(BROKEN)[number][-4:]}").write_bytes(content)
    (tmp_path / "whole.ply").write_bytes((SAMPLES / "torus.ply").read_bytes())
    command = [*MODULE, "batch", "torsion", "*.o*", "whole.ply", "--out", "out", "--suffix", ".off"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8")
    assert result.returncode == 1
    assert "torsion: 1 done, 0 skipped, 3 failed" in result.stdout
    assert result.stdout.count("its reader does not notice") == len(BROKEN)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {RECORDS, "whole.off"}


class TestInterruptsHeld:
    def test_an_interrupt_waits_for_the_end_of_the_block(self):
        done = []

        @hold_interrupts()
        def step():
            signal.raise_signal(signal.SIGINT)
            with hold_interrupts():
                signal.raise_signal(signal.SIGINT)
                done.append("inner")
            done.append("outer")

        with pytest.raises(KeyboardInterrupt):
            step()
        assert done == ["inner", "outer"]
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def test_an_error_goes_through(self):
        with pytest.raises(ValueError, match="mine"), hold_interrupts():
            raise ValueError("mine")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    @posix
    def test_other_signals_with_handlers_wait_too(self):
        arrived = []
        before = signal.signal(signal.SIGUSR1, lambda *_: arrived.append("late"))
        try:
            with hold_interrupts():
                signal.raise_signal(signal.SIGUSR1)
                arrived.append("done")
        finally:
            signal.signal(signal.SIGUSR1, before)
        assert arrived == ["done", "late"]


@linux
def test_memory_beyond_what_a_file_can_need_is_refused():
    code = f"""
import numpy as np
from bezier_filters.runtime.supervision import limit_memory
with limit_memory(1000):
    np.empty({MIN_READ_BYTES // 16})
    try:
        np.empty({MIN_READ_BYTES // 4})
    except MemoryError:
        print("refused")
np.empty({MIN_READ_BYTES // 4})
"""
    assert in_python(code).stdout == "refused\n"


def test_without_limits_of_the_system_nothing_is_refused(monkeypatch):
    monkeypatch.setattr("bezier_filters.runtime.supervision.resource", None)
    with limit_memory(0):
        assert np.zeros(10).sum() == 0
