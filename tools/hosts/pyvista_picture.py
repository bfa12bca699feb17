"""A scan, its curvature and the first picture in PyVista: python pyvista_picture.py SCAN PICTURE."""

import sys

import pyvista

import bezier_filters_adapters.pyvista_accessor  # noqa: F401

scan, picture = sys.argv[1:]
mesh = pyvista.read(scan)
mesh.bezier.curvature().bezier.plot(off_screen=True, screenshot=picture)
