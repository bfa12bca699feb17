"""The paper's fill: one bicubic Bezier patch over the plane of the hole (Li, Barsky, Jin, IEEE SMI 2009).

The influence area around the hole has a frame of its own; the patch is fitted to it, the polygon of the rim is
triangulated in the parameter plane, and its vertices are lifted to the patch. The correction that makes it pass
through the rim is harmonic: see docs/decisions/2026-11-21-border-correction.md.
"""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.holes.fill_topology import Fill
from bezier_filters.holes.flat_fill import flat_fill
from bezier_filters.holes.loop_geometry import plane_axes
from bezier_filters.holes.surroundings import Surroundings
from bezier_filters.holes.variational_fill import shifted
from bezier_filters.patches.fitting import PatchFit, fit_patch

INFLUENCE = 2
"""Rings around the hole that the patch is fitted to; with too few points, all that are at hand."""
PLENTY = 32
"""Points: twice as many as control points."""


def paper_fill(around: Surroundings, alpha: float) -> Fill | str:
    """Fill a hole in the paper's way.

    Parameters
    ----------
    around : Surroundings
        Some rings around the hole.
    alpha : float
        Weight of the points against the smoothness of the patch, in (0, 1].

    Returns
    -------
    Fill or str
        Or why it is not possible.
    """
    if len(around.loops) > 1 or len(around.loops[0]) > around.rim_count:
        return "there is an island in the hole"
    area = np.flatnonzero(around.rings <= INFLUENCE)
    area = area if len(area) >= PLENTY else np.arange(len(around.ids))
    frame = _frame(around)
    if frame is None:
        return "the surroundings have no mean normal"
    origin, axes = frame
    fill = flat_fill(around, origin, axes)
    if isinstance(fill, str):
        return fill
    try:
        patch = fit_patch(around.vertices[area], origin, axes, PatchFit(3, alpha, "paper"))
    except InvalidParameterError as error:
        return str(error)
    lifted = patch.evaluate(*patch.rectangle.parameters(fill.points[:, 0], fill.points[:, 1]))
    residual = around.vertices[: around.rim_count] - lifted[: around.rim_count]
    points = lifted + shifted(fill.points, fill.faces, residual)
    points[: around.rim_count] = around.vertices[: around.rim_count]
    return replace(fill, points=points)


def _frame(around: Surroundings) -> tuple[FloatArray, FloatArray] | None:
    """Origin and axes of the influence area: the mean normal of its faces, and x towards a vertex of the rim."""
    origin = around.vertices[: around.rim_count].mean(axis=0)
    near = (around.rings[around.faces] <= INFLUENCE).all(axis=1)
    normal = around.face_normals[near].sum(axis=0)
    if not np.linalg.norm(normal) > 0.1 * np.count_nonzero(near):
        return None
    axes = plane_axes(normal)
    x, y = axes[:2] @ (around.vertices[around.loops[0][0]] - origin)
    length = np.hypot(x, y)
    if not length > 0.0:
        return None
    turn = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, length]]) / length
    return origin, turn @ axes
