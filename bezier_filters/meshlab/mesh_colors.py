"""Vertex colours from quality, with high values red or bright, and colour maps as files for MeshLab."""

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from bezier_filters.arguments import brief_repr, check_value, path_of
from bezier_filters.arrays import FloatArray
from bezier_filters.display import AUTO, PALETTES, default_colormap, palette_places
from bezier_filters.errors import InvalidParameterError, is_real
from bezier_filters.meshlab.meshset import BezierFilterError, Mesh, MeshSet, current_mesh
from bezier_filters.runtime.atomic import atomic_write, temporary_folder

_RED_IS_LOW = ("RGB", "French RGB")  # pymeshlab gives low values their red end
# names in pymeshlab's two filters for colour maps; palettes of this package are read from a file
_COLOR_MAPS = ("RGB", "Viridis", "Plasma", "Cividis", "Turbo", "RdPu")
# The transfer function "RGB" is missing: it is the first map again, with darker colours in between.
_TRANSFER_FUNCTIONS = ("Meshlab RGB", "French RGB", "Red Scale", "Green Scale", "Blue Scale", "Grey Scale", "Flat")
COLOR_MAP_NAMES = (*_COLOR_MAPS, *_TRANSFER_FUNCTIONS, "Saw 4", "Saw 8", *PALETTES)


def find_color_map(name: str, *, signed: bool = False) -> str:
    """Colour map by name, in any case; ``"auto"`` depends on whether zero is the middle of the field's range."""
    wanted = default_colormap(signed=signed) if isinstance(name, str) and name == AUTO else name
    for known in COLOR_MAP_NAMES:
        if isinstance(wanted, str) and known.lower() == wanted.lower():
            return known
    raise BezierFilterError(f"colormap: got {brief_repr(name)}, expected one of {', '.join((AUTO, *COLOR_MAP_NAMES))}")


def check_limits(low: float, high: float) -> None:
    """Refuse ends of a colour range that are equal in single precision, which pymeshlab uses."""
    with np.errstate(over="ignore", under="ignore"):
        ends = np.array([low, high], dtype=np.float64).astype(np.float32)
    if not (np.isfinite(ends).all() and ends[0] < ends[1]):
        raise BezierFilterError(
            f"colour range: got {low!r} to {high!r}, expected low < high, distinct in single precision; "
            "if the mesh is extremely large or small, scale it"
        )


def _check_ends(low: object, high: object) -> None:
    """Refuse ends of a colour range that are no numbers."""
    for name, value in (("low", low), ("high", high)):
        if not is_real(value):
            raise InvalidParameterError(f"{name}: got {brief_repr(value)}, expected a number")


def color_by_quality(ms: MeshSet, low: float, high: float, colormap: str = AUTO) -> None:
    """Colour the vertices of the current mesh by their quality; nothing else changes.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have a finite quality.
    low, high : float
        Qualities of the first and the last colour; those beyond get the colours of the ends.
    colormap : str
        A colour map of pymeshlab, in any case: RGB, Viridis, Plasma, Cividis, Turbo, RdPu, Meshlab RGB, French RGB,
        Red Scale, Green Scale, Blue Scale, Grey Scale, Flat, Saw 4 or Saw 8; or one of ours: Cool Warm, from blue
        over grey to red, Paper, from green over blue to red, Paper Curvature, from blue over green to red, or
        Tolerance, green in the middle third of the range, yellow to red above and cyan to blue below.
        ``"auto"`` is Cool Warm for a range that is symmetric about 0, else Viridis; both are distinct with any kind
        of colour vision. High values are red or bright, unlike in pymeshlab, whose RGB and French RGB have red low.
        RdPu ends in dark purple, as in other programs; Flat is a single grey, Saw 4 and Saw 8 are 4 and 8 ramps from
        black to light.

    Raises
    ------
    BezierFilterError
        If the colour map is unknown, the range is empty, or the quality is missing or not finite.
    InvalidParameterError
        If `ms` is no MeshSet, or `low` or `high` no number.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(subdiv=2)
    >>> ms.compute_scalar_by_function_per_vertex(q="z")
    >>> color_by_quality(ms, -1.0, 1.0, "turbo")
    """
    check_value("ms", ms, (MeshSet,))
    _check_ends(low, high)
    color_map = find_color_map(colormap, signed=low == -high)
    check_limits(low, high)
    mesh = current_mesh(ms)
    if not mesh.has_vertex_scalar():
        raise BezierFilterError("the mesh has no quality to colour by; compute one first")
    if not np.isfinite(mesh.vertex_scalar_array()).all():  # NaN aborts the process
        raise BezierFilterError("the quality of the mesh is not finite everywhere, so it cannot be coloured")
    if color_map not in _RED_IS_LOW:
        _apply(ms, color_map, low, high)
        return
    ms.compute_scalar_by_function_per_vertex(q="-q", onselected=False)
    try:
        _apply(ms, color_map, -high, -low)
    finally:
        ms.compute_scalar_by_function_per_vertex(q="-q", onselected=False)  # exact


def _apply(ms: MeshSet, color_map: str, low: float, high: float) -> None:
    ends = {"minqualityval": low, "maxqualityval": high, "midhandlepos": 50.0, "brightness": 1.0}
    if color_map in PALETTES:
        with temporary_folder() as folder:
            path = str(folder / "palette.qmap")
            _write_quality_map(path, palette_places(color_map), np.array(PALETTES[color_map]), low, high)
            ms.compute_color_from_scalar_using_transfer_function_per_vertex(
                **ends, tfslist="Custom Transfer Function File", csvfilename=path
            )
    elif color_map in _COLOR_MAPS:
        ms.compute_color_from_scalar_per_vertex(minval=low, maxval=high, perc=0.0, zerosym=False, colormap=color_map)
    else:
        ms.compute_color_from_scalar_using_transfer_function_per_vertex(**ends, tfslist=color_map)


def save_quality_map(path: str | os.PathLike[str], low: float, high: float, colormap: str = AUTO) -> None:
    """Write a colour map and its range as a quality mapper file (.qmap), which MeshLab's Quality Mapper loads.

    With it, the colours in MeshLab are those of `color_by_quality`, and can be changed there.

    Parameters
    ----------
    path : path
        File to write or replace, usually ``.qmap``.
    low, high : float
        Qualities of the first and the last colour.
    colormap : str
        As for `color_by_quality`.

    Raises
    ------
    BezierFilterError
        If the colour map is unknown or the range is empty.
    InvalidParameterError
        If `path` is no path, or `low` or `high` no number.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "curvature.qmap"
    >>> save_quality_map(path, -1.0, 1.0)
    >>> path.read_text().splitlines()[1]
    '0;0.23;0.5;0.9;1;0.75;'
    """
    path = path_of(path)
    _check_ends(low, high)
    color_map = find_color_map(colormap, signed=low == -high)
    check_limits(low, high)
    is_ours = color_map in PALETTES
    colors = np.array(PALETTES[color_map]) if is_ours else _sample_colormap(color_map)
    places = palette_places(color_map) if is_ours else np.linspace(0.0, 1.0, len(colors))
    with atomic_write(path) as temporary:
        _write_quality_map(temporary, places, colors, low, high)


def _sample_colormap(color_map: str) -> FloatArray:
    """Colours that pymeshlab gives to 256 qualities from 0 to 1, shape (256, 3)."""
    ms = MeshSet()
    ms.add_mesh(Mesh(np.zeros((256, 3)), v_scalar_array=np.linspace(0.0, 1.0, 256)))
    color_by_quality(ms, 0.0, 1.0, color_map)
    return np.asarray(current_mesh(ms).vertex_color_matrix()[:, :3])


def _write_quality_map(
    path: str | os.PathLike[str], places: Iterable[float], colors: FloatArray, low: float, high: float
) -> None:
    """Write the nodes of the three channels, each x;y;, then lowest value, middle, highest value and brightness."""
    lines = ["// COLOR BAND FILE STRUCTURE: nodes x;y; of the red, the green and the blue channel"]
    lines += ["".join(f"{x:.9g};{y:.6g};" for x, y in zip(places, channel, strict=True)) for channel in colors.T]
    lines += [
        "// EQUALIZER SETTINGS: lowest quality; middle; highest quality; brightness",
        f"{low:.9g};0.5;{high:.9g};1;",
    ]
    Path(path).write_text("\n".join(lines) + "\n", encoding="ascii")
