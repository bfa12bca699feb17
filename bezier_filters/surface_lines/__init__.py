"""Lines on the surface of the patches: lines of curvature, torsion and given normal curvature, and curves along it."""
