"""Creases drawn as tubes on their surface."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.feature_lines.crease_lines import COLORS, Creases, edge_mesh
from bezier_filters.pictures.rendering import Panel

SURFACE = (0.85, 0.85, 0.85)
SIDES = 6
"""Of a tube."""


def crease_panel(
    vertices: FloatArray, faces: IntArray, creases: Creases, *, radius: float | None = None, title: str = ""
) -> Panel:
    """A surface with its ridges in red and its ravines in blue, to be drawn by `render_panels`.

    Parameters
    ----------
    vertices, faces : (n, 3) float64, (m, 3) int32
        The surface.
    creases : Creases
        Its lines.
    radius : float, optional
        Of the tubes, a length; by default a 400th of the diagonal of the bounding box.
    title : str
        Text above the picture.
    """
    if radius is None:
        radius = float(np.linalg.norm(np.ptp(vertices, axis=0))) / 400.0
    points, edges, line_of_point = edge_mesh(creases.lines)
    corners, sides = tubes(points[edges[:, 0]], points[edges[:, 1]], radius)
    colors = np.array([SURFACE, *(COLORS[line.kind] for line in creases.lines)])
    color_of = np.concatenate(
        [np.zeros(len(vertices), dtype=np.int32), np.repeat(1 + line_of_point[edges[:, 0]], 2 * SIDES)]
    )
    return Panel(
        np.vstack([vertices, corners]),
        np.vstack([faces, sides + len(vertices)]).astype(np.int32),
        colors=colors[color_of],
        title=title,
    )


def tubes(starts: FloatArray, stops: FloatArray, radius: float) -> tuple[FloatArray, IntArray]:
    """Vertices and faces of open prisms around segments, which reach a little farther than these.

    Examples
    --------
    >>> corners, sides = tubes(np.zeros((1, 3)), np.array([[0.0, 0.0, 2.0]]), 0.1)
    >>> np.linalg.norm(corners[:, :2], axis=1).round(6).max(), len(sides)
    (np.float64(0.1), 12)
    """
    axis = stops - starts
    axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-300)
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    upward = np.cross(axis, across)
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = radius * (
        np.cos(angles)[:, np.newaxis] * across[:, np.newaxis] + np.sin(angles)[:, np.newaxis] * upward[:, np.newaxis]
    )
    ends = np.stack([starts - 0.5 * radius * axis, stops + 0.5 * radius * axis], axis=1)
    corners = (ends[:, :, np.newaxis] + ring[:, np.newaxis]).reshape(-1, 3)
    k = np.arange(SIDES)
    following = (k + 1) % SIDES
    lower = np.stack([k, following, SIDES + k], axis=1)
    upper = np.stack([following, SIDES + following, SIDES + k], axis=1)
    faces = np.vstack([lower, upper]) + 2 * SIDES * np.arange(len(starts))[:, np.newaxis, np.newaxis]
    return corners, faces.reshape(-1, 3).astype(np.int32)
