"""Draws the figures of docs/mathematics: python docs/images/mathematics.py [NAME ...], all of them by default."""

import sys
from collections.abc import Callable

from mathematics_curvature import draw_noise_spectrum, draw_predicted_errors, draw_variance_components
from mathematics_holes import draw_crease, draw_likelihood, draw_spline
from mathematics_smoothing import draw_estimates, draw_risk, draw_transfer_functions

FIGURES: tuple[Callable[[], None], ...] = (
    draw_predicted_errors,
    draw_variance_components,
    draw_noise_spectrum,
    draw_transfer_functions,
    draw_risk,
    draw_estimates,
    draw_spline,
    draw_likelihood,
    draw_crease,
)

if __name__ == "__main__":
    for draw in FIGURES:
        if len(sys.argv) == 1 or draw.__name__.removeprefix("draw_") in sys.argv[1:]:
            draw()
