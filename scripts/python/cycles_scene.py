"""Renders a small scene with Cycles, for scripts/upscaling: python cycles_scene.py SIDE SAMPLES OUTPUT [vectors] (with the package bpy).

With `vectors` things move, and the file has all layers, motion vectors among them.
"""

import sys

import bpy

side, samples, output = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
vectors = sys.argv[4:] == ["vectors"]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene


def surface(name, colour, roughness, metallic=0.0, checkers=0):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    if checkers:
        texture = material.node_tree.nodes.new("ShaderNodeTexChecker")
        texture.inputs["Scale"].default_value = checkers
        texture.inputs["Color1"].default_value = (*colour, 1)
        texture.inputs["Color2"].default_value = (0.1, 0.1, 0.12, 1)
        material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    bpy.context.object.data.materials.append(material)


def moved(what, to):
    """Moves the object from where it is in frame 1 to there in frame 2."""
    if vectors:
        thing = bpy.context.object
        thing.keyframe_insert(what, frame=1)
        setattr(thing, what, to)
        thing.keyframe_insert(what, frame=2)


bpy.ops.mesh.primitive_plane_add(size=12)
surface("floor", (0.7, 0.65, 0.6), 0.7, checkers=9)
bpy.ops.mesh.primitive_monkey_add(size=2, location=(-0.9, 0, 1), rotation=(-0.5, 0, -0.3))
surface("red", (0.7, 0.15, 0.1), 0.5)
moved("rotation_euler", (-0.5, 0, -0.1))
bpy.ops.mesh.primitive_torus_add(location=(1.2, 0.2, 0.6), rotation=(1.1, 0.3, 0), major_radius=0.7, minor_radius=0.22,
                                 major_segments=96, minor_segments=32)
surface("metal", (0.8, 0.8, 0.75), 0.25, metallic=1.0)
moved("location", (1.4, 0.1, 0.7))
bpy.ops.object.light_add(type="AREA", location=(3, -3, 5), rotation=(0.6, 0.35, 0.4))
bpy.context.object.data.energy, bpy.context.object.data.size = 400, 1.5
world = bpy.data.worlds.new("world")
scene.world = world
world.use_nodes = True
world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.25, 0.3, 0.4, 1)
bpy.ops.object.camera_add(location=(0, -6, 3), rotation=(1.15, 0, 0))
scene.camera = bpy.context.object
moved("location", (0.1, -5.9, 3))

scene.render.engine = "CYCLES"
scene.cycles.samples = samples
scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
scene.cycles.seed = side
scene.cycles.pixel_filter_type = "BOX"  # as the bridge renders
scene.render.resolution_x = scene.render.resolution_y = side
if vectors:
    scene.render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.view_layers[0].use_pass_vector = True
    scene.frame_set(1)
else:
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGB"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = output
bpy.ops.render.render(write_still=True)
