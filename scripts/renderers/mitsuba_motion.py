"""Motion vectors of Mitsuba's scenes, which has none of its own: where what each pixel shows lies in the next frame's picture.

What the ray through a pixel's centre hits first is followed by its triangle and the place on it, or by the shape's `to_world`; what has
neither (instances, shapes of other kinds) stands still, and so does what lies at infinity, but for the camera. A thin lens is taken for
the pinhole in its middle.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from bridge import Failure

# Where what no ray hits is taken to lie.
FAR = 1e6


def vectors(scene, later, size):
    """The planes `motion.X` and `motion.Y` of all pixels: across and down, in pixels."""
    before, after = scene.sensors()[0], later.sensors()[0]
    if not dr.is_jit_v(mi.Float):
        raise Failure(f"--motion: variant {mi.variant()} follows no lists of points: take an llvm one")
    if len(scene.shapes()) != len(later.shapes()):
        raise Failure(f"--motion: the scene has {len(scene.shapes())} shapes, in the next frame {len(later.shapes())}")
    width, height = size
    at = dr.arange(mi.UInt32, width * height)
    pixel = mi.Point2f(mi.Float(at % width) + 0.5, mi.Float(at // width) + 0.5)
    ray, _ = before.sample_ray(0.0, 0.5, pixel / mi.Point2f(width, height), mi.Point2f(0.5))
    found = scene.ray_intersect_preliminary(ray)
    here = ray(dr.select(found.is_valid(), found.t, FAR))
    there = here
    for shape, next_shape in zip(scene.shapes(), later.shapes()):
        place = followed(shape, next_shape, here, found)
        if place is not None:
            there = dr.select(found.is_valid() & (found.shape == mi.ShapePtr(shape)), place, there)
    # Both by the same way, so that what stands still has exactly 0.
    motion = (project(after, there, size) - project(before, here, size)).numpy().reshape(2, height, width)
    motion = np.where(np.abs(motion) < 1e-4, 0, motion).astype(np.float32)
    return {"motion.X": motion[0], "motion.Y": motion[1]}


def followed(shape, later, here, found):
    """Where points of a shape lie in the next frame; nothing if that cannot be told."""
    if isinstance(shape, mi.Mesh) and isinstance(later, mi.Mesh) and shape.face_count() == later.face_count():
        active = found.is_valid() & (found.shape == mi.ShapePtr(shape))
        corners = later.face_indices(dr.select(active, found.prim_index, 0), active)
        a, b, c = (later.vertex_position(corner, active) for corner in (corners.x, corners.y, corners.z))
        u, v = found.prim_uv.x, found.prim_uv.y
        return a * (1 - u - v) + b * u + c * v
    before, after = (mi.traverse(one) for one in (shape, later))
    if "to_world" not in before or "to_world" not in after:
        return None
    return after["to_world"] @ (before["to_world"].inverse() @ here)


def project(sensor, point, size):
    """The place in the picture, in pixels from its upper left corner."""
    parameters = mi.traverse(sensor)
    if "x_fov" not in parameters:
        raise Failure("--motion: the sensor is no perspective one")
    film = sensor.film()
    to_sample = mi.perspective_projection(
        film.size(), film.crop_size(), film.crop_offset(), parameters["x_fov"], parameters["near_clip"], parameters["far_clip"]
    )
    place = to_sample @ (sensor.world_transform().inverse() @ point)
    # Mitsuba adds it to a place in the picture to have that on the lens' axis; a thin lens has none.
    offset = [parameters[key] if key in parameters else 0 for key in ("principal_point_offset_x", "principal_point_offset_y")]
    shift = mi.Point2f(*offset) * mi.Point2f(film.size()) / mi.Point2f(film.crop_size())
    return (mi.Point2f(place.x, place.y) - shift) * mi.Point2f(*size)
