"""Filters of clouds in other programs, each at a radius in spacings: moving least squares of three kinds."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

Peer = Callable[[np.ndarray, float, float], np.ndarray]  # points, spacing, radius in spacings -> points
MIN_NEIGHBOURS = 8  # of a quadratic fit, as in PCL


def open3d_mls(points: np.ndarray, spacing: float, radius: float) -> np.ndarray:
    """Open3D's `smooth_mls`: planes with Gaussian weights."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    return np.asarray(cloud.smooth_mls(open3d.geometry.KDTreeSearchParamRadius(radius * spacing)).points)


def pcl_mls(points: np.ndarray, spacing: float, radius: float) -> np.ndarray:
    """PCL's MovingLeastSquares as `pcl::MLSResult` computes it, of order 2, with projection NONE at the point itself.

    The plane is the least-squares plane of the points within the radius; the polynomial over it has the weights
    exp(-d^2 / radius^2), and the point moves to its value above the projection of the point.
    """
    tree, result = cKDTree(points), points.copy()
    for i, near in enumerate(tree.query_ball_point(points, radius * spacing)):
        if len(near) < MIN_NEIGHBOURS:
            continue
        around = points[near]
        mean = around.mean(axis=0)
        axes = np.linalg.svd(around - mean, full_matrices=False)[2]
        origin = points[i] - ((points[i] - mean) @ axes[2]) * axes[2]
        u, v, z = ((around - origin) @ axes.T).T
        weights = np.exp(-0.5 * ((around - origin) ** 2).sum(axis=1) / (radius * spacing) ** 2)
        terms = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
        value = np.linalg.lstsq(terms * weights[:, None], z * weights, rcond=None)[0][0]
        result[i] = origin + value * axes[2]
    return result


def meshlab_mls(name: str) -> Peer:
    """Projection of the points onto MeshLab's APSS or RIMLS surface of the cloud, with normals of ten neighbours."""

    def project(points: np.ndarray, spacing: float, radius: float) -> np.ndarray:
        import pymeshlab

        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(points))
        ms.compute_normal_for_point_clouds(k=20)
        ms.add_mesh(pymeshlab.Mesh(points, v_normals_matrix=ms.current_mesh().vertex_normal_matrix()))
        # the names are the other way round: it moves `proxymesh`, and ends the process if that is the second mesh
        getattr(ms, f"compute_mls_projection_{name}")(controlmesh=1, proxymesh=0, filterscale=radius)
        ms.set_current_mesh(0)
        return ms.current_mesh().vertex_matrix()

    return project


PEERS: dict[str, tuple[Peer, tuple[float, ...]]] = {
    "Open3D": (open3d_mls, (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)),
    "PCL": (pcl_mls, (2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)),
    "APSS": (meshlab_mls("apss"), (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0)),
    "RIMLS": (meshlab_mls("rimls"), (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)),
}
