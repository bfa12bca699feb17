"""What the surfaces refuse."""

from collections.abc import Callable

import numpy as np
import pytest

from bezier_filters import surfaces
from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import sampling
from evans_fung import red_blood_cell_at


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: surfaces.sphere(radius=0), "radius is 0"),
        (lambda: surfaces.sphere(radius=float("nan")), "radius is nan"),
        (lambda: surfaces.sphere(resolution=0), "resolution is 0"),
        (lambda: surfaces.sphere(resolution=2.5), "must be an int"),
        (lambda: surfaces.sphere(jitter=0.5), "jitter is 0.5"),
        (lambda: surfaces.sphere(jitter=-0.1), "jitter is -0.1"),
        (lambda: surfaces.ellipsoid(semi_axes=(1, 2)), "three lengths"),
        (lambda: surfaces.ellipsoid(semi_axes=(1, 2, -3)), "semi_axes is -3"),
        (lambda: surfaces.bumpy_star(amplitude=0.4), "less than 1/3"),
        (lambda: surfaces.bumpy_star(frequencies=(1, 2, np.inf)), "three finite numbers"),
        (lambda: red_blood_cell_at(np.eye(3), np.arange(3)[None]), "off by up to 0.99, expected"),
        (lambda: surfaces.torus(minor_radius=1.0), "less than major_radius"),
        (lambda: surfaces.torus(resolution=5), "at least 6"),
        (lambda: surfaces.cylinder(length=-1), "length is -1"),
        (lambda: surfaces.waves(wavelength=0), "wavelength is 0"),
        (lambda: surfaces.waves(amplitude=np.inf), "amplitude is inf"),
        (lambda: surfaces.monkey_saddle(strength=np.nan), "strength is nan"),
        (lambda: surfaces.height_field(lambda x, y: (x, 1, 0)), "returned 3 values"),
        (lambda: surfaces.height_field(lambda x, y: (x * np.nan, 1, 0, 0, 0, 0)), "not finite"),
        (lambda: surfaces.punched_patch(holes=[(0, 0, 0.01)]), "raise resolution or radius"),
        (lambda: surfaces.punched_patch(holes=[(0, 0, 0.95)]), "raise resolution or move"),
        (lambda: surfaces.punched_patch(holes=[(0, 0, 0.3), (0.5, 0, 0.2)]), "raise resolution or move"),
        (lambda: surfaces.punched_patch(holes=[(0, np.nan, 0.3)]), "finite triples"),
        (lambda: sampling.rectangle((9, 9), wrapped=(True, False), holes=[(4, 4, 1)]), "wrapped rectangle"),
        (lambda: surfaces.block_with_sharp_edges(resolution=7), "must be even"),
        (lambda: surfaces.block_with_sharp_edges(size=0), "size is 0"),
    ],
)
def test_nonsense_is_refused_with_the_reason(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InvalidParameterError, match=message):
        call()
