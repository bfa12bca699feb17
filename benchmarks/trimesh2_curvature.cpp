// Rusinkiewicz' curvature of vertices from trimesh2, for benchmarks/speed.py, which compiles it.

#include "TriMesh.h"
#include <cstring>

// Principal curvatures (n, 2) of n vertices.
extern "C" void principal_curvatures(
    const double *vertices, long n, const int *faces, long m, long, double *curvatures)
{
    trimesh::TriMesh mesh;
    trimesh::TriMesh::set_verbose(0);
    mesh.vertices.resize(n);
    for (long i = 0; i < n; ++i)
        mesh.vertices[i] = trimesh::point(vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]);
    mesh.faces.resize(m);
    for (long f = 0; f < m; ++f)
        mesh.faces[f] = trimesh::TriMesh::Face(faces[3 * f], faces[3 * f + 1], faces[3 * f + 2]);
    mesh.need_curvatures();
    for (long i = 0; i < n; ++i) {
        curvatures[2 * i] = mesh.curv1[i];
        curvatures[2 * i + 1] = mesh.curv2[i];
    }
}
