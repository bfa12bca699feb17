"""The paper's Figures 9 and 10, holes that are filled; printed by paper_figures.py."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

import bezier_filters as bf
from bezier_filters.holes.loops import vector_area
from cut_holes import normals
from paper_deviations import WHEEL
from paper_models import FAN, Found, Where, flat, joined
from sub_holes import random_holes

BACK = (0.45, 0.6, 0.75)


class Window(NamedTuple):
    """A part of a mesh that is drawn: within a radius of a centre (3,), seen against a direction (3,)."""

    center: np.ndarray
    radius: float
    direction: np.ndarray


class Fill(NamedTuple):
    """A mesh before or after its holes are filled; faces of fills come last."""

    way: str
    vertices: np.ndarray
    faces: np.ndarray
    old_faces: int

    def panel(self, window: Window | None = None) -> bf.Panel:
        """The mesh, or the part of it within a window, with backs of faces in blue."""
        vertices, faces, new = self.vertices, self.faces, np.arange(len(self.faces)) >= self.old_faces
        if window is not None:
            near = np.linalg.norm(vertices[faces].mean(axis=1) - window.center, axis=1) < window.radius
            vertices, faces, new = vertices @ turn_to_viewer(window.direction).T, faces[near], new[near]
        return replace(flat(vertices, faces, self.way, new), back=BACK)


def filled(
    name: str, vertices: np.ndarray, faces: np.ndarray, ways: dict[str, dict]
) -> tuple[list[Fill], list[dict[str, object]]]:
    """The mesh and its fills, and a row for each hole and way."""
    fills, rows = [Fill("before", vertices, faces, len(faces))], []
    for way, options in ways.items():
        result = bf.fill_holes(vertices, faces, **options)
        fills.append(Fill(way, result.vertices, result.faces, len(faces)))
        rows += [
            {
                "mesh": name,
                "way": way,
                "edges of the rim": hole.edge_count,
                "fill": hole.method or "left open",
                "parts": hole.parts,
                "new vertices": len(hole.new_vertices),
                "rim angle [degrees]": hole.rim_dihedral,
                "faces that cut others": hole.self_intersections,
                "why": hole.reason,
            }
            for hole in result.holes
            if not hole.is_outer_rim
        ]
    return fills, rows


def figure_9(where: Where) -> Found:
    """The holes of the Stanford bunny, filled by one patch each."""
    stand_in = WHEEL / "bunny10k_textured.obj"
    name, vertices, faces, is_found = where.model("Stanford bunny", ("stanford-bunny", "bun_zipper", "bunny"), stand_in)
    ways: dict[str, dict] = {
        "paper": {"method": "paper"},
        "paper, no new vertices": {"method": "paper", "refine": False},
        "automatic": {},
    }
    fills, rows = filled(name, vertices, faces, ways)
    loops = bf.boundary_loops(bf.triangle_mesh(vertices, faces))
    rim = vertices[max(loops, key=lambda loop: vertices[loop, 1].mean())]  # the bottom hides the highest one
    window = Window(rim.mean(axis=0), 1.2 * np.linalg.norm(np.ptp(rim, axis=0)), -vector_area(rim))
    path, pictures = where.out / "figure_9.png", [where.out / "figure_9_0.png", where.out / "figure_9_1.png"]
    bf.render_panels(pictures[0], [f.panel() for f in fills], views=["bottom"], size=(430, 430), up="y", title=name)
    bf.render_panels(pictures[1], [f.panel(window) for f in fills], size=(430, 250), up="y", title="the hole inside")
    joined(path, pictures)
    patches = sum(row["way"] == "paper" and row["fill"] == "paper" for row in rows)
    note = f"{patches} of {len(rows) // len(ways)} holes get the paper's patch."
    if not is_found:
        note += " This is the scan in 10,000 faces; the patch of the hole that gets none would cut faces around it."
    return Found("Figure 9: the holes of the Stanford bunny", path, rows, note)


def figure_10(where: Where) -> Found:
    """A hole across two sharp edges: one patch, and a patch for each part that curves cut it into."""
    name, vertices, faces, is_found = where.model("fandisk", ("fandisk",), FAN)
    window = None
    if is_found:
        (case,) = random_holes(vertices, faces, 1, 4, seed=0)
        faces, lost = case.faces, vertices[case.removed].reshape(-1, 3)
        direction = normals(vertices, case.removed).sum(axis=0)
        window = Window(lost.mean(axis=0), 0.8 * np.linalg.norm(np.ptp(lost, axis=0)), direction)
    ways: dict[str, dict] = {
        "one patch": {"method": "paper", "creases": False},
        "a patch for each part": {"method": "paper"},
        "automatic": {},
    }
    fills, rows = filled(name, vertices, faces, ways)
    path = where.out / "figure_10.png"
    if window is None:
        panels = [fill.panel() for fill in fills]
        bf.render_panels(path, panels, views=["iso", "back"], size=(420, 380), up="z", title=name)
    else:
        pictures = [where.out / "figure_10_0.png", where.out / "figure_10_1.png"]
        whole = fills[0].panel(window._replace(radius=np.inf))
        bf.render_panels(pictures[0], [replace(whole, title="")], size=(420, 420), up="y", title=name)
        bf.render_panels(pictures[1], [fill.panel(window) for fill in fills], size=(420, 420), up="y")
        joined(path, pictures)
    note = "Curves across the hole continue the sharp edges that end at it; each part between them has a patch."
    return Found("Figure 10: a hole across sharp edges", path, rows, note)


def turn_to_viewer(direction: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) that turns a direction towards the viewer of the front view."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])
