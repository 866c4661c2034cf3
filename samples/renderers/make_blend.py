"""Makes a small scene for Blender, out/renderers/monkey.blend: with the package bpy, or `blender -b -P samples/renderers/make_blend.py`.

A monkey's head of brushed metal beside a rough one on a tiled floor, turned a little each frame; passes: depth, normal, diffuse
colour, object index, Cryptomatte.
"""

import math
import pathlib

import bpy

MADE = pathlib.Path(__file__).resolve().parents[2] / "out" / "renderers"


def material(name, colour, metallic, roughness):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    surface = made.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*colour, 1)
    surface.inputs["Metallic"].default_value = metallic
    surface.inputs["Roughness"].default_value = roughness
    return made


def monkey(place, turn, made, index):
    bpy.ops.mesh.primitive_monkey_add(location=place, rotation=(math.radians(-20), 0, math.radians(turn)))
    head = bpy.context.object
    head.modifiers.new("smooth", "SUBSURF").render_levels = 2
    for face in head.data.polygons:
        face.use_smooth = True
    head.data.materials.append(made)
    head.pass_index = index
    return head


def main():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    head = monkey((-1.2, 0, 1), -15, material("gold", (1, 0.7, 0.3), 1, 0.2), 1)
    monkey((1.3, 0.4, 1), 20, material("clay", (0.5, 0.2, 0.12), 0, 0.6), 2)
    head.keyframe_insert("rotation_euler", frame=1)
    head.rotation_euler[2] += 0.5
    head.keyframe_insert("rotation_euler", frame=24)
    bpy.ops.mesh.primitive_plane_add(size=14)
    floor = material("tiles", (0.4, 0.4, 0.4), 0, 0.3)
    checker = floor.node_tree.nodes.new("ShaderNodeTexChecker")
    checker.inputs["Scale"].default_value = 24
    floor.node_tree.links.new(checker.outputs["Color"], floor.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    bpy.context.object.data.materials.append(floor)
    bpy.ops.object.light_add(type="AREA", location=(2, -3, 5), rotation=(math.radians(35), 0, math.radians(25)))
    bpy.context.object.data.energy, bpy.context.object.data.size = 500, 2
    scene.world = bpy.data.worlds.new("sky")
    scene.world.color = (0.25, 0.3, 0.4)
    bpy.ops.object.camera_add(location=(0.4, -7, 2.6), rotation=(math.radians(78), 0, math.radians(2)))
    scene.camera = bpy.context.object
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 480, 270
    scene.cycles.samples = 64
    layer = scene.view_layers[0]
    layer.use_pass_z = layer.use_pass_normal = layer.use_pass_object_index = layer.use_pass_diffuse_color = True
    layer.use_pass_cryptomatte_object = True
    MADE.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(MADE / "monkey.blend"))


if __name__ == "__main__":
    main()
