"""The paper's test of stability: vertices of the bunny are deleted, and the same places are estimated again."""

import numpy as np
import pytest
from numba import config

from bezier_filters.meshlab.meshset import bunny_path
from reduction import measured, methods, model

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")

LARGEST_RATIO = 1.15  # of the deviations of normals and H, automatic over those on 2 rings


def ratios(percentages, seed):
    """Deviations of normal and H of the automatic choice over those of the fit on 2 rings, (percentages, 2)."""
    names = "automatic", "automatic on 2 rings"
    compared = {name: methods(slow=False)[name] for name in names}
    rows = measured(*model(bunny_path()), compared, percentages, (0.0,), seed)
    automatic, on_two_rings = (np.array([row[3:5] for row in rows if row[2] == name]) for name in names)
    return automatic / on_two_rings


@pytest.mark.slow  # the choice itself is looked at in `test_region_fits`, on the same scan with 30 % deleted
def test_automatic_choice_is_as_stable_as_two_rings():
    """Detail of the scan counted as correlated noise, for the seeds 0 and 2: normals moved 3.75 degrees, not 1.3."""
    assert ratios((30,), 2).max() < LARGEST_RATIO


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_automatic_choice_is_as_stable_at_every_share(seed):
    assert ratios((10, 30, 50), seed).max() < LARGEST_RATIO
