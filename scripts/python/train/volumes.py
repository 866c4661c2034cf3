"""Procedural volumes, and scenes of them for `lacuna render`: what the network of the filter `cnn` sees of volume rendering in training.

A volume is [size, size, size], values from 0 to 1. All draw from the generator that they are given: the order of the draws is part of
the recipe.
"""

import numpy as np
from scipy.ndimage import gaussian_filter, zoom

from images import log_uniform

# Voxels over which the surface of a vessel fades.
SOFT = 2.5
# One of these, equally likely.
INTERPOLATIONS = ("tricubic", "tricubic-smooth", "tricubic-smooth")


def write(path, volume):
    """As NRRD, 8 bits."""
    header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {} {} {}\nencoding: raw\n\n".format(*volume.shape[::-1])
    path.write_bytes(header.encode() + np.clip(volume * 255, 0, 255).astype(np.uint8).tobytes())


def axes(size):
    return np.meshgrid(*[np.linspace(-1, 1, size)] * 3, indexing="ij")


def unit(vector):
    return vector / np.linalg.norm(vector)


def add_segment(volume, start, end, radius):
    """A round piece of vessel; False where it lies outside."""
    size, reach = len(volume), radius + SOFT
    low = np.maximum(np.floor(np.minimum(start, end) - reach), 0).astype(int)
    high = np.minimum(np.ceil(np.maximum(start, end) + reach) + 1, size).astype(int)
    if (high <= low).any():
        return False
    offset = np.stack(np.meshgrid(*[np.arange(a, b) for a, b in zip(low, high)], indexing="ij"), -1) - start
    step = end - start
    near = np.clip((offset @ step) / (step @ step), 0, 1)
    distance = np.linalg.norm(offset - near[..., None] * step, axis=-1)
    part = tuple(slice(a, b) for a, b in zip(low, high))
    volume[part] = np.maximum(volume[part], np.clip((radius - distance) / SOFT + 0.5, 0, 1))
    return True


def vessels(random, size):
    """Trees of tubes that branch and get thinner."""
    volume, ends = np.zeros((size, size, size)), []
    for _ in range(random.integers(1, 4)):
        direction = random.normal(size=3)
        ends.append((random.uniform(0.3, 0.7, 3) * size, unit(direction), random.uniform(0.02, 0.06) * size, 0))
    for _ in range(160):
        if not ends:
            break
        point, direction, radius, level = ends.pop(0)
        for _ in range(random.integers(4, 14)):
            end = point + direction * radius * 2
            if not add_segment(volume, point, end, radius):
                break
            point = end
            direction = unit(direction + 0.35 * random.normal(size=3))
            radius *= random.uniform(0.93, 1.0)
            if radius < 0.5:
                break
            if random.random() < 0.25 and level < 5:
                branch = unit(direction + random.normal(size=3))
                ends.append((point.copy(), branch, radius * random.uniform(0.4, 0.9), level + 1))
        if radius > 0.6 and level < 6:
            ends.append((point, direction, radius * 0.9, level + 1))
    return volume * random.uniform(0.7, 1)


def machine(random, size):
    """Boxes, cylinders and balls, put in or cut out, turned or not."""
    grid, volume = axes(size), np.zeros((size, size, size))
    for _ in range(random.integers(5, 18)):
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0] if random.random() < 0.3 else np.eye(3)
        centre = random.uniform(-0.7, 0.7, 3)
        x, y, z = (sum(turn[i, j] * (grid[j] - centre[j]) for j in range(3)) for i in range(3))
        extent, kind = random.uniform(0.08, 0.6, 3), random.random()
        if kind < 0.4:
            distance = np.maximum.reduce([np.abs(x) - extent[0], np.abs(y) - extent[1], np.abs(z) - extent[2]])
        elif kind < 0.75:
            distance = np.maximum(np.hypot(x, y) - extent[0] * 0.6, np.abs(z) - extent[2] * 1.5)
        else:
            distance = np.sqrt(x**2 + y**2 + z**2) - extent[0] * 0.7
        inside = np.clip(0.5 - distance * size / 4, 0, 1)
        volume = volume * (1 - inside) + random.choice([0, 0.4, 0.6, 0.8, 1.0]) * inside
    return volume


def blobs(random, size):
    """Soft balls that melt into each other, half of the time grainy."""
    grid, volume = axes(size), np.zeros((size, size, size))
    for _ in range(random.integers(4, 20)):
        centre = random.normal(0, 0.35, 3)
        volume += random.uniform(0.3, 0.9) * np.exp(-sum((axis - at) ** 2 for axis, at in zip(grid, centre)) / random.uniform(0.12, 0.4) ** 2)
    if random.random() < 0.5:
        grain = gaussian_filter(random.normal(size=volume.shape), random.uniform(1.5, 5))
        volume += random.uniform(0.02, 0.3) * grain / grain.std() * volume
    return np.clip(volume / volume.max(), 0, 1)


def cloud(random, size):
    """Noise of three octaves that thins out from the centre."""
    knots = [3 * 2**octave + 2 for octave in range(1, 4)]
    octaves = [zoom(random.normal(size=(count,) * 3), (size + 3) / count, order=3)[:size, :size, :size] for count in knots]
    volume = sum(0.55 ** (index + 1) * octave for index, octave in enumerate(octaves))
    fade = np.clip(1.15 - np.sqrt(sum(axis * axis for axis in axes(size))), 0, 0.4) / 0.4
    return np.clip((0.5 + 0.25 * volume / volume.std()) * fade, 0, 1)


KINDS = (vessels, machine, vessels, blobs, cloud)


def transfer(random):
    """Points of a transfer function as [value, red, green, blue, opacity], gentle slopes or steep steps, and the mode that takes them."""
    count, points, steep, surface = random.integers(2, 5), [[0] * 5], random.random() < 0.45, random.random() < 0.35
    for index, value in enumerate(np.sort(random.uniform(0.1, 0.9, count))):
        colour, before = list(random.uniform(0.1, 1, 3)), points[-1][4]
        if steep:
            points.append([max(value - random.uniform(0.005, 0.03), 0.01), *colour, 0 if index == 0 else before])
            points.append([value, *colour, random.choice([0.02, 0.1, 1.0, 1.0])])
        else:
            points.append([value, *colour, 0 if index == 0 else log_uniform(random, 0.004, 0.8)])
    points.append([1, *random.uniform(0.3, 1, 3), points[-1][4] if steep else log_uniform(random, 0.02, 1)])
    points.sort(key=lambda point: point[0])
    last = -1
    for point in points:
        point[0] = last = min(1.0, max(point[0], last + 1e-3))
    if surface:
        return [[0, *random.uniform(0.2, 1, 3).round(3), 1]], "iso"
    return points, "dvr"


def scene(random, volume, size):
    """A scene file: the volume seen from somewhere, with some transfer function, or one of its surfaces."""
    points, mode = transfer(random)
    listed = ", ".join("[" + ", ".join(f"{number:.5f}" for number in point) + "]" for point in points)
    return f"""volume = "{volume}"
transfer = {{ domain = "type", points = [{listed}] }}
camera = {{ azimuth = {random.uniform(0, 360):.2f}, elevation = {random.uniform(-70, 70):.2f}, zoom = {log_uniform(random, 1.2, 3.5):.3f} }}
shading = {{ ambient = {random.uniform(0.1, 0.4):.3f}, specular = {random.choice([0, 0.25, 0.5])} }}
march = {{ mode = "{mode}", iso = {random.uniform(0.25, 0.7):.3f}, step = 0.25, interpolation = "{random.choice(INTERPOLATIONS)}" }}
image = {{ size = [{size}, {size}], samples = {1 if random.random() < 0.75 else 4} }}
"""
