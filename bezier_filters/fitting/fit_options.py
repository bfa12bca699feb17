"""Checks the user's options of a fit, and separates fixed parameters from automatic ones."""

from typing import Literal

import numpy as np

from bezier_filters.errors import InvalidParameterError, is_integer, is_real
from bezier_filters.meshes.mesh import MAX_COORDINATE
from bezier_filters.meshes.neighbourhoods import MAX_NEIGHBOURHOOD_RINGS
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.surface_model.fit_spec import CANDIDATE_DEGREES

Automatic = Literal["auto"]


def fit_options(
    rings: object, alpha: object, degree: object, smoothness: Smoothness
) -> tuple[int | Automatic, PatchFit | None, tuple[int, ...]]:
    """Rings, fixed patch and candidate degrees: "auto" and None are chosen by the data."""
    if smoothness == "paper":
        rings, alpha = (2 if rings == "auto" else rings), (0.8 if alpha == "auto" else alpha)
    if rings != "auto" and not (is_integer(rings) and 1 <= rings <= MAX_NEIGHBOURHOOD_RINGS):
        raise InvalidParameterError(
            f"rings: got {rings!r}, expected an integer from 1 to {MAX_NEIGHBOURHOOD_RINGS}, or 'auto'"
        )
    checked: int | Automatic = int(rings) if is_integer(rings) else "auto"
    if alpha == "auto":
        if degree != "auto" and degree not in CANDIDATE_DEGREES:
            raise InvalidParameterError(f"degree: got {degree!r}, expected one of {CANDIDATE_DEGREES}, or 'auto'")
        if smoothness != "third_order":
            raise InvalidParameterError(
                f"smoothness: got {smoothness!r}, expected 'third_order' or 'paper', or a number for alpha"
            )
        return checked, None, CANDIDATE_DEGREES if degree == "auto" else (int(degree),)
    fixed = PatchFit(3 if degree == "auto" else degree, alpha, smoothness)  # type: ignore[arg-type]
    return checked, fixed, CANDIDATE_DEGREES if degree == "auto" else (fixed.degree,)


def check_radius(radius: object, rings: object) -> None:
    """Refuse a radius that is not a length, or a radius together with a number of rings."""
    if radius is None:
        return
    if not (is_real(radius) and 0.0 < radius < np.inf):
        raise InvalidParameterError(f"radius: got {radius!r}, expected a positive length, or None")
    if rings != "auto":
        raise InvalidParameterError(f"radius: got {radius!r} and rings={rings!r}; give one of them, not both")


def check_noise(noise: object) -> None:
    """Refuse a standard deviation of the noise that is not a length."""
    if noise is not None and not (is_real(noise) and 0.0 <= noise < np.inf):
        raise InvalidParameterError(f"noise: got {noise!r}, expected a length of 0 or more, or None to learn it")
    if noise is not None and noise > MAX_COORDINATE:
        raise InvalidParameterError(
            f"noise: got {noise!r}, expected no more than coordinates may be, {MAX_COORDINATE:g}"
        )


def check_detail(detail: object, rings: object = "auto", radius: object = None) -> None:
    """Refuse a size of detail that is not a length, or one together with the size of the neighbourhood."""
    if detail is None:
        return
    if not (is_real(detail) and 0.0 < detail < np.inf):
        raise InvalidParameterError(f"detail: got {detail!r}, expected a positive length, or None")
    if rings != "auto" or radius is not None:
        size = "rings" if radius is None else "radius"
        raise InvalidParameterError(f"detail: {size} determines the size of neighbourhoods already; omit one of them")


def check_fit_noise(noise: object, fixed: PatchFit | None, rings: object, radius: object = None) -> None:
    """Refuse a standard deviation of the noise that is not a length, or on which nothing depends."""
    check_noise(noise)
    if noise is not None and fixed is not None and (rings != "auto" or radius is not None):
        size = "rings" if radius is None else "radius"
        raise InvalidParameterError(f"noise: {size} and alpha are given, so the noise has no effect; omit it")
