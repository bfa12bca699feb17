"""What fuzzing found, so that it stays mended."""

import subprocess
import sys
from pathlib import Path

import pytest
from invariants import CHECKS
from mesh_mutations import mutated

# Named after what was wrong, of the mesh, the package or the check.
MESHES = {
    "squares of curvatures beyond what a number holds": ("estimate, radius", 500881),
    "so flat that rounding says where its points are": ("estimate, fixed", 510911),
    "a rim that meets itself: edges were flipped until vertices had no face": ("fill_holes, paper", 518176),
    "areas whose powers are beyond what a number holds": ("fill_holes, paper", 557183),
    "a size beyond single precision": ("apply_coord_bezier_patch_smoothing", 20234688),
    "a point on an edge, rounded outwards": ("find_creases", 528782),
    "a share of correlated noise that rounding made negative": ("estimate, automatic", 912969),
    "robust fits of a mesh too small to tell its outliers": ("estimate, robust", 919091),
    "fits in balls of a mesh whose outliers came back": ("estimate, radius", 926063),
    "faces that reach out of a ball, and hold less curvature than its points": ("estimate, radius", 2009823),
    "squares of weights beyond what a number holds": ("estimate, robust", 3037477),
    "a vertex in faces that name another one twice, which is no neighbour": ("estimate, fixed", 3016270),
}


@pytest.mark.parametrize(("check", "seed"), MESHES.values(), ids=MESHES)
def test_a_damaged_mesh_is_survived(check, seed):
    CHECKS[check](*mutated(seed))


FUZZ = Path(__file__).parents[2] / "tools" / "fuzz_files.py"

# Named after the format and what its reader does with the file, and what that once did to the command line.
FILES = {
    "3DS, reader that runs in circles": 933,
    "3DS, bus error": 455,
    "3DS, memory beyond its end": 349,
    "3DS, memory overwritten: then our own message could not be printed any more": 759,
    "OBJ, abort": 541,
    "OBJ, index beyond the vertices": 1209,
    "PLY, memory beyond its end": 567,
}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork")
@pytest.mark.parametrize("seed", FILES.values(), ids=FILES)
def test_a_damaged_file_is_refused_or_reported(seed):
    result = subprocess.run([sys.executable, FUZZ, "--seed", str(seed)], capture_output=True, encoding="utf-8")
    assert result.returncode == 0, result.stdout + result.stderr
    assert "0 failures" in result.stdout
