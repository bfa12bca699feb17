"""Principal directions as short lines on a mesh, where the surface has any that noise does not make."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.feature_lines.crease_lines import COLORS
from bezier_filters.pictures.field_panels import MeshFile
from bezier_filters.pictures.scene import Color, Panel
from bezier_filters.status import FitStatus

NAMES = [("direction of k_max", COLORS["ridge"]), ("direction of k_min", COLORS["ravine"])]
SPACING = 1.0 / 36.0  # of the lines, in diagonals of the bounding box
RADIUS = 1.0 / 700.0  # of the lines, in the same unit
_LENGTH = 0.8  # of a line, in units of the spacing
# Noise alone makes curvatures differ by more standard errors of their mean once in a hundred times: in neighbourhoods
# that are round, half the difference has the distribution of Rayleigh, whose scale is that standard error over root 2.
_ERRORS = 2.0 * float(np.sqrt(np.log(100.0)))
_ROUND = 0.02  # of the larger curvature: where they differ by less, directions mean nothing even without noise


def are_significant(columns: dict[str, FloatArray]) -> BoolArray:
    """Where the principal curvatures differ, and not by noise, (n,), from the columns of `curvature`."""
    k_min, k_max = columns["bz_k_min"], columns["bz_k_max"]
    least = np.maximum(_ERRORS * columns["bz_mean_curvature_std"], _ROUND * np.maximum(np.abs(k_min), np.abs(k_max)))
    return np.asarray((columns["bz_fit_status"] <= FitStatus.FOLDED) & (k_max - k_min > least))


def well_spread(points: FloatArray, distance: float) -> IntArray:
    """Rows of points (n, 3) of which no two are closer, while every other point is as close to one of them."""
    tree, free, found = cKDTree(points), np.ones(len(points), dtype=np.bool_), []
    for row in np.random.default_rng(0).permutation(len(points)):
        if free[row]:
            found.append(row)
            free[tree.query_ball_point(points[row], distance)] = False
    return np.array(found, dtype=np.int32)


def with_directions(panel: Panel, file: MeshFile) -> Panel:
    """The panel of a mesh file with lines in both principal directions."""
    wanted = [f"bz_direction_{kind}_{axis}" for kind in ("max", "min") for axis in "xyz"]
    wanted += ["bz_k_min", "bz_k_max", "bz_mean_curvature_std", "bz_fit_status"]
    missing = [name for name in wanted if name not in file.columns]
    if missing:
        raise InvalidParameterError(
            f"directions: {file.path} has no column {missing[0]}; PLY files that the command curvature writes have it"
        )
    diagonal = float(np.linalg.norm(np.ptp(file.vertices, axis=0)))
    rows = np.flatnonzero(are_significant(file.columns))
    rows = rows[well_spread(file.vertices[rows], SPACING * diagonal)]
    lines: list[tuple[FloatArray, Color]] = []
    for kind, (_, color) in zip(("max", "min"), NAMES, strict=True):
        along = np.column_stack([file.columns[f"bz_direction_{kind}_{axis}"][rows] for axis in "xyz"])
        half = 0.5 * _LENGTH * SPACING * diagonal * along
        ends = np.stack([file.vertices[rows] - half, file.vertices[rows] + half], axis=1)
        lines += [(line, color) for line in ends]
    return replace(panel, names=[*panel.names, *NAMES], lines=lines, line_radius=RADIUS * diagonal)
