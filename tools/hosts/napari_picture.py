"""A scan, its curvature and the first picture in napari: python napari_picture.py SCAN PICTURE."""

import sys
from pathlib import Path

import napari
import numpy as np

scan, picture = sys.argv[1:]
rows = [line.split() for line in Path(scan).read_text(encoding="utf-8").splitlines()]
vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], float)
faces = np.array([[corner.split("/")[0] for corner in row[1:4]] for row in rows if row[:1] == ["f"]], int) - 1

viewer = napari.Viewer(ndisplay=3)
layer = viewer.add_surface((vertices, faces))
_, widget = viewer.window.add_plugin_dock_widget("bezier-filters-adapters", "Curvature")
widget(surface=layer)  # as its button does
viewer.screenshot(picture, canvas_only=False)
