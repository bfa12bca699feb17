"""Options of a fit that are refused, and the messages that say why."""

import re

import numpy as np
import pytest

from bezier_filters import InvalidParameterError, estimate_vertex_geometry
from bezier_filters.surfaces import sphere


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"detail": 0.0}, "detail: got 0.0, expected a positive length, or None"),
        ({"detail": 0.1, "rings": 2}, "detail: rings determines the size of neighbourhoods already"),
        ({"detail": 0.1, "radius": 2.0}, "detail: radius determines the size of neighbourhoods already"),
        ({"noise": -1.0}, "noise: got -1.0, expected a length of 0 or more, or None to learn it"),
        ({"noise": "2%"}, "noise: got '2%', expected a length"),
        ({"noise": np.nan}, "noise: got nan"),
        ({"noise": True}, "noise: got True"),
        ({"noise": 0.1, "rings": 2, "alpha": 0.8}, "noise: rings and alpha are given, so the noise has no effect"),
        ({"noise": 0.1, "radius": 0.5, "alpha": 0.8}, "noise: radius and alpha are given"),
        ({"noise": 0.1, "smoothness": "paper"}, 'noise: smoothness="paper" determines rings and alpha, so'),
        ({"noise": 0.1, "smoothness": "paper", "rings": 3}, 'noise: smoothness="paper" determines rings and alpha, so'),
        ({"noise": 0.1, "smoothness": "paper", "rings": 3, "alpha": 0.5}, "noise: rings and alpha are given"),
        ({"noise": 0.1, "smoothness": "paper", "radius": 0.5}, 'radius is given and smoothness="paper" determines'),
        ({"detail": 0.1, "smoothness": "paper"}, 'detail: smoothness="paper" determines the size'),
    ],
)
def test_noise_and_detail_that_are_no_lengths_or_that_nothing_depends_on_are_refused(options, message):
    ball = sphere(resolution=8)
    with pytest.raises(InvalidParameterError, match=re.escape(message)):
        estimate_vertex_geometry(ball.vertices, ball.faces, **options)


@pytest.mark.parametrize("radius", [0, 0.0, -1.0, np.nan, np.inf, "auto", True, [1.0]])
def test_a_radius_that_is_no_positive_length_is_refused(radius):
    surface = sphere(resolution=2)
    with pytest.raises(InvalidParameterError, match=r"radius: got .*, expected a positive length, or None"):
        estimate_vertex_geometry(surface.vertices, surface.faces, radius=radius)


@pytest.mark.parametrize("options", [{}, {"smoothness": "paper"}])
def test_rings_and_radius_are_not_given_together(options):
    surface = sphere(resolution=2)
    with pytest.raises(InvalidParameterError, match=r"radius: got 0\.5 and rings=2; give one of them, not both"):
        estimate_vertex_geometry(surface.vertices, surface.faces, radius=0.5, rings=2, **options)
