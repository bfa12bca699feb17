"""Rules that hold for all compiled functions of the package."""

import importlib
import pkgutil

import pytest
from numba.core.dispatcher import Dispatcher

import bezier_filters
from bezier_filters.runtime.jit import inner_jit, jit


def compiled_functions():
    for module in pkgutil.walk_packages(bezier_filters.__path__, "bezier_filters."):
        if not module.name.endswith("__main__"):
            for value in vars(importlib.import_module(module.name)).values():
                if isinstance(value, Dispatcher) and value.py_func.__module__ == module.name:
                    yield value


def separate_callees(function):
    """Compiled functions that a function, or one inlined in it, calls, and that are not inlined."""
    namespace, found = function.py_func.__globals__, []
    for callee in map(namespace.get, function.py_func.__code__.co_names):
        if isinstance(callee, Dispatcher):
            is_inlined = callee.targetoptions.get("inline") == "always"
            found += separate_callees(callee) if is_inlined else [callee]
    return found


@pytest.mark.skipif(not any(True for _ in compiled_functions()), reason="the compiler is disabled")
def test_functions_that_may_reorder_sums_call_none_that_are_not_inlined():
    """The compiler sees these in one process and not in another, and orders the sums around the call differently."""
    reordering = [function for function in compiled_functions() if function.targetoptions.get("fastmath")]
    assert len(reordering) > 10
    assert {one.py_func.__name__: separate_callees(one) for one in reordering if separate_callees(one)} == {}


@inner_jit()
def _callee(x: float) -> float:
    return x


@jit(fastmath=True)
def _caller(x: float) -> float:
    return _callee(x)


def test_a_call_that_is_not_inlined_is_found():
    assert separate_callees(_caller) == [_callee]
