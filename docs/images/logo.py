"""Draws the logo: python docs/images/logo.py.

A bicubic Bezier patch, with lines of constant u and v, over the six triangles around a vertex. It is the icon of the
site and stands at the head of the README, on light and dark backgrounds.
"""

from math import cos, pi, sin
from pathlib import Path

import numpy as np

from bezier_filters import BezierPatch, ParameterRectangle
from bezier_filters.arrays import FloatArray

FOLDER = Path(__file__).parent
SIZE = 64.0
"""Side of the picture, in its own units."""
HEIGHTS = np.array([[0.9, 0.2, 0.5, 0.1], [0.5, 1.7, 1.2, 0.2], [0.5, 1.4, 1.3, 0.6], [-0.1, 0.4, 0.3, 0.9]])
"""Heights of the control points, in half sides of the patch."""
CELLS, STEPS = 4, 8
"""Cells between lines of constant u and v along a side, and straight pieces of a line in each."""
AZIMUTH, TILT, SCALE, MIDDLE = 0.42, 0.72, 20.5, (32.0, 41.0)
"""Turn about the vertical in radians, sine of the height of the eye, units per half side, place of the vertex."""
RING_RADIUS, RING_HEIGHTS = 1.4, (0.05, -0.12, 0.1, -0.05, 0.12, -0.1)
"""Of the six neighbours of the vertex, in half sides of the patch."""
LOW, MIDDLE_COLOR, HIGH, LINE, RING = (36, 104, 158), (52, 172, 160), (250, 214, 92), "#ffffff", "#a3b5be"
"""Colours of the lowest, middle and highest cell, of the lines on the patch and of the triangles."""


def project(points: FloatArray) -> FloatArray:
    """Places (n, 2) in the picture of points (n, 3) in half sides of the patch."""
    x, y, z = np.asarray(points, dtype=np.float64).T
    across = x * cos(AZIMUTH) - y * sin(AZIMUTH)
    depth = x * sin(AZIMUTH) + y * cos(AZIMUTH)
    return np.column_stack(
        [MIDDLE[0] + SCALE * across, MIDDLE[1] - SCALE * (TILT * depth + (1.0 - TILT**2) ** 0.5 * z)]
    )


def path(points: FloatArray) -> str:
    """Points (n, 3) as the data of an SVG path."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in project(points))


def ring() -> str:
    """The triangles around the vertex."""
    corners = np.array(
        [
            (RING_RADIUS * cos(k * pi / 3), RING_RADIUS * sin(k * pi / 3), height)
            for k, height in enumerate(RING_HEIGHTS)
        ]
    )
    spokes = "".join(path(np.array([corner, (0.0, 0.0, 0.0)])) for corner in corners)
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.4"/>' for x, y in project(corners))
    outline = f'<path d="{path(corners)}Z{spokes}" fill="none" stroke-width="1.8" stroke-linejoin="round"/>'
    return f'<g stroke="{RING}" fill="{RING}">{outline}<g stroke="none">{dots}</g></g>'


def surface() -> str:
    """The patch: cells from back to front, coloured by their heights, with lines between them."""
    square = ParameterRectangle(-1.0, -1.0, 2.0, 2.0)
    patch = BezierPatch(np.zeros(3), np.eye(3), square, HEIGHTS)
    along, zeros = np.linspace(0.0, 1.0, STEPS + 1)[:-1], np.zeros(STEPS)
    u = np.concatenate([along, zeros + 1.0, 1.0 - along, zeros])
    v = np.concatenate([zeros, along, zeros + 1.0, 1.0 - along])
    corners = [(i, j) for i in range(CELLS) for j in range(CELLS)]
    corners.sort(key=lambda c: -c[0] * sin(AZIMUTH) - c[1] * cos(AZIMUTH))
    rims = [patch.evaluate((i + u) / CELLS, (j + v) / CELLS) for i, j in corners]
    heights = np.array([rim[:, 2].mean() for rim in rims])
    shares = (heights - heights.min()) / np.ptp(heights)
    drawn = []
    for rim, share in zip(rims, shares, strict=True):
        parts = (np.interp(share, (0.0, 0.5, 1.0), stops) for stops in zip(LOW, MIDDLE_COLOR, HIGH, strict=True))
        color = "#" + "".join(f"{round(part):02x}" for part in parts)
        drawn.append(f'<path d="{path(rim)}Z" fill="{color}"/>')
    return f'<g stroke="{LINE}" stroke-width="1" stroke-linejoin="round">{"".join(drawn)}</g>'


def main() -> None:
    """Write logo.svg."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE:g} {SIZE:g}" width="96" height="96">'
    title = "<title>bezier_filters: a bicubic patch over the triangles around a vertex</title>"
    (FOLDER / "logo.svg").write_text(f"{head}\n{title}\n{ring()}\n{surface()}\n</svg>\n", encoding="utf-8")


if __name__ == "__main__":
    main()
