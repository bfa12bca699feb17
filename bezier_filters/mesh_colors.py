"""Vertex colours from quality with the colour maps of pymeshlab, high values always at the red or bright end."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.meshset import BezierFilterError, MeshSet, current_mesh


@dataclass(frozen=True)
class ColorMap:
    """A colour map of pymeshlab.

    Attributes
    ----------
    name : str
        pymeshlab's name of it.
    transfer_function : bool
        Which of pymeshlab's two filters has it.
    red_is_low : bool
        Whether pymeshlab gives low values the red end.
    """

    name: str
    transfer_function: bool = False
    red_is_low: bool = False


# The transfer function "RGB" is missing: it is the first map again, with darker colours in between.
COLOR_MAPS = (
    ColorMap("RGB", red_is_low=True),
    ColorMap("Viridis"),
    ColorMap("Plasma"),
    ColorMap("Cividis"),
    ColorMap("Turbo"),
    ColorMap("RdPu"),
    ColorMap("Meshlab RGB", transfer_function=True),
    ColorMap("French RGB", transfer_function=True, red_is_low=True),
    ColorMap("Red Scale", transfer_function=True),
    ColorMap("Green Scale", transfer_function=True),
    ColorMap("Blue Scale", transfer_function=True),
    ColorMap("Grey Scale", transfer_function=True),
    ColorMap("Flat", transfer_function=True),
    ColorMap("Saw 4", transfer_function=True),
    ColorMap("Saw 8", transfer_function=True),
)
COLOR_MAP_NAMES = tuple(color_map.name for color_map in COLOR_MAPS)


def find_color_map(name: str) -> ColorMap:
    """Colour map of a name in any case.

    Raises
    ------
    BezierFilterError
        If there is none; the message lists the names.
    """
    for color_map in COLOR_MAPS:
        if isinstance(name, str) and color_map.name.lower() == name.lower():
            return color_map
    raise BezierFilterError(f"colormap: got {name!r}, expected one of {', '.join(COLOR_MAP_NAMES)}")


def check_limits(low: float, high: float) -> None:
    """Refuse ends of a colour range that pymeshlab cannot tell apart in single precision.

    Raises
    ------
    BezierFilterError
        If the range is empty, not finite or beyond single precision.
    """
    with np.errstate(over="ignore", under="ignore"):
        ends = np.array([low, high], dtype=np.float64).astype(np.float32)
    if not (np.isfinite(ends).all() and ends[0] < ends[1]):
        raise BezierFilterError(
            f"colour range: got {low!r} to {high!r}, expected low < high, distinct in single precision; "
            "if the mesh is extremely large or small, scale it"
        )


def color_by_quality(ms: MeshSet, low: float, high: float, colormap: str = "Turbo") -> None:
    """Colour the vertices of the current mesh by their quality; nothing else changes.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have a finite quality.
    low, high : float
        Qualities of the first and the last colour; those beyond get the colours of the ends.
    colormap : str
        One of `COLOR_MAP_NAMES`, in any case. High values are red or bright, unlike in pymeshlab,
        whose RGB and French RGB have red low. RdPu ends in dark purple, as it does elsewhere;
        Flat is a single grey, Saw 4 and Saw 8 are 4 and 8 ramps from black to light.

    Raises
    ------
    BezierFilterError
        If the colour map is unknown, the range is empty, or the quality is missing or not finite.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(subdiv=2)
    >>> ms.compute_scalar_by_function_per_vertex(q="z")
    >>> color_by_quality(ms, -1.0, 1.0, "turbo")
    """
    color_map = find_color_map(colormap)
    check_limits(low, high)
    mesh = current_mesh(ms)
    if not mesh.has_vertex_scalar():
        raise BezierFilterError("the mesh has no quality to colour by; compute one first")
    if not np.isfinite(mesh.vertex_scalar_array()).all():  # NaN aborts the process
        raise BezierFilterError("the quality of the mesh is not finite everywhere, so it cannot be coloured")
    if not color_map.red_is_low:
        _apply(ms, color_map, low, high)
        return
    ms.compute_scalar_by_function_per_vertex(q="-q", onselected=False)
    try:
        _apply(ms, color_map, -high, -low)
    finally:
        ms.compute_scalar_by_function_per_vertex(q="-q", onselected=False)  # exact


def _apply(ms: MeshSet, color_map: ColorMap, low: float, high: float) -> None:
    if color_map.transfer_function:
        ms.compute_color_from_scalar_using_transfer_function_per_vertex(
            minqualityval=low, maxqualityval=high, midhandlepos=50.0, brightness=1.0, tfslist=color_map.name
        )
    else:
        ms.compute_color_from_scalar_per_vertex(
            minval=low, maxval=high, perc=0.0, zerosym=False, colormap=color_map.name
        )
