import threading
from time import sleep

import numpy as np
import pytest
import scipy.linalg  # noqa: F401  (its BLAS counts among the libraries whose threads are limited)
import threadpoolctl

from bezier_filters import CancelledError, InvalidParameterError, estimate_vertex_geometry
from bezier_filters.runtime.parallel import (
    MAX_HELPER_THREADS,
    run_in_chunks,
    single_threaded_blas,
    thread_count,
    use_threads,
)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("total", [0, 1, 9, 10, 11, 1000])
def test_every_index_is_covered_once(threads, total):
    counts = np.zeros(total, dtype=int)

    def task(start, stop):
        counts[start:stop] += 1

    reports = []
    with use_threads(threads):
        run_in_chunks(lambda: task, total, progress=lambda *a: reports.append(a), chunk=10)
    assert (counts == 1).all()
    assert all(of == total for _, of in reports)
    if total:
        assert reports[-1] == (total, total)


def test_tasks_may_run_loops_of_their_own():
    """More of them at a time than there are threads to help: nobody waits for those who wait."""
    sums = np.zeros((600, 20), dtype=int)

    def outer(start, stop):
        def inner(first, last):
            sums[start:stop, first:last] += 1

        with use_threads(3):
            run_in_chunks(lambda: inner, 20, chunk=1)

    with use_threads(2 * MAX_HELPER_THREADS):
        run_in_chunks(lambda: outer, 600, chunk=1)
    assert (sums == 1).all()


def test_each_thread_gets_a_task_of_its_own():
    owners = {}

    def make_task():
        key = object()

        def task(start, stop):
            owners.setdefault(key, set()).add(threading.get_ident())

        return task

    with use_threads(4):
        run_in_chunks(make_task, 1000, chunk=1)
    assert len(owners) <= 4


def test_progress_that_cannot_be_called_is_refused():
    with pytest.raises(InvalidParameterError, match="progress: got 3, expected a function"):
        estimate_vertex_geometry(np.eye(3), [[0, 1, 2]], progress=3)


@pytest.mark.parametrize("threads", [1, 3])
def test_cancelling_stops_early(threads):
    done = []

    def task(start, stop):
        done.append(start)
        sleep(0.001)  # lets other threads run, as the kernels do

    with pytest.raises(CancelledError), use_threads(threads):
        run_in_chunks(lambda: task, 10_000, progress=lambda *_: False, chunk=1)
    assert len(done) < 100


@pytest.mark.parametrize("threads", [1, 3])
def test_errors_stop_early(threads):
    done = []

    def task(start, stop):
        done.append(start)
        sleep(0.001)
        if start == 5:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), use_threads(threads):
        run_in_chunks(lambda: task, 10_000, chunk=1)
    assert len(done) < 100


@pytest.mark.parametrize("threads", [1, 3])
def test_errors_of_a_task_reach_the_caller(threads):
    def task(start, stop):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), use_threads(threads):
        run_in_chunks(lambda: task, 100, chunk=1)


def blas_threads():
    return {pool["num_threads"] for pool in threadpoolctl.threadpool_info() if pool["user_api"] == "blas"}


def test_blas_works_on_one_thread_until_the_last_of_several_calls_has_ended():
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        first, second = single_threaded_blas(), single_threaded_blas()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert blas_threads() == {1}
        second.__exit__(None, None, None)
        assert blas_threads() == {2}


def test_blas_has_its_threads_back_after_an_error():
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        with pytest.raises(ZeroDivisionError), single_threaded_blas():
            raise ZeroDivisionError
        assert blas_threads() == {2}


def test_threads_are_those_of_the_block_around_and_one_in_tasks_side_by_side(monkeypatch):
    monkeypatch.setenv("BEZIER_FILTERS_THREADS", "7")
    seen, barrier = [thread_count()], threading.Barrier(2)

    def task(start, stop):
        barrier.wait(timeout=60)  # each of the two threads has one of the two chunks
        with use_threads():
            seen.append(thread_count())

    with use_threads():
        seen.append(thread_count())
        with use_threads(2):
            run_in_chunks(lambda: task, 2, chunk=1)
            run_in_chunks(lambda: lambda start, stop: seen.append(thread_count()), 1)  # a single one may use both
        seen.append(thread_count())
    assert seen == [1, 7, 1, 1, 2, 7]
    with pytest.raises(InvalidParameterError, match="threads: got 0"), use_threads(0):
        pass


def test_an_interrupt_while_work_is_handed_out_waits_for_what_has_begun():
    """And no thread begins another chunk: none is at work in arrays that nobody has any more."""
    begun, ended, made = [], [], []

    def make_task():
        made.append(1)
        if len(made) == 3:  # of the threads beside, one has its task
            while not begun:
                sleep(0.001)
            raise KeyboardInterrupt

        def task(start, stop):
            begun.append(start)
            sleep(0.05)
            ended.append(start)

        return task

    with use_threads(4), pytest.raises(KeyboardInterrupt):
        run_in_chunks(make_task, 10_000, chunk=10)
    assert sorted(begun) == sorted(ended)
    assert 0 < len(begun) <= 2
    sleep(0.15)
    assert len(begun) <= 2
