"""A scan, its curvature and the first picture in ParaView: pvpython paraview_picture.py SCAN PICTURE."""

import sys

from paraview import simple

import bezier_filters_adapters.paraview_start  # noqa: F401

scan, picture = sys.argv[1:]
curvature = simple.BezierCurvature(Input=simple.OpenDataFile(scan))
simple.Show(curvature)
simple.Render()
simple.SaveScreenshot(picture)
