"""The filters as methods of MeshSet."""

import inspect
import subprocess
import sys

import pymeshlab
import pytest

from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.registration import FILTERS, register


class TestRegistration:
    @pytest.fixture(autouse=True)
    def registered(self):
        register()
        yield
        for function in FILTERS:
            delattr(pymeshlab.MeshSet, function.__name__)

    def test_methods_have_signature_and_docstring(self):
        for function in FILTERS:
            method = getattr(pymeshlab.MeshSet(), function.__name__)
            assert "alpha" in inspect.signature(method).parameters
            assert "ms" not in inspect.signature(method).parameters
            assert method.__doc__ == function.__doc__

    def test_methods_work(self):
        ms = pymeshlab.MeshSet()
        ms.create_sphere(radius=2.0, subdiv=3)
        assert ms.compute_curvature_by_bezier_patch_per_vertex(quality="max")["quality"] == "max"

    def test_registering_twice_changes_nothing(self):
        before = {function.__name__: getattr(pymeshlab.MeshSet, function.__name__) for function in FILTERS}
        register()
        assert before == {name: getattr(pymeshlab.MeshSet, name) for name in before}

    def test_a_foreign_attribute_is_not_overwritten(self, monkeypatch):
        name = FILTERS[1].__name__
        monkeypatch.setattr(pymeshlab.MeshSet, name, print)
        with pytest.raises(BezierFilterError, match=name):
            register()
        assert getattr(pymeshlab.MeshSet, name) is print


def test_importing_registers_nothing():
    code = "import pymeshlab, bezier_filters.meshlab.registration; print(hasattr(pymeshlab.MeshSet, {!r}))"
    command = [sys.executable, "-c", code.format(FILTERS[0].__name__)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "False\n"
