"""Threads of Python may come and go, and processes may be forked meanwhile, whatever holds a lock at that moment."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDERS = [str(Path(__file__).parents[1] / "helpers"), str(Path(__file__).parents[2])]
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")

LIMITS = """
import threading
import numpy, scipy.linalg
from bezier_filters.runtime.parallel import single_threaded_blas
from threadpoolctl import threadpool_info
def counts():
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
def within():
    with single_threaded_blas():
        seen.append(counts())
seen = []
within()
thread = threading.Thread(target=within)
thread.start()
thread.join()
# the first of two calls, which set the limit, ends before the other one
entered, leave = threading.Event(), threading.Event()
def first():
    with single_threaded_blas():
        entered.set()
        leave.wait()
thread = threading.Thread(target=first)
thread.start()
entered.wait()
with single_threaded_blas():
    leave.set()
    thread.join()
    seen.append(counts())
print(set(sum(seen, [])), set(counts()))
"""

LOCKS = """
import faulthandler, os, threading, time
import numpy as np
from bezier_filters.runtime import parallel
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.jit import short_jit
class Slow:
    @cached_property
    def value(self):
        time.sleep(0.3)
        return 1
def limit():
    with parallel._lock:
        time.sleep(0.3)
def limit_again():
    with parallel.single_threaded_blas():
        pass
def compile_function():
    @short_jit()
    def double(x):
        total = x
        for k in range(100):
            total += np.sqrt(k * x) + np.exp(x)
        return total
    assert double(2.0) > 2.0
for holds, needs in [(lambda: Slow().value, lambda: Slow().value), (limit, limit_again), (compile_function,) * 2]:
    thread = threading.Thread(target=holds)
    thread.start()
    time.sleep(0.1)
    child = os.fork()
    if not child:
        faulthandler.dump_traceback_later(20, exit=True)
        needs()
        os._exit(0)
    thread.join()
    assert os.waitpid(child, 0)[1] == 0
"""

FILTERS = """
import faulthandler, os, sys, threading, time
sys.path[:0] = {folders!r}
from full_meshset import full_meshset, punched_torus
from bezier_filters import fill_holes
from bezier_filters.meshlab.scripts import FILTERS
def work(ms):
    fill_holes(*punched_torus(12), threads=2)
    for rings in (2, 3):
        FILTERS[3](ms, rings=rings, alpha=0.8, threads=1)
meshsets = [full_meshset() for _ in range(3)]  # which pymeshlab itself cannot make in several threads
work(meshsets[0])
stop = threading.Event()
def run(ms):
    while not stop.is_set():
        work(ms)
threads = [threading.Thread(target=run, args=[ms]) for ms in meshsets[1:]]
for thread in threads:
    thread.start()
children = []
for _ in range(6):
    time.sleep(0.05)
    children.append(os.fork())
    if not children[-1]:
        faulthandler.dump_traceback_later(60, exit=True)
        work(meshsets[0])
        os._exit(0)
stop.set()
for thread in threads:
    thread.join()
assert [os.waitpid(child, 0)[1] for child in children] == [0] * len(children)
"""


def run(code):
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "2"}
    command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=100, check=False)


def test_the_limit_of_blas_holds_in_every_thread_and_ends_with_the_last_call():
    done = run(LIMITS)
    assert done.stdout == "{1} {2}\n", done.stderr


def test_children_do_not_wait_for_locks_of_other_threads():
    done = run(LOCKS)
    assert done.returncode == 0, done.stderr


def test_children_of_a_process_whose_threads_run_filters_end():
    done = run(FILTERS.format(folders=FOLDERS))
    assert done.returncode == 0, done.stderr
