"""Curvature and smoothing of stairs: boundaries of voxel masks, and heights in steps, of surfaces that are known.

    python benchmarks/stairs.py

Prints, for each mesh, the root mean square error of H over its size, the share of vertices whose 95 % interval of H
holds the truth, and the root mean square height over the surface before and after smoothing. It needs PyVista.
"""

import numpy as np

import bezier_filters as bf


def mask_boundary(inside, half_widths, spacing=(1.0, 1.0, 1.0)):
    """Vertices and faces of the boundary of a mask, by marching cubes; no voxel lies at the origin."""
    import pyvista

    origin = np.array([0.13, 0.27, 0.41]) * spacing
    axes = [s * np.arange(-k, k + 1) - o for k, s, o in zip(half_widths, spacing, origin, strict=True)]
    values = inside(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)).astype(np.float32)
    grid = pyvista.ImageData(dimensions=values.shape)
    surface = grid.contour([0.5], values.ravel(order="F"), method="flying_edges")
    points, place = np.unique(np.asarray(surface.points, dtype=np.float64), axis=0, return_inverse=True)
    faces = place.ravel()[surface.faces.reshape(-1, 4)[:, 1:]]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)].astype(np.int32)
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.einsum("ij,ij->", normals, corners.mean(axis=1) - points.mean(axis=0)) < 0.0:
        faces = faces[:, ::-1].copy()
    return (points - half_widths) * spacing - origin, faces


def ball_mask(radius, spacing=(1.0, 1.0, 1.0)):
    """The boundary of the mask of a ball about the origin."""
    half_widths = [int(np.ceil(radius / s)) + 3 for s in spacing]
    return mask_boundary(lambda x: np.linalg.norm(x, axis=-1) <= radius, half_widths, spacing)


def terrain(step, n=81, amplitude=5.0, wave=40.0):
    """Hills with heights in multiples of a step: vertices, faces, exact mean curvature, and inner vertices."""
    x, y = np.meshgrid(np.arange(float(n)), np.arange(float(n)), indexing="ij")
    k = 2.0 * np.pi / wave
    z = amplitude * np.sin(k * x) * np.cos(k * y)
    p, q = amplitude * k * np.cos(k * x) * np.cos(k * y), -amplitude * k * np.sin(k * x) * np.sin(k * y)
    r, s = -k * k * z, -amplitude * k * k * np.cos(k * x) * np.sin(k * y)
    mean = -((1 + q * q) * r - 2 * p * q * s + (1 + p * p) * r) / (2 * (1 + p * p + q * q) ** 1.5)
    place = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (place[:-1, :-1], place[1:, :-1], place[1:, 1:], place[:-1, 1:]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int32)
    vertices = np.stack([x, y, np.round(z / step) * step if step else z], axis=-1).reshape(-1, 3)
    inner = (np.minimum(x, y) > 4) & (np.maximum(x, y) < n - 5)
    return vertices, faces, mean.ravel(), inner.ravel()


def torus_mask(major=18.0, minor=6.0):
    """The boundary of the mask of a torus about the z axis, its exact mean curvature, and heights of points over it."""

    def height(points):
        return np.hypot(np.hypot(points[..., 0], points[..., 1]) - major, points[..., 2]) - minor

    reach = int(major + minor) + 3
    vertices, faces = mask_boundary(lambda x: height(x) <= 0.0, [reach, reach, int(minor) + 3])
    cosine = np.cos(np.arctan2(vertices[:, 2], np.hypot(vertices[:, 0], vertices[:, 1]) - major))
    return vertices, faces, 0.5 * (1.0 / minor + cosine / (major + minor * cosine)), height


def ellipsoid_mask(*radii):
    """The boundary of the mask of an ellipsoid about the origin, its mean curvature nearby, and heights over it."""
    a = np.array(radii, dtype=np.float64)

    def gradient(points):
        return 2.0 * points / a**2

    def height(points):
        """To first order."""
        return (np.square(points / a).sum(axis=-1) - 1.0) / np.linalg.norm(gradient(points), axis=-1)

    half_widths = [int(np.ceil(radius)) + 3 for radius in radii]
    vertices, faces = mask_boundary(lambda x: np.square(x / a).sum(axis=-1) <= 1.0, half_widths)
    on_surface = vertices
    for _ in range(20):
        slope = gradient(on_surface)
        slope /= np.linalg.norm(slope, axis=1)[:, np.newaxis]
        on_surface = on_surface - height(on_surface)[:, np.newaxis] * slope
    # of x^2/a^2 + y^2/b^2 + z^2/c^2 = 1, see Gray, "Modern Differential Geometry of Curves and Surfaces", 1997
    weight = np.square(on_surface / a**2).sum(axis=1)
    mean = (np.square(a).sum() - np.square(on_surface).sum(axis=1)) / (2.0 * a.prod() ** 2 * weight**1.5)
    return vertices, faces, mean, height


def cases():
    """Names, vertices, faces, mean curvature, heights of points over the surface, and vertices that count."""
    for radius, spacing in ((10, 1.0), (20, 1.0), (30, 1.0), (20, 5.0)):
        vertices, faces = ball_mask(radius, (1.0, 1.0, spacing))
        name = f"ball of radius {radius}" + (", slices 5 apart" if spacing > 1.0 else "")
        count = len(vertices)
        yield (
            name,
            vertices,
            faces,
            np.full(count, 1.0 / radius),
            lambda x, r=radius: np.linalg.norm(x, axis=1) - r,
            np.ones(count, dtype=bool),
        )
    vertices, faces, mean, height = torus_mask()
    yield "torus of radii 18 and 6", vertices, faces, mean, height, np.ones(len(vertices), dtype=bool)
    for radii in ((24, 18, 12), (40, 30, 20)):
        vertices, faces, mean, height = ellipsoid_mask(*radii)
        name = "ellipsoid of radii " + "{}, {} and {}".format(*radii)
        yield name, vertices, faces, mean, height, np.ones(len(vertices), dtype=bool)
    for step in (0.8, 1.0):
        vertices, faces, mean, inner = terrain(step)
        yield f"terrain in steps of {step}", vertices, faces, mean, terrain_height, inner


def terrain_height(points, amplitude=5.0, wave=40.0):
    """Heights of points over the hills of `terrain`."""
    k = 2.0 * np.pi / wave
    return points[:, 2] - amplitude * np.sin(k * points[:, 0]) * np.cos(k * points[:, 1])


def rms(values):
    """Root mean square."""
    return float(np.sqrt(np.square(values).mean()))


def main():
    """Print the table."""
    print("| mesh | H | intervals | height before | left by smoothing |\n|---|---|---|---|---|")
    for name, vertices, faces, mean, height, counts in cases():
        geometry = bf.estimate_vertex_geometry(vertices, faces)
        error = (geometry.mean_curvature - mean)[counts]
        held = np.mean(np.abs(error) <= 1.96 * geometry.mean_curvature_std[counts])
        smooth = bf.smooth(vertices, faces).vertices
        before, left = rms(height(vertices)[counts]), rms(height(smooth)[counts])
        print(f"| {name} | {rms(error) / rms(mean[counts]):.3g} | {held:.2f} | {before:.3f} | {left:.3f} |")


if __name__ == "__main__":
    main()
