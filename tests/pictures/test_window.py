"""The window of `view`: what is in it, off the screen, and that it opens and closes on a display."""

import os
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import pyvista

from bezier_filters.pictures.scene import Panel, window
from bezier_filters.surfaces import torus

SAMPLES = Path(__file__).parents[2] / "sample_meshes"


@pytest.fixture
def opened():
    """A window, off the screen, with the height of a torus, its distance from the axis, and the torus in grey."""
    shape = torus(resolution=12)
    x, y, z = shape.vertices.T
    panels = [
        Panel(shape.vertices, shape.faces, z, label="height", unit="length", signed=True, title="one"),
        Panel(shape.vertices, shape.faces, np.hypot(x, y), label="height", unit="length", title="two"),
        Panel(shape.vertices, shape.faces, colors=np.full((len(x), 3), 0.75), title="three"),
    ]
    with pyvista.vtk_verbosity("error"):
        plotter = window(panels, up="z", off_screen=True)
        yield plotter
        plotter.close()


def image(plotter):
    plotter.render()
    return plotter.screenshot(None, return_img=True).astype(int)


def test_every_panel_has_its_mesh_in_its_colours(opened):
    thirds = np.array_split(image(opened), 3, axis=1)
    red_and_blue = [[(part[:500, :, a] - part[:500, :, b] > 60).sum() for a, b in ((0, 2), (2, 0))] for part in thirds]
    assert min(red_and_blue[0]) > 500  # low and high
    assert red_and_blue[1][1] > 500  # Viridis has no red
    assert red_and_blue[2] == [0, 0]
    background = [(part == 255).all(axis=2).mean() for part in thirds]
    assert all(0.3 < share < 0.9 for share in background)


def test_every_panel_with_values_has_a_bar_with_its_unit(opened):
    """Also where two have the same label."""
    actors = [renderer.actors.values() for renderer in opened.renderers]
    bars = [[actor for actor in every if actor.GetClassName() == "vtkScalarBarActor"] for every in actors]
    assert [len(of_panel) for of_panel in bars] == [1, 1, 0]
    assert bars[0][0].GetTitle().strip() == "height [length]"


def test_meshes_of_any_size_and_place_are_seen_whole():
    small, large = torus(resolution=12), torus(resolution=12, minor_radius=0.9)
    panels = [
        Panel(shift + shape.vertices, shape.faces, colors=np.full((len(shape.vertices), 3), 0.75))
        for shape, shift in [(small, 0.0), (large, 2.0)]
    ]
    with pyvista.vtk_verbosity("error"):
        plotter = window(panels, off_screen=True)
        halves = np.array_split(image(plotter), 2, axis=1)
        plotter.close()
    for half in halves:
        assert (half != 255).any()
        assert (np.concatenate([half[:, 0], half[:, -1], half[0], half[-1]]) == 255).all()


def test_the_panels_turn_together(opened):
    before = image(opened)
    opened.camera.elevation = 40.0
    for part, turned in zip(np.array_split(before, 3, axis=1), np.array_split(image(opened), 3, axis=1), strict=True):
        assert (part[:500] != turned[:500]).mean() > 0.05


@pytest.mark.slow
@pytest.mark.skipif(not (shutil.which("Xvfb") and shutil.which("xwininfo")), reason="needs Xvfb and xwininfo")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_opens_a_window_that_ctrl_c_closes(number):
    ours, theirs = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(theirs), "-screen", "0", "1100x800x24"], pass_fds=[theirs], stderr=subprocess.DEVNULL
    )
    try:
        assert select.select([ours], [], [], 30)[0], "Xvfb does not start"
        display = {"DISPLAY": f":{os.read(ours, 20).decode().strip()}"}
        command = [sys.executable, "-m", "bezier_filters", "view", str(SAMPLES / "torus.ply")]
        viewer = subprocess.Popen(command, env=os.environ | display)
        try:
            end = time.monotonic() + 60
            listed = ""
            while '"bezier-filters"' not in listed and time.monotonic() < end:
                assert viewer.poll() is None
                time.sleep(0.2)
                tree = ["xwininfo", "-root", "-tree"]
                listed = subprocess.run(tree, env=os.environ | display, capture_output=True, text=True).stdout
            assert '"bezier-filters"' in listed
            viewer.send_signal(number)
            assert viewer.wait(timeout=30) == 128 + number
        finally:
            viewer.kill()
            viewer.wait()
    finally:
        server.terminate()
        server.wait()
