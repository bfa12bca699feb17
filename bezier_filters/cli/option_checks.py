"""Checks of options that need no mesh, before one is read."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bezier_filters.errors import InvalidParameterError, is_real
from bezier_filters.parameters import LENGTH_TYPE, Parameter

if TYPE_CHECKING:
    from bezier_filters.surface_model.fit_options import FitOptions

_MAY_BE_ZERO = ("noise", "refnoise")  # lengths


def check_options(parameters: Sequence[Parameter], given: Mapping[str, Any]) -> None:
    """Refuse words, lengths and colours of options that no mesh allows; the filters check the rest."""
    kinds = {item.name: item.kind for item in parameters}
    values = {name: given[name] for name in kinds.keys() & given.keys() if given[name] is not None}
    for name in (name for name in kinds if name in values):
        if kinds[name].startswith("{"):
            _check_word(name, values[name], kinds[name])
        if kinds[name] == LENGTH_TYPE and is_real(values[name]):
            _check_length(name, values[name])
    if "smoothness" in kinds:
        _fit_options(values).check()
    if "colormap" in values:
        check_colors(values)


def check_picture_options(
    *,
    views: Sequence[str] | None = None,
    up: str,
    front: str,
    colormap: str | None = None,
    percentile: float = 0.0,
    limits: tuple[float, float] | None = None,
) -> None:
    """Refuse views, axes and colours of a picture that no mesh allows."""
    from bezier_filters.display import check_percentile
    from bezier_filters.meshlab.mesh_colors import check_limits
    from bezier_filters.pictures.render import check_colormap, check_views
    from bezier_filters.pictures.views import check_axes

    check_views(views or ())
    check_axes(up, front)
    if colormap is not None:
        check_colormap(colormap)
    check_percentile(percentile)
    if limits is not None:
        check_limits(*limits)


def _check_word(name: str, value: str, kind: str) -> None:
    words = [word.strip().strip('"') for word in kind[1 : kind.index("}")].split(",")]
    if value not in words:
        expected = ", ".join(map(repr, words[:-1])) + f" or {words[-1]!r}"
        raise InvalidParameterError(f"{name}: got {value!r}, expected {expected}")


def _check_length(name: str, value: float) -> None:
    if name in _MAY_BE_ZERO and not value >= 0.0:
        raise InvalidParameterError(f"{name}: got {value!r}, expected a length of 0 or more")
    if name not in _MAY_BE_ZERO and not value > 0.0:
        raise InvalidParameterError(f"{name}: got {value!r}, expected a positive length")


def _fit_options(values: Mapping[str, Any]) -> "FitOptions":
    """Options of the fit; percentages are checked where they are parsed, and stand for a length of 1."""
    from bezier_filters.surface_model.fit_options import FitOptions

    names = ("rings", "alpha", "degree", "smoothness", "robust", "neighbours")
    radius = values.get("radius")
    length = radius if radius is None or is_real(radius) else 1.0
    return FitOptions(**{name: values[name] for name in names if name in values}, radius=length)


def check_colors(values: Mapping[str, Any]) -> None:
    """Refuse a colour map of pymeshlab, a percentile or a colour range that no mesh allows."""
    from bezier_filters.display import check_percentile
    from bezier_filters.meshlab.mesh_colors import check_limits, find_color_map

    find_color_map(values["colormap"])
    check_percentile(values["percentile"])
    if "colorrange" in values:
        check_limits(*values["colorrange"])
