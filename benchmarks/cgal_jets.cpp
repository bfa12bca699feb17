// CGAL's jet fitting at every vertex of a mesh, for benchmarks/speed.py, which compiles it.

#include <algorithm>
#include <array>
#include <vector>

#define CGAL_EIGEN3_ENABLED
#include <CGAL/Monge_via_jet_fitting.h>
#include <CGAL/Simple_cartesian.h>

using Kernel = CGAL::Simple_cartesian<double>;
using Fitting = CGAL::Monge_via_jet_fitting<Kernel>;

// Principal curvatures (n, 2) of n vertices from jets of a degree on their neighbours within two edges.
extern "C" void principal_curvatures(
    const double *vertices, long n, const int *faces, long m, long degree, double *curvatures)
{
    std::vector<std::vector<int>> neighbours(n);
    for (long f = 0; f < m; ++f)
        for (int k = 0; k < 3; ++k) {
            const int a = faces[3 * f + k], b = faces[3 * f + (k + 1) % 3];
            neighbours[a].push_back(b);
            neighbours[b].push_back(a);
        }
    for (auto &row : neighbours) {
        std::sort(row.begin(), row.end());
        row.erase(std::unique(row.begin(), row.end()), row.end());
    }
    std::vector<long> met(n, -1);
    std::vector<int> members;
    std::vector<Kernel::Point_3> points;
    const std::size_t fewest = (degree + 1) * (degree + 2) / 2;
    for (long i = 0; i < n; ++i) {
        members.assign(1, static_cast<int>(i));
        met[i] = i;
        for (std::size_t start = 0, ring = 0; ring < 2; ++ring) {
            const std::size_t stop = members.size();
            for (; start < stop; ++start)
                for (const int j : neighbours[members[start]])
                    if (met[j] != i) {
                        met[j] = i;
                        members.push_back(j);
                    }
        }
        points.clear();
        for (const int j : members)
            points.emplace_back(vertices[3 * j], vertices[3 * j + 1], vertices[3 * j + 2]);
        curvatures[2 * i] = curvatures[2 * i + 1] = 0.0;
        if (points.size() < fewest)
            continue;
        Fitting fitting;
        const auto monge = fitting(points.begin(), points.end(), degree, 2);
        curvatures[2 * i] = monge.principal_curvatures(0);
        curvatures[2 * i + 1] = monge.principal_curvatures(1);
    }
}
