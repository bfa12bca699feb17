"""Draws the picture of baked textures in docs/filters/textures.md: python docs/images/textures.py.

The textured bunny that pymeshlab installs: its curvature map, the map on the mesh, the shaded mesh, and the same with
its normal map.
"""

from pathlib import Path

import numpy as np
import pymeshlab
import pyvista as pv
from vtkmodules.util.numpy_support import numpy_to_vtk

import bezier_filters as bf
from bezier_filters.textures.patch_normals import tangent_spaces, unit_vectors

FOLDER = Path(__file__).parent
BUNNY = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / "bunny10k_textured.obj"
SIZE, CORNER = 1024, 560  # texels of the maps, and of the part of the map that is shown
PANEL = 330  # pixels


def in_bytes(image: np.ndarray) -> np.ndarray:
    """Texels as red, green and blue."""
    grey = np.floor(255.0 * image + 0.5).astype(np.uint8)
    return grey if grey.ndim == 3 else np.repeat(grey[..., np.newaxis], 3, axis=2)


def split_corners(ms: pymeshlab.MeshSet) -> tuple[pv.PolyData, np.ndarray]:
    """The mesh with corners of their own for every face, with axes of a normal map; and its texture coordinates."""
    mesh = ms.current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    coordinates = mesh.wedge_tex_coord_matrix().reshape(-1, 3, 2)
    spaces = tangent_spaces(vertices, faces, coordinates, unit_vectors(mesh.vertex_normal_matrix()))
    corners = pv.PolyData.from_regular_faces(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))
    corners.active_texture_coordinates = coordinates.reshape(-1, 2)
    for name, vectors in (("Normals", spaces.normals), ("Tangents", spaces.tangents)):
        array = numpy_to_vtk(vectors.reshape(-1, 3).astype(np.float32), deep=True)
        array.SetName(name)
        getattr(corners.GetPointData(), f"Set{name}")(array)
    return corners, coordinates


def main() -> None:
    """Write the picture."""
    ms = bf.load_mesh(BUNNY)
    corners, coordinates = split_corners(ms)
    mesh = ms.current_mesh()
    arrays = mesh.vertex_matrix(), mesh.face_matrix(), coordinates
    curvature = bf.bake_texture(*arrays, size=SIZE)
    normals = bf.bake_texture(*arrays, "normal", size=SIZE, geometry=curvature.geometry)
    print(curvature, normals, sep="\n")
    plotter = pv.Plotter(shape=(1, 4), window_size=(4 * PANEL, PANEL), border=False, off_screen=True)
    plotter.add_mesh(pv.Plane(), texture=pv.Texture(in_bytes(curvature.image)[-CORNER:, :CORNER]), lighting=False)
    plotter.view_xy()
    plotter.camera.zoom(1.3)
    for place, texture in ((1, curvature.image), (2, None), (3, normals.image)):
        plotter.subplot(0, place)
        if place == 1:
            plotter.add_mesh(corners, texture=pv.Texture(in_bytes(texture)), lighting=False)
        else:
            actor = plotter.add_mesh(corners, color="white", pbr=True, roughness=0.3)
            actor.prop.SetInterpolationToPBR()
            if texture is not None:
                actor.prop.SetNormalTexture(pv.Texture(in_bytes(texture)))
        plotter.view_vector((0.2, 0.3, 1.0), viewup=(0.0, 1.0, 0.0))
        plotter.camera.zoom(1.4)
    plotter.screenshot(FOLDER / "textures.png")


if __name__ == "__main__":
    main()
