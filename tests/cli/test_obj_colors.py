"""OBJ files have colours of vertices where the input has some or a command was asked for them, and nowhere else."""

import numpy as np
import pytest
from command_line import run
from hole_cases import without_faces_near

from bezier_filters.surfaces import sphere


def write_ball(path, colors=False):
    """A ball with a hole as OBJ lines, with colours that go along x or without."""
    ball = sphere(resolution=8)
    faces = without_faces_near(ball.vertices, ball.faces, np.array([0.0, 0.0, 1.0]), 0.5)
    used, local = np.unique(faces, return_inverse=True)
    rows = ball.vertices[used]
    if colors:
        rows = np.column_stack([rows, 0.5 + 0.5 * rows[:, 0], np.full((len(rows), 2), 0.2)])
    lines = [f"v {' '.join(map(repr, row))}" for row in rows.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (local.reshape(-1, 3) + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")
    return len(rows)


def vertex_rows(path):
    return np.array([line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], float)


@pytest.mark.parametrize(
    "command",
    [
        ["fill-holes"],
        ["fill-holes", "--repair"],
        ["smooth"],
        ["smooth", "--noise", "0.01"],
        ["smooth", "--repair"],
        ["normals", "--no-color"],
        ["curvature", "--no-color"],
        ["torsion", "--no-color"],
    ],
    ids=" ".join,
)
def test_commands_add_no_colours_that_nobody_asked_for(command, tmp_path):
    write_ball(tmp_path / "in.obj")
    result = run(command[0], tmp_path / "in.obj", tmp_path / "out.obj", *command[1:])
    assert result.returncode in (0, 3), result.stderr
    assert vertex_rows(tmp_path / "out.obj").shape[1] == 3


@pytest.mark.parametrize("command", [["curvature"], ["smooth", "--quality", "displacement", "--color"]], ids=" ".join)
def test_colours_that_were_asked_for_are_written(command, tmp_path):
    write_ball(tmp_path / "in.obj")
    run(command[0], tmp_path / "in.obj", tmp_path / "out.obj", *command[1:])
    assert vertex_rows(tmp_path / "out.obj").shape[1] == 6


def test_colours_of_the_input_go_on_into_fills(tmp_path):
    count = write_ball(tmp_path / "in.obj", colors=True)
    run("fill-holes", tmp_path / "in.obj", tmp_path / "out.obj")
    before, after = vertex_rows(tmp_path / "in.obj"), vertex_rows(tmp_path / "out.obj")
    assert len(after) > count
    np.testing.assert_allclose(after[:count], before, atol=1.01 / 255)
    np.testing.assert_allclose(after[count:, 3], 0.5 + 0.5 * after[count:, 0], atol=0.03)
    np.testing.assert_allclose(after[count:, 4:], 0.2, atol=1.51 / 255)
