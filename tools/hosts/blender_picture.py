"""A scan, its curvature and the first render in Blender, as the module bpy: python blender_picture.py SCAN PICTURE."""

import sys

import bpy

import bezier_filters_blender

scan, picture = sys.argv[1:]
bezier_filters_blender.register()
bpy.data.objects.remove(bpy.data.objects["Cube"])
bpy.ops.wm.obj_import(filepath=scan)
bpy.ops.object.bezier_curvature()
bpy.ops.view3d.camera_to_view_selected()
render = bpy.context.scene.render
render.resolution_x, render.resolution_y, render.filepath = 640, 480, picture
bpy.ops.render.render(write_still=True)
