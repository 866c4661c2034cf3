#!/usr/bin/env python3
"""Renders only the masked pixels of a Blender scene with Cycles, for `lacuna fill`: a multi-part EXR file a frame.

    blender -b shot.blend -P blender_sparse.py -- -o frame.####.exr --frames 1-24 --density 0.25
    python blender_sparse.py shot.blend -o frame.####.exr --mask mask.exr --spp 64          (with the package bpy)

The scene's camera becomes one in Open Shading Language that does the same but sends no ray through a pixel outside the mask.
The pixel filter becomes a box, denoising and compositing are off. Every pass of the view layers is written, one part a
pass, as Blender does; one part more holds the channel `mask`. For perspective cameras (lens, shift, sensor fit, depth
of field); all of the frame, on processors or with OptiX. Needs Blender 4.5 or newer, or its package bpy; nothing else.
"""

import functools
import itertools
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import bridge  # noqa: E402
from bridge import Failure  # noqa: E402

with bridge.needing("bpy numpy", "run this in Blender"):
    import bpy
    import numpy as np

    try:
        import OpenImageIO as oiio
    except ImportError:  # the package bpy brings it along, but not on the path
        local = pathlib.Path(bpy.utils.resource_path("LOCAL")) / "python" / "lib"
        sys.path += [str(folder) for folder in local.glob("python3.*/site-packages")]
        import OpenImageIO as oiio

    import sparse

# Depths from here on are those of the background.
FAR = 1e9
# Positions on the sensor are in millimetres, x to the right and y up, as Cycles has them.
SHADER = """
shader masked(output point position = 0.0, output vector direction = 0.0, output color throughput = 1.0)
{{
  point raster = camera_shader_raster_position();
  float wanted = texture("{mask}", raster.x, 1.0 - raster.y, "interp", "closest", "width", 0.0);
  if (wanted < 0.5) {{
    throughput = color(0.0);
    return;
  }}
  vector sensor;
  getattribute("cam:sensor_size", sensor);
  point place = (raster - vector(0.5) + vector({shift_x}, {shift_y}, 0.0)) * sensor;
  direction = normalize(vector(place.x, place.y, {lens}));
  if ({blurred}) {{
    float distance;
    getattribute("cam:focal_distance", distance);
    getattribute("cam:aperture_position", position);
    position *= {lens} * 1e-3;
    direction = normalize(direction * (distance / direction.z) - position);
  }}
}}
"""


def check(scene):
    """Refuses what would render all pixels, or other files."""
    if scene.render.use_multiview:
        raise Failure("the scene has several views (stereo), which are not followed: switch Stereoscopy off in its output")
    cycles = bpy.context.preferences.addons.get("cycles")
    kind = cycles.preferences.compute_device_type if cycles and scene.cycles.device == "GPU" else "NONE"
    if kind not in ("NONE", "OPTIX"):
        raise Failure(f"Cycles on {kind} knows no cameras in Open Shading Language: set the scene's device to CPU, or take OptiX")


def set_up(scene, spp, seed):
    """What sparse rendering needs of a scene; its other settings stay."""
    scene.render.engine = "CYCLES"
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 1.0
    scene.cycles.use_denoising = False
    scene.cycles.samples = spp or scene.cycles.samples
    scene.cycles.seed = (scene.cycles.seed + seed) % (1 << 31)
    scene.render.use_compositing = scene.render.use_sequencer = scene.render.use_border = False
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth = "32"
    settings.exr_codec = "ZIP"


def followed(scene, frame, ours):
    """The camera of this frame, which a marker may have bound; `ours` has the names of those that have the shader by now."""
    camera = scene.camera.data if scene.camera else None
    if camera is None or (camera.type != "PERSP" and camera.name not in ours):
        kind = f"'{camera.name}' is of type {camera.type}" if camera else "there is none"
        raise Failure(f"frame {frame}: the scene needs a perspective camera, and {kind}")
    if scene.render.pixel_aspect_x != scene.render.pixel_aspect_y:
        raise Failure(f"frame {frame}: pixels that are not square are not followed: set the aspect of the scene's resolution to 1 and 1")
    return camera


def put_camera(scene, frame, shifts, mask_file, width, height):
    """Gives the scene's camera the shader with its own lens as it is in this frame; returns what a depth along the
    ray is to be multiplied by."""
    scene.frame_set(frame)
    camera = followed(scene, frame, shifts)
    # A shift is a share of the side that the sensor is fitted to. Cycles would add its own, in other units.
    shift = shifts.setdefault(camera.name, (camera.shift_x, camera.shift_y))
    camera.shift_x = camera.shift_y = 0
    scene.frame_set(frame)
    if camera.shift_x or camera.shift_y:
        raise Failure("the camera's shift is animated: keep it constant")
    vertical = camera.sensor_fit == "VERTICAL" or (camera.sensor_fit == "AUTO" and height > width)
    fit = height if vertical else width
    words = {"mask": mask_file.as_posix(), "lens": camera.lens, "shift_x": shift[0] * fit / width, "shift_y": shift[1] * fit / height}
    text = bpy.data.texts.get("masked camera") or bpy.data.texts.new("masked camera")
    text.from_string(SHADER.format(blurred=int(camera.dof.use_dof), **words))
    camera.type, camera.custom_mode, camera.custom_shader = "CUSTOM", "INTERNAL", text
    from cycles import osl

    said = []
    if not osl.update_custom_camera_shader(camera, lambda kind, message: said.append(message)):
        raise Failure(f"the camera cannot be compiled: {'; '.join(said)}")
    side = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    y, x = np.indices((height, width))
    x = ((x + 0.5) / width - 0.5 + words["shift_x"]) * side * width / fit
    y = (0.5 - (y + 0.5) / height + words["shift_y"]) * side * height / fit
    return camera.lens / np.sqrt(x * x + y * y + camera.lens**2)


def write_plane(path, plane):
    spec = oiio.ImageSpec(plane.shape[1], plane.shape[0], 1, "half")
    spec.channelnames = ["mask"]
    spec.attribute("compression", "zip")
    out = oiio.ImageOutput.create(str(path))
    if not out or not out.open(str(path), spec) or not out.write_image(plane.astype(np.float32)[..., None]) or not out.close():
        raise Failure(f"{path}: cannot be written: {oiio.geterror()}")


def add_mask(source, target, mask, straight):
    """Copies the parts of `source` and adds one with the mask and lacuna's attributes. Depths are multiplied by `straight`:
    cameras of one's own write distances along the ray."""
    file = oiio.ImageInput.open(str(source))
    if not file:
        raise Failure(f"{source}: cannot be read: {oiio.geterror()}")
    specs, planes = [], []
    while file.seek_subimage(len(specs), 0):
        specs.append(file.spec().copy())
        planes.append(file.read_image(len(specs) - 1, 0, 0, specs[-1].nchannels, "float"))
        if specs[-1].channelnames[-1].endswith("Depth.Z"):
            depth = planes[-1][..., -1]
            planes[-1][..., -1] = np.where(depth < FAR, depth * straight, depth)
    file.close()
    spec = oiio.ImageSpec(mask.shape[1], mask.shape[0], 1, "half")
    spec.channelnames = ["mask"]
    for name, value in (("compression", "zip"), ("oiio:subimagename", "mask"), ("lacuna/mask", "mask")):
        spec.attribute(name, value)
    spec.attribute("lacuna/density", float(mask.mean()))
    specs.append(spec)
    planes.append(mask.astype(np.float32)[..., None])
    with sparse.temporary(target, ".exr") as part:
        out = oiio.ImageOutput.create(str(part))
        done = out.open(str(part), tuple(specs))
        for at, (spec, plane) in enumerate(zip(specs, planes, strict=True)):
            done = done and (at == 0 or out.open(str(part), spec, "AppendSubimage")) and out.write_image(plane)
        if not (done and out.close()):
            raise Failure(f"{target}: cannot be written: {out.geterror()}")


def render(arguments, scene, shifts, folder, frame):
    # In whole numbers, as Blender has them.
    width, height = (side * scene.render.resolution_percentage // 100 for side in (scene.render.resolution_x, scene.render.resolution_y))
    turns = itertools.count()

    def draw(mask, target):
        # A name of its own for each round: Blender keeps images by their names.
        pixels = folder / f"mask.{frame}.{next(turns)}.exr"
        write_plane(pixels, mask)
        straight = put_camera(scene, frame, shifts, pixels, width, height)
        whole = folder / f"whole.{frame}.exr"
        scene.render.filepath = str(whole)
        clock = sparse.Clock()
        if bpy.ops.render.render(write_still=True) != {"FINISHED"}:
            raise Failure(f"frame {frame}: Blender gave up rendering it")
        clock.stop()
        add_mask(whole, target, mask, straight)
        whole.unlink()
        return mask, clock

    sparse.frame(arguments, frame, (width, height), draw)


def parse():
    inside = bpy.data.filepath or "--" in sys.argv
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [] if bpy.data.filepath else sys.argv[1:]
    parser = bridge.Parser(__doc__)
    if not inside:
        parser.add_argument("scene", help="the .blend file; blender -b takes it before -P")
    sparse.add_arguments(parser)
    arguments = parser.parse_args(words)
    if not inside:
        if not pathlib.Path(arguments.scene).is_file():
            raise Failure(f"{arguments.scene}: no such file")
        try:
            with sparse.quiet():
                bpy.ops.wm.open_mainfile(filepath=str(pathlib.Path(arguments.scene).resolve()))
        except RuntimeError as error:
            raise Failure(f"{arguments.scene}: {bridge.brief(error).removeprefix('Error: ')}") from None
    return arguments


def main():
    arguments = parse()
    scene = bpy.context.scene
    arguments.frames = arguments.frames or [scene.frame_current]
    frames = sparse.check(arguments, bpy.data.filepath)
    check(scene)
    set_up(scene, arguments.spp, arguments.seed)
    shifts = {}
    with tempfile.TemporaryDirectory() as folder:
        what = bpy.data.filepath or "the scene"
        sparse.each(what, frames, functools.partial(render, arguments, scene, shifts, pathlib.Path(folder)))


if __name__ == "__main__":
    bridge.run(main)
