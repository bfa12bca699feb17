"""The kernels of an estimate in two parts that take about equally long to compile."""

from contextlib import AbstractContextManager

import numpy as np

from bezier_filters.estimation.fallbacks import QUADRATIC, Attempt, fit_with_fallbacks
from bezier_filters.estimation.vertex_geometry import empty_geometry
from bezier_filters.kernels.fit_kernel import fit_in_lanes
from bezier_filters.kernels.kernel_input import FITTED, KernelMesh, fitted_mesh
from bezier_filters.learning.learn import learn_surface
from bezier_filters.learning.plans import Choices
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.spatial_order import in_spatial_order
from bezier_filters.runtime.compilation import first_compilation
from bezier_filters.status import FitStatus
from bezier_filters.surfaces import sphere


def first_call() -> AbstractContextManager[None]:
    """Around everything that estimates: the first time on a machine, the kernels are compiled."""
    code = f"from {__name__} import {compile_the_rest.__name__} as compile; compile()"
    return first_compilation(fit_in_lanes, compile_fit, code)


def compile_fit() -> None:
    """Compile the fit, which is half of the work, on a vertex without neighbours."""
    rows, nothing = np.zeros(2, np.int32), np.zeros(0, np.int32)
    mesh = KernelMesh(
        vertices=np.zeros((1, 3)),
        faces=np.zeros((0, 3), np.int32),
        face_ptr=rows,
        face_indices=nothing,
        ring_ptr=rows,
        ring_indices=nothing,
        normals=np.array([[0.0, 0.0, 1.0]]),
        safe_cosine=np.zeros(1, np.float32),
        stops=np.zeros(1, np.bool_),
        origin=np.zeros(1, np.int32),
    )
    attempt = Attempt(FitStatus.OK, frozenset({FITTED}), 1, QUADRATIC)
    fit_with_fallbacks(mesh, np.zeros(1, np.int32), [attempt], empty_geometry(1))


def compile_the_rest() -> None:
    """Compile what prepares a mesh and learns from it, on a small sphere."""
    ball = sphere(resolution=8)
    ordered = in_spatial_order(triangle_mesh(ball.vertices, ball.faces))
    learn_surface(*fitted_mesh(ordered.mesh, ordered, creases=True), Choices())
