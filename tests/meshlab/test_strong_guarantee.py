"""A filter that raises, or is cancelled at any moment, leaves the MeshSet byte for byte as it was."""

import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from filter_options import quick_options
from full_meshset import full_meshset
from meshset_state import changed, mesh_state

from bezier_filters.errors import CancelledError
from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.scripts import FILTERS

VERTEX_FILTERS = [  # which write columns
    function
    for function in FILTERS
    if not function.__name__.startswith(("meshing_", "compute_texmap_", "generate_", "get_"))
]
OF_ONE_LAYER = [function for function in FILTERS if "refmesh" not in inspect.signature(function).parameters]
TESTS = Path(__file__).parents[1]


class Stop(Exception):
    pass


def meshset_for(function, runs):
    """A MeshSet on which a filter has run some times."""
    ms = full_meshset()
    for _ in range(runs):
        if function is meshing_close_holes_by_bezier_patch:
            function(ms, maxholesize=7)  # leaves the larger holes
        else:
            function(ms, **quick_options(function))
    return ms


def calls_of_progress(function, runs):
    """How often a filter calls back; with several threads that depends on which one does what."""
    calls = []
    function(meshset_for(function, runs), threads=1, progress=lambda *_: calls.append(1), **quick_options(function))
    return len(calls)


def check_that_stopping_changes_nothing(function, ms, which, answer, options):
    """Stop a filter at one of its callbacks."""
    state, calls = mesh_state(ms), []

    def progress(done, total):
        calls.append(done)
        if len(calls) <= which:
            return None
        if answer is False:
            return False
        raise answer

    with pytest.raises(CancelledError if answer is False else answer):
        function(ms, threads=1, progress=progress, **options)
    assert changed(state, mesh_state(ms)) == set()


@pytest.mark.parametrize("before", [0, 1], ids=["first run", "second run"])
@pytest.mark.parametrize("function", FILTERS)
def test_stopping_at_any_callback_changes_nothing(function, before):
    ms, quick = meshset_for(function, before), quick_options(function)
    total = calls_of_progress(function, before)
    assert total > 0
    for answer in (False, Stop, KeyboardInterrupt):
        check_that_stopping_changes_nothing(function, ms, 0, answer, {})  # while it learns
        check_that_stopping_changes_nothing(function, ms, total - 1, answer, quick)  # after all but writing
    assert function(ms, **quick)  # and it still works


def no_number(ms):
    ms.compute_coord_by_function(x="vi == 7 ? 0/0 : x", y="y", z="z")


def too_large(ms):
    ms.compute_coord_by_function(x="vi == 7 ? 10^50 : x", y="y", z="z")


def too_small(ms):
    ms.compute_coord_by_function(x="x * 10^(-50)", y="y * 10^(-50)", z="z * 10^(-50)")


def nothing_selected(ms):
    ms.set_selection_none(allfaces=True, allverts=True)


def no_vertices(ms):
    ms.compute_selection_by_condition_per_vertex(condselect="1")
    ms.meshing_remove_selected_vertices()


@pytest.mark.parametrize("function", FILTERS)
@pytest.mark.parametrize(
    ("spoil", "options", "message"),
    [
        (no_number, {}, r"vertices: 1 of \d+ have a coordinate that is NaN or infinite; remove them"),
        (too_large, {}, "beyond 1e.40, too large to compute with; remove them, or scale"),
        (too_small, {}, "too small to compute with; scale the mesh"),
        (no_vertices, {}, "is empty; load or create one with vertices"),
        (nothing_selected, {"onselected": True}, "Select vertices or faces first, or pass onselected=False"),
        (None, {"alpha": -1.0}, "alpha: got -1.0, expected"),
        (None, {"threads": 0}, "threads: got 0, expected"),
    ],
)
def test_a_refusal_names_the_remedy_and_changes_nothing(function, spoil, options, message):
    ms = full_meshset()
    if spoil is not None:
        spoil(ms)
    parameters = inspect.signature(function).parameters
    if not options.keys() <= parameters.keys():
        pytest.skip("has no such parameter")
    if "alpha" in options and "method" in parameters:  # smoothing and hole filling have no other use for it
        options = options | {"method": "paper"}
    state = mesh_state(ms)
    with pytest.raises(BezierFilterError, match=message):
        function(ms, **options)
    assert changed(state, mesh_state(ms)) == set()


def written_by(function):
    return function(full_meshset(), **quick_options(function))["attributes"]


@pytest.mark.parametrize("function", [function for function in VERTEX_FILTERS if function in OF_ONE_LAYER])
def test_attributes_in_the_way_are_named_with_the_remedy(function):
    name = written_by(function)[0]
    for spoil, message in [
        (lambda mesh, n: mesh.add_vertex_custom_point_attribute(np.zeros((n, 3)), name), f"point attribute '{name}'"),
        (lambda mesh, n: mesh.add_vertex_custom_scalar_attribute(np.zeros(n), "two words"), "two_words"),
        (lambda mesh, n: mesh.add_vertex_custom_scalar_attribute(np.zeros(n), "1st"), "1st"),
        (lambda mesh, n: mesh.add_vertex_custom_scalar_attribute(np.zeros(n), "x);system('ls"), "x"),
    ]:
        ms = full_meshset(layers=1)
        spoil(ms.current_mesh(), ms.current_mesh().vertex_number())
        known = list(ms.filter_parameter_values("ply"))
        vertices = ms.current_mesh().vertex_matrix().tobytes()
        with pytest.raises(BezierFilterError, match=r"generate_copy_of_current_mesh") as refused:
            function(ms, **quick_options(function))
        assert message in str(refused.value)
        assert list(ms.filter_parameter_values("ply")) == known
        assert ms.current_mesh().vertex_matrix().tobytes() == vertices
        ms.generate_copy_of_current_mesh()  # the remedy
        assert function(ms, **quick_options(function))


@pytest.mark.parametrize("function", VERTEX_FILTERS)
def test_strange_names_that_do_no_harm_stay_and_change_no_result(function):
    plain, ms = full_meshset(), full_meshset()
    values = np.random.default_rng(2).normal(size=ms.current_mesh().vertex_number())
    names = ["x", "vi", "r", "sigma", "plof", "outlierScore"]
    for name in names:
        ms.current_mesh().add_vertex_custom_scalar_attribute(values, name)
    for _ in range(2):
        function(ms, **quick_options(function))
        for name in function(plain, **quick_options(function))["attributes"]:
            results = [mesh.current_mesh().vertex_custom_scalar_attribute_array(name) for mesh in (plain, ms)]
            if name != "bz_normal_angle":  # to the normals of the run before
                np.testing.assert_array_equal(*results)
        for name in names:
            np.testing.assert_array_equal(ms.current_mesh().vertex_custom_scalar_attribute_array(name), values)


@pytest.mark.parametrize("function", VERTEX_FILTERS)
def test_face_attributes_of_our_names_are_another_matter(function):
    ms = full_meshset()
    name = written_by(function)[0]
    values = np.arange(float(ms.current_mesh().face_number()))
    ms.current_mesh().add_face_custom_scalar_attribute(values, name)
    assert name in function(ms, **quick_options(function))["attributes"]
    np.testing.assert_array_equal(ms.current_mesh().face_custom_scalar_attribute_array(name), values)


@pytest.mark.parametrize("function", FILTERS)
def test_no_mesh_at_all(function):
    with pytest.raises(BezierFilterError, match="load one with load_new_mesh"):
        function(pymeshlab.MeshSet())
    with pytest.raises(BezierFilterError, match=r"ms: got ndarray, expected a pymeshlab\.MeshSet"):
        function(np.eye(3))


@pytest.mark.parametrize("function", FILTERS)
def test_moving_the_mesh_meanwhile_is_noticed(function):
    ms = full_meshset()

    def move(done, total):
        ms.compute_coord_by_function(x="x + 1", y="y", z="z")

    with pytest.raises(BezierFilterError, match="changed while the filter ran; nothing was written"):
        function(ms, progress=move, **quick_options(function))
    assert not any("bz_" in key for key in mesh_state(ms))


@pytest.mark.parametrize("function", OF_ONE_LAYER)
def test_other_layers_and_the_transform_stay(function):
    plain, ms = full_meshset(layers=1), full_meshset(layers=4)
    ms.compute_matrix_from_translation(axisx=5.0, freeze=False)
    before = mesh_state(ms)
    quick = quick_options(function)
    report, expected = function(ms, **quick), function(plain, **quick)
    for key in ("status", "holes", "displacement"):
        assert report.get(key) == expected.get(key)
    np.testing.assert_array_equal(ms.current_mesh().vertex_matrix(), plain.current_mesh().vertex_matrix())
    after = mesh_state(ms)
    there = {key.split(":")[0] for key in before}  # the lines of creases are a new layer
    others = {key for key in changed(before, after) if key.split(":")[0] in there - {"0", str(ms.current_mesh_id())}}
    assert others <= {"current"}
    assert after[f"{ms.current_mesh_id()}: transform_matrix"] == before["0: transform_matrix"]


INTERRUPTED = """
import os, signal, sys, threading, time
import numpy as np
sys.path.insert(0, {tests!r})
from full_meshset import full_meshset
from meshset_state import changed, mesh_state
from bezier_filters.meshlab.scripts import FILTERS

function = FILTERS[{number}]
rng = np.random.default_rng({seed})
signal.signal(signal.SIGINT, signal.SIG_IGN)
done = full_meshset()
function(done)
begin = time.perf_counter()
function(full_meshset())
patience = time.perf_counter() - begin
complete, counts = mesh_state(done), dict(untouched=0, complete=0)
for _ in range({times}):
    ms = full_meshset()
    before = mesh_state(ms)
    delay = rng.uniform(0, patience)
    timer = threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer.start()
        function(ms)
        timer.join()
        time.sleep(1)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    after = mesh_state(ms)
    if not changed(before, after):
        counts["untouched"] += 1
    else:
        assert not changed(complete, after), changed(complete, after)
        counts["complete"] += 1
print(counts)
"""


def interrupt(number, times, seed=0):
    code = INTERRUPTED.format(tests=str(TESTS / "helpers"), number=number, times=times, seed=seed)
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8")
    assert result.returncode == 0, result.stderr
    return eval(result.stdout)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_real_interrupt_leaves_the_old_state_or_the_new_one():
    counts = interrupt(2, 12)
    assert counts["untouched"] > 0


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("number", range(len(FILTERS)))
def test_hundreds_of_real_interrupts(number):
    counts = interrupt(number, 300, seed=1)
    assert sum(counts.values()) == 300
    assert counts["untouched"] > 50
