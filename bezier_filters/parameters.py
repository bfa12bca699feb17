"""The parameters of the filters: one table for their documents and the command line.

Signatures are written out for editors and type checkers; a test compares them with the table. Text that docstrings of
several filters share is here, too, and is inserted when a filter is defined.
"""

import ast
import inspect
import re
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby
from typing import TypeVar

from bezier_filters.fields import (
    BAKE,
    CREASES,
    CURVATURE,
    DEVIATION,
    ESTIMATES,
    MEASURES,
    NORMALS,
    SMOOTH,
    TORSION,
    Field,
    fields_of,
    qualities,
    result_qualities,
)


@dataclass(frozen=True)
class Parameter:
    """A parameter of one filter or several, as in a docstring: ``name : kind, default value``, or ``optional``."""

    name: str
    kind: str
    default: object
    help: str  # meaning, for documents and the command line
    more: str = ""  # additional text in documents

    def entry(self) -> str:
        """Its entry in a docstring."""
        default = "optional" if self.default is None else f"default {self.default!r}".replace("'", '"')
        text = textwrap.fill(f"{self.help} {self.more}".strip(), 110, initial_indent="    ", subsequent_indent="    ")
        return f"{self.name} : {self.kind}, {default}\n{text}"


def parameters(table: str) -> tuple[Parameter, ...]:
    """Parameters of a table that is written like a docstring; the first line of a text is the help.

    >>> parameters('''
    ... iterations : int, default 1
    ...     How often.
    ...     Once is enough.
    ... ''')
    (Parameter(name='iterations', kind='int', default=1, help='How often.', more='Once is enough.'),)
    """
    found = []
    for entry in re.split(r"\n(?=\w)", table.strip()):
        head, text, *more = entry.splitlines()
        name, kind, value = re.fullmatch(r"(\w+) : (.*), (?:default (.*)|optional)", head).groups()  # type: ignore[union-attr]
        default = None if value is None else ast.literal_eval(value)
        found.append(Parameter(name, kind, default, text.strip(), " ".join(line.strip() for line in more)))
    return tuple(found)


LENGTH_TYPE = 'float, text such as "2%", pymeshlab.PercentageValue or pymeshlab.PureValue'  # kind of lengths
FIT = parameters(f"""
rings : int or "auto", default "auto"
    Size of the fitted neighbourhood in edges, at least 1; auto lets the data choose.
    By default rings, `alpha` and `degree` minimise the error that is predicted from the noise of the data.
radius : {LENGTH_TYPE}, optional
    Size of the neighbourhood as a length, or as a percentage of the diagonal of the bounding box, instead of rings.
    It is one scale for all vertices, whatever the density of the mesh.
alpha : float or "auto", default "auto"
    Weight of the points against the smoothness of the patch, in (0, 1].
degree : int or "auto", default "auto"
    Degree of the patch in each parameter, 2 to 4; or, if alpha is auto, its total degree, 2 to 6.
smoothness : {{"third_order", "paper"}}, default "third_order"
    Smoothness measure that alpha weighs the points against: third_order (consistent) or paper (the original method).
    The curvature of ``"paper"``, that of Li, Barsky, Jin (2009), is biased; see `estimate_vertex_geometry`.
robust : bool, optional
    Reduce the weight of points far from their patch, for scans with outliers.
    By default it is used where the data show outliers, if rings, alpha or the degree follow from the data.
noise : {LENGTH_TYPE}, optional
    Standard deviation of the noise, a length or a percentage of the diagonal of the bounding box; learned if left out.
    It is measured along the normal; the choice and the standard errors follow from it. The correlation length is
    learned in any case. Not where both the neighbourhood and alpha are given.
detail : {LENGTH_TYPE}, optional
    Size of the smallest detail to keep: no neighbourhood wider than this is chosen. A length or a percentage.
    The percentage is one of the diagonal of the bounding box. The narrowest ring may always be chosen.
""")
CLOUD = parameters("""
neighbours : int, optional
    Number of points of every neighbourhood in a point cloud, the point itself among them, instead of rings or a radius.
    Tangent planes and fits are those of so many nearest points, whatever the density. Not for meshes with faces.
viewpoint : (float, float, float), optional
    Place from which a point cloud was seen: the normals face it. By default that of the file, if there are no normals.
    Parts with a consistent orientation are turned as a whole; points seen at grazing angle decide nothing. Files with
    several scans have a place for each point, the attributes ``bz_viewpoint_x`` to ``_z``. The previous normals are
    ignored then. Not for meshes with faces.
viewpointside : {"toward", "away"}, default "toward"
    Whether normals face the viewpoint (toward) or look away from it, as from a place inside a body.
""")
DIRECTION = parameters("""
direction : (float, float, float), optional
    Direction for the curvatures along it and across it, and for plan curvature; for terrain that of gravity, 0 0 -1.
    Its length does not matter. Along gravity is the profile curvature of terrain analysis, across it the tangential
    one; plan curvature is that of the contour lines, the plane sections across the direction. See
    `VertexGeometry.terrain_curvature` for formulas and signs.
""")
COLORS = parameters("""
color : bool, default False
    Colour all vertices by the quality.
    There must be one. For signed quantities, zero gets the middle colour.
colormap : str, default "auto"
    auto (Cool Warm where zero is in the middle, else Viridis), Paper, or a map of pymeshlab: Turbo, French RGB, ...
    Paper is red for high, blue for medium and green for low, as the paper's torsion; Paper Curvature is red for high,
    green for medium and blue for low. In the others, too, red or bright is high (see `color_by_quality`). Names may be
    in upper or lower case.
percentile : float, default 2.0
    Percentage of the values that may lie beyond each end of the colours, in [0, 50).
colorrange : (float, float), optional
    Qualities of the first and the last colour, instead of the percentile.
""")
REPAIR = parameters("""
repair : bool, default False
    Weld coincident borders, split non-manifold edges and vertices, and reorient flipped faces first.
    Closed bodies that are inside out are reoriented, too, if all are. It changes vertices and faces of the mesh, as
    pymeshlab's own filters do; where edges or vertices are split, selections are lost and custom attributes set to 0.
""")
RUN = parameters("""
threads : int, optional
    Number of threads; by default all usable cores.
    The result does not depend on it.
progress : callable, optional
    ``progress(done, total)`` is called now and then; if it returns False, the filter stops.
""")
SMOOTHING = parameters(f"""
method : {{"auto", "paper"}}, default "auto"
    auto (learned from the mesh) or paper.
    ``"paper"`` moves every vertex onto its patch, as Li, Barsky, Jin (2009) do; it loses volume and rounds edges.
iterations : int, default 1
    How often to smooth; with auto once is enough.
noise : {LENGTH_TYPE}, optional
    Standard deviation of the noise, a length or a percentage of the diagonal of the bounding box; learned if left out.
    It is measured along the normal. Only for ``"auto"``.
borders : {{"curve", "fixed"}}, default "curve"
    Treatment of border vertices: curve (smoothed along the border) or fixed.
    Only for ``"auto"``.
keepvolume : bool, optional
    Keep the volume that closed parts enclose.
    By default with ``"auto"``, and not with ``"paper"``.
detail : {LENGTH_TYPE}, optional
    Size of the smallest detail to keep: waves of this length keep half of their height. A length or a percentage.
    The percentage is one of the diagonal of the bounding box. It bounds the low-pass filters; only for ``"auto"``.
relax : bool, default False
    Let vertices slide along the surface, too, for more regular triangles.
    Otherwise they move along the normals, and slide only where noise in all directions has distorted triangles. Only
    for ``"auto"``.
rings : int, optional
    Size of the neighbourhoods in edges, 2 if left out; only for the paper's method.
alpha : float, optional
    Weight of the points, in (0, 1], 0.8 if left out; only for the paper's method.
""")
FILLING = parameters(f"""
method : {{"auto", "surface", "flat", "paper"}}, default "auto"
    auto (flat lids where the surface ends in a plane, else surface), surface (continues it), flat or paper.
    ``"surface"`` continues sharp edges, too. ``"flat"`` fills in the plane of the rim, or with the membrane in a rim
    that leaves the plane. ``"paper"`` lifts flat triangulations to a bicubic patch for each part that sharp edges cut
    the hole into, as Li, Barsky, Jin (2009) do.
maxholesize : int, optional
    Leave holes with more edges open; 3 or more.
    (MeshLab's own filter leaves holes of just this size open, too.)
maxperimeter : {LENGTH_TYPE}, optional
    Leave holes of a larger perimeter open: a length, or a percentage of the diagonal of the bounding box.
maxdiameter : {LENGTH_TYPE}, optional
    Leave holes of a larger diameter open: a length, or a percentage of the diagonal of the bounding box.
outerrims : bool, default False
    Fill the outer rims of open sheets, too.
boltholes : bool, default False
    Fill circles in flat parts of open sheets, too, which look like the holes for bolts in a part.
    Those with a selected vertex are filled in any case with ``onselected``.
trim : bool, default False
    Remove faces at the rim that intersect others, as spikes and flaps do, where a hole cannot be filled otherwise.
    Where that is not enough, all faces at the rim are removed. They stay if the hole cannot be filled without them,
    either.
intersecting : bool, default False
    Fill holes, too, whose fills all intersect other faces or themselves, by the fill with the fewest intersections.
    Otherwise they are left open, as by MeshLab's own filter, and reported.
creases : bool, default True
    Continue sharp edges that end at a hole through it.
noise : {LENGTH_TYPE}, optional
    Standard deviation of the noise, a length or a percentage of the diagonal of the bounding box; learned if left out.
    It is measured along the normal. 0 interpolates every point.
alpha : float, optional
    Weight of the points, in (0, 1], 0.8 if left out; only for the paper's method.
correction : {{"harmonic", "lagrange", "lagrange_pieces"}}, default "harmonic"
    Correction that fits patches to the rim: harmonic, lagrange or lagrange_pieces; for the paper's method.
    The paper's products of Lagrange polynomials are infinite where two vertices of the rim share a parameter;
    ``"lagrange_pieces"`` takes them in pieces of the plane with four vertices of the rim at most.
refine : bool, default True
    Give patches new vertices, so that triangles are as large as those around; may be False for the paper's method.
    Then a patch is the Delaunay triangulation of its rim alone, as in the paper.
""")
_FILLED = {parameter.name: parameter for parameter in FILLING}
REPLACEMENT = (
    *parameters("""
condselect : str, optional
    Faces to replace, a condition in MeshLab's syntax: 'z0 > 1 && z1 > 1 && z2 > 1'; the selected ones if left out.
    The syntax is that of ``compute_selection_by_condition_per_face``; the selection of the mesh does not change.
rings : int, default 0
    Rings of faces around these that are replaced, too, such as the foot of a bump.
"""),
    *(_FILLED[name] for name in ("method", "intersecting", "creases", "noise")),
)
BRIDGES = (
    *parameters("""
pairs : str, default "auto"
    auto (holes that face each other across a narrow gap), or pairs of numbers of holes: '0 1, 2 3'.
    The report lists the holes in the order of their numbers, with their centres. A gap is narrow if every vertex of
    each rim is within five edges of the other one.
"""),
    *(_FILLED[name] for name in ("intersecting", "noise")),
)
SUBDIVISION = (
    *parameters(f"""
iterations : int, optional
    How often every face becomes four, 1 if no tolerance is given.
tolerance : {LENGTH_TYPE}, optional
    Split only edges whose midpoints are farther from the surface: a length or a percentage.
    The percentage is one of the diagonal of the bounding box. With any edge of a face its longest one is split.
move : bool, optional
    Whether old vertices move onto the surface; by default they do where the mesh is noisy.
    False draws the surface through noisy vertices, too.
"""),
    _FILLED["noise"],
)
REMESHING = (
    *parameters(f"""
length : {LENGTH_TYPE}, optional
    Length of the edges, or a percentage of the diagonal of the bounding box; the mean of the old ones if left out.
    With a tolerance it is the largest one, by default a tenth of the diagonal.
vertexcount : int, optional
    Number of vertices instead of a length, reached to within some percent.
tolerance : {LENGTH_TYPE}, optional
    Distance from the surface from which lengths follow by the curvature: a length or a percentage.
    With few triangles on nearly flat parts it decimates a mesh.
iterations : int, default 10
    Number of iterations.
"""),
    _FILLED["noise"],
)
LINES = parameters("""
angle : float, default 40.0
    Angle between faces in degrees, from which on an edge may be sharp.
minstrength : float, default 2.0
    Omit smooth lines that are weaker: shorter, in radii of the curvature across them.
    A line is weaker, too, where that curvature hardly changes across it.
""")
TEXTURE = parameters(f"""
texmap : {{"curvature", "cavity", "convexity", "normal"}}, default "curvature"
    curvature (grey is flat, white convex), cavity (concave is black), convexity (convex is white) or normal.
size : int, default 1024
    Rows, and columns, of the image.
scale : {LENGTH_TYPE}, optional
    Radius of curvature at which the map saturates, a length or a percentage of the diagonal of the bounding box.
    By default 2 % of the vertices saturate, sharp edges aside. Maps of several meshes are comparable if it is given.
padding : int, default 8
    Texels around charts that repeat the nearest value inside, against seams in filters and mip-maps.
bits : int, default 16
    Bits of each channel of the file, 8 or 16.
directx : bool, default False
    Green is down (-Y, DirectX) in a normal map; otherwise it is up (+Y, OpenGL).
""")
SURFACE_LINES = parameters(f"""
family : {{"curvature", "max", "min", "torsion", "asymptotic", "normal"}}, default "curvature"
    Lines of curvature (or those of k_max or k_min only), of torsion, asymptotic, or of a given normal curvature.
    Torsion lines run at 45 degrees to the lines of curvature, where the geodesic torsion is extreme; along asymptotic
    lines the normal curvature is 0.
normalcurvature : float, optional
    Normal curvature of the lines in 1/length, positive where convex; for normal.
spacing : {LENGTH_TYPE}, optional
    Distance between neighbouring lines, a length or a percentage of the diagonal of the bounding box; a 60th of it.
    With seeds, lines have no spacing if left out, and may come as near to each other as they do.
seeds : str, optional
    Points on the lines: '0 0 1, 0.5 0 1'; then there are no others.
maxerror : float, default 9.4
    Standard error of the direction in degrees, at which lines end.
    At the default, noise alone makes a direction once in a hundred times.
noise : {LENGTH_TYPE}, optional
    Standard deviation of the noise, a length or a percentage of the diagonal of the bounding box; learned if left out.
    It is measured along the normal.
""")

COMPARISON = parameters(f"""
measured : {{"auto", "surface", "points"}}, default "auto"
    What is compared: surface (the patches of the mesh), points (its vertices), or auto (points of a cloud alone).
    A surface has averaged its noise, points have all of it.
tolerance : {LENGTH_TYPE}, optional
    Deviation that is allowed on either side, a length or a percentage of the diagonal of the bounding box.
    The report has the share within it. The colours are then green within, yellow to red above it and cyan to blue
    below, up to three times the tolerance, and grey where nothing was compared.
maxdistance : {LENGTH_TYPE}, optional
    Leave out vertices farther from the reference, a length or a percentage of the diagonal of the bounding box.
region : int, default 200
    Number of vertices over which deviations are averaged, to find shallow defects.
noise : {LENGTH_TYPE}, optional
    Standard deviation of the noise, a length or a percentage of the diagonal of the bounding box; learned if left out.
    It is measured along the normal.
refnoise : {LENGTH_TYPE}, optional
    Standard deviation of the noise of the reference, a length or a percentage; learned if left out, 0 for a model.
""")

INTEGRALS = parameters(f"""
labels : str, optional
    Attribute of faces or vertices whose integers are labels, or quality: each label is measured by itself.
noise : {LENGTH_TYPE}, optional
    Standard deviation of the noise, a length or a percentage of the diagonal of the bounding box; learned if left out.
    It is measured along the normal.
repeats : int, default 8
    Number of fits with new noise for standard errors; 0 for none.
""")


def _quality(fields: dict[str, Field], default: str | None) -> Parameter:
    """The parameter that selects the field for the quality."""
    *others, last = fields
    meant = [f'``"{word}"`` is the {_meaning(field)}' for word, field in fields.items() if word != field.name]
    stays = "; the old one stays if left out" if default is None else ""
    return Parameter(
        "quality",
        "{" + ", ".join(f'"{word}"' for word in fields) + "} or None",
        default,
        f"Quality to set: {', '.join(others)} or {last}{stays}.",
        "; ".join(meant) + ". None leaves the old one alone." if meant else "",
    )


def _meaning(field: Field) -> str:
    return field.label + (f" [{field.unit}]" if field.unit else "")


# of the filters that let the user choose
QUALITY_OF = {
    NORMALS: _quality(qualities(NORMALS), "angle"),
    CURVATURE: _quality(qualities(CURVATURE), "mean"),
    SMOOTH: _quality(qualities(SMOOTH), None),
    DEVIATION: _quality(qualities(DEVIATION), "deviation"),
}
QUALITY_IN_TILES = _quality(result_qualities(CURVATURE), "mean")
# of the filters by their commands, in the order of the commands' help
PARAMETERS = {
    NORMALS: (QUALITY_OF[NORMALS], *FIT, *CLOUD, *REPAIR, *COLORS, *RUN),
    CURVATURE: (QUALITY_OF[CURVATURE], *DIRECTION, *FIT, *CLOUD, *REPAIR, *COLORS, *RUN),
    TORSION: (*FIT, *CLOUD, *REPAIR, *COLORS, *RUN),
    SMOOTH: (*SMOOTHING, *REPAIR, QUALITY_OF[SMOOTH], *COLORS, *RUN),
    "fill-holes": (*FILLING, *REPAIR, *RUN),
    "replace": (*REPLACEMENT, *RUN),
    "bridge": (*BRIDGES, *RUN),
    "subdivide": (*SUBDIVISION, *RUN),
    "remesh": (*REMESHING, *RUN),
    CREASES: (*LINES, *FIT, *RUN),
    BAKE: (*TEXTURE, *FIT, *RUN),
    "lines": (*SURFACE_LINES, *RUN),
    DEVIATION: (QUALITY_OF[DEVIATION], *COMPARISON, *COLORS, *RUN),
    MEASURES: (*INTEGRALS, *RUN),
}
_ESTIMATED = """\
ms : pymeshlab.MeshSet
    Its current mesh may be a point cloud, whose vertex normals define the outside where they are
    not zero, unless a viewpoint does (see `estimate_vertex_geometry`).
onselected : bool
    Only selected vertices get new values; if there are none, the vertices of the selected faces. The others keep
    theirs, or get 0 where a column or the quality is new."""
_ESTIMATE = """\
dict
    ``status`` (number of vertices per status name), ``fit`` (the ``rings``, ``radius`` or ``neighbours``,
    ``degree`` and ``alpha`` that were used, the ``noise_sigma`` that was found and the ``noise_length`` over which it
    is correlated, lengths, ``noise_heavy``: whether it turns single normals, and ``noise_reason``: why it
    is unknown), ``flipped`` (number of normals that contradict their viewpoints, or None), ``mean_edge`` (a
    length, or None for a point cloud), ``attributes`` (names written), ``quality`` and ``unit``,
    ``statistics`` (min, median, max and mean of the quality over the vertices with an estimate),
    ``warnings`` (texts: why no vertex has an estimate), ``remarks`` (texts: why most estimates are unreliable,
    and where the mesh is no manifold), ``topology`` (what pymeshlab counts, as in
    `meshing_close_holes_by_bezier_patch`; None for a point cloud),
    ``repaired`` (as in `meshing_close_holes_by_bezier_patch`, or None),
    ``seconds`` (read, fit, topology, write, color) and, if coloured, ``color_range`` and ``colormap``. It can be
    written as JSON."""
_NOTHING_ELSE = """\
Where there is no estimate, columns hold 0. Nothing else in the MeshSet changes: not its{} selections,
colours (unless asked for), textures, other attributes or filter script. Running it again overwrites the columns and
leaves an attribute ``outlierScore`` of zeros."""
_COORDINATES = "Coordinates are used as stored, like in pymeshlab's own filters: the transform matrix is ignored."
_ERRORS = """\
BezierFilterError
    If the mesh, an attribute on it or a parameter is refused; the MeshSet is as it was.
CancelledError
    If `progress` returned False; the MeshSet is as it was."""

_Function = TypeVar("_Function", bound=Callable[..., object])


def complete_docstring(name: str) -> Callable[[_Function], _Function]:
    """Complete the docstring of a filter, given the name of its command, from the tables of fields and parameters.

    The source has the text specific to the filter. Added are its columns, the parameters in the tables and the errors,
    and for estimating filters common parameters, effects and results.
    """

    def complete(function: _Function) -> _Function:
        text = inspect.cleandoc(function.__doc__ or "")  # none under python -OO
        intro, *parts = re.split(r"\n\n(\w+)\n---+\n", text)
        sections = {"Returns": _ESTIMATE} | dict(zip(parts[::2], parts[1::2], strict=True)) | {"Raises": _ERRORS}
        own = f"{_ESTIMATED if name in ESTIMATES else ''}\n{sections.get('Parameters', '')}".strip()
        entries = {entry.partition(" ")[0]: entry for entry in re.split(r"\n(?=\w)", own)}
        entries |= {parameter.name: parameter.entry() for parameter in PARAMETERS[name]}
        known = [entries[parameter] for parameter in inspect.signature(function).parameters if parameter in entries]
        sections["Parameters"] = "\n".join(known)
        paragraphs = [intro, _field_list(name)] if fields_of(name) else [intro]
        if name in ESTIMATES:
            paragraphs.append(_NOTHING_ELSE.format("" if name == NORMALS else " normals,"))
        paragraphs.append(_COORDINATES)
        for title in ("Parameters", "Returns", "Raises", "Examples"):
            if title in sections:
                paragraphs.append(f"{title}\n{'-' * len(title)}\n{sections[title]}")
        function.__doc__ = "\n\n".join(paragraphs)
        return function

    return complete


def _field_list(name: str) -> str:
    """The columns of a filter as a list, an item for a number or a vector."""
    lines = ["Custom scalar attributes that are added or overwritten:", ""]
    for _, group in groupby(fields_of(name), lambda field: field.name if field.component is None else field.source):
        first, *others = group
        names = ", ".join([f"``{first.column}``", *(f"``{other.name[-2:]}``" for other in others)])
        text = "; ".join(filter(None, [_meaning(first).removeprefix("x of the "), first.remark]))
        lines.append(textwrap.fill(f"- {names}: {text}", 110, subsequent_indent="  "))
    return "\n".join(lines)
