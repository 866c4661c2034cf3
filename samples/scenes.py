"""The scenes of the samples: each function returns pixels, rows first, float64, scene-linear, colour premultiplied.

Everything is computed from formulas and seeds; nothing is read. Image coordinates run from -1 to 1 over the shorter side,
x to the right, y down; rays go along +z (orthographic) unless a scene says otherwise.
"""

import numpy as np


def grid(height, width):
    """Coordinates (x, y) of the pixel centres."""
    unit = 2.0 / min(height, width)
    x = (np.arange(width) + 0.5 - width / 2) * unit
    y = (np.arange(height) + 0.5 - height / 2) * unit
    return np.meshgrid(x, y)


def ramp(values, points):
    """Piecewise linear table: `points` is a list of (value, r, g, b, opacity)."""
    points = np.asarray(points)
    return np.stack([np.interp(values, points[:, 0], points[:, k]) for k in range(1, 5)], axis=-1)


def march(density, points, x, y, steps, shade=0.0):
    """Emission and absorption front to back through z in [-1, 1]; premultiplied RGBA.

    `density(x, y, z)` gives the value and its gradient; opacity in `points` is per unit of length; `shade` mixes in a
    lamp at the upper left.
    """
    step = 2.0 / steps
    light = np.array([-0.5, -0.6, -0.62])
    colour = np.zeros(x.shape + (3,))
    alpha = np.zeros(x.shape)
    for z in -1 + (np.arange(steps) + 0.5) * step:
        value, gradient = density(x, y, z)
        sample = ramp(value, points)
        opacity = 1 - np.exp(-sample[..., 3] * step)
        length = np.sqrt((gradient**2).sum(-1)) + 1e-6
        lambert = np.abs((gradient * light).sum(-1)) / length
        lit = 1 - shade + shade * (0.25 + 0.9 * lambert)
        weight = (1 - alpha) * opacity
        colour += (weight * lit)[..., None] * sample[..., :3]
        alpha += weight
    return np.concatenate([colour, alpha[..., None]], axis=-1)


def gaussians(centres, radii, weights):
    """A density of Gaussian blobs and its gradient, for `march`."""

    def density(x, y, z):
        value = np.zeros(x.shape)
        gradient = np.zeros(x.shape + (3,))
        for (cx, cy, cz), radius, weight in zip(centres, radii, weights):
            dx, dy, dz = x - cx, y - cy, z - cz
            blob = weight * np.exp(-(dx**2 + dy**2 + dz**2) / radius**2)
            value += blob
            slope = -2 * blob / radius**2
            gradient += np.stack([slope * dx, slope * dy, slope * dz], axis=-1)
        return value, gradient

    return density


def smooth(height, width):
    """A cloud: soft everywhere, no surface in it. RGBA."""
    rng = np.random.default_rng(4)
    count = 14
    centres = rng.normal(0, 0.36, (count, 3))
    radii = rng.uniform(0.16, 0.42, count)
    weights = rng.uniform(0.25, 0.8, count)
    points = [
        (0.00, 0.05, 0.10, 0.40, 0.0),
        (0.25, 0.15, 0.35, 0.95, 0.5),
        (0.60, 0.75, 0.30, 0.55, 1.6),
        (1.00, 1.00, 0.60, 0.25, 4.0),
        (2.00, 1.00, 0.95, 0.80, 9.0),
    ]
    x, y = grid(height, width)
    return march(gaussians(centres, radii, weights), points, x, y, 96)


def shells(height, width, time):
    """Three bodies that circle each other, seen through a translucent outer shell. RGBA; `time` in [0, 1) is one turn."""
    turn = 2 * np.pi * (time + np.arange(3) / 3)
    centres = np.stack([0.5 * np.cos(turn), 0.26 * np.sin(2 * turn) + 0.03, 0.45 * np.sin(turn)], axis=-1)
    points = [
        (0.00, 0.0, 0.0, 0.0, 0.0),
        (0.14, 0.1, 0.4, 0.9, 0.0),
        (0.20, 0.2, 0.5, 1.0, 3.5),
        (0.26, 0.1, 0.4, 0.9, 0.0),
        (0.52, 0.9, 0.3, 0.05, 0.0),
        (0.58, 1.0, 0.42, 0.1, 26.0),
        (0.74, 1.0, 0.55, 0.2, 6.0),
        (1.20, 1.0, 0.95, 0.85, 60.0),
    ]
    x, y = grid(height, width)
    return march(gaussians(centres, [0.37, 0.31, 0.26], [1.0, 0.95, 0.9]), points, x, y, 160, shade=0.75)


# Centre, radius, colour of each ball; identifiers count from 1, the floor is 7, the background 0.
BALLS = [
    ((-0.55, 0.12, 0.4), 0.46, (0.85, 0.25, 0.12)),
    ((0.28, -0.02, 1.1), 0.60, (0.15, 0.45, 0.75)),
    ((0.42, 0.36, -0.1), 0.22, (0.95, 0.75, 0.20)),
    ((-0.08, 0.43, -0.3), 0.15, (0.25, 0.70, 0.35)),
]
FLOOR, FLOOR_ID = 0.58, 7


def hit(origin, direction):
    """The first surface along each ray: distance (infinite for none), normal, identifier, colour."""
    distance = np.full(direction.shape[:-1], np.inf)
    normal = np.zeros(direction.shape)
    colour = np.zeros(direction.shape)
    ident = np.zeros(distance.shape, dtype=np.uint32)
    for number, (centre, radius, paint) in enumerate(BALLS, start=1):
        offset = origin - np.asarray(centre)
        half_b = (offset * direction).sum(-1)
        root = half_b**2 - ((offset**2).sum(-1) - radius**2)
        t = -half_b - np.sqrt(np.maximum(root, 0))
        near = (root > 0) & (t > 1e-6) & (t < distance)
        distance = np.where(near, t, distance)
        point = origin + t[..., None] * direction
        normal = np.where(near[..., None], (point - centre) / radius, normal)
        colour = np.where(near[..., None], paint, colour)
        ident = np.where(near, np.uint32(number), ident)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (FLOOR - origin[..., 1]) / direction[..., 1]
        near = (direction[..., 1] > 1e-9) & (t > 1e-6) & (t < distance) & (t < 12)
        point = origin + np.where(near, t, 0)[..., None] * direction
    distance = np.where(near, t, distance)
    normal = np.where(near[..., None], (0.0, -1.0, 0.0), normal)
    check = (np.floor(point[..., 0] * 2.5) + np.floor(point[..., 2] * 2.5)) % 2
    colour = np.where(near[..., None], np.where(check > 0, 0.62, 0.16)[..., None], colour)
    return distance, normal, np.where(near, np.uint32(FLOOR_ID), ident), colour


def balls(height, width):
    """Balls on a checkered floor with hard shadows, one ray a pixel: every edge is one pixel sharp.

    A dict of planes: diffuse and specular (h, w, 3), alpha, depth (infinite where nothing is), normal (h, w, 3), ident.
    """
    x, y = grid(height, width)
    eye = np.array([0.0, -0.55, -3.2])
    direction = np.stack([x * 0.34, y * 0.34 + 0.18, np.ones_like(x)], axis=-1)
    direction /= np.sqrt((direction**2).sum(-1, keepdims=True))
    distance, normal, ident, paint = hit(np.broadcast_to(eye, direction.shape), direction)
    seen = np.isfinite(distance)
    point = eye + np.where(seen, distance, 0)[..., None] * direction

    light = np.array([-0.55, -0.75, -0.45])
    light /= np.sqrt((light**2).sum())
    shadow, _, _, _ = hit(point + 1e-4 * normal, np.broadcast_to(light, direction.shape))
    lit = np.where(np.isinf(shadow), np.maximum((normal * light).sum(-1), 0), 0)
    halfway = light - direction
    halfway /= np.sqrt((halfway**2).sum(-1, keepdims=True))
    gloss = np.where(lit > 0, np.maximum((normal * halfway).sum(-1), 0), 0) ** 60
    diffuse = paint * (0.12 + 0.95 * lit)[..., None] * seen[..., None]
    specular = (0.5 * gloss * seen * (ident != FLOOR_ID))[..., None] * np.ones(3)
    return dict(diffuse=diffuse, specular=specular, alpha=seen.astype(float), depth=distance,
                normal=normal, ident=ident)


def lamps(height, width):
    """A dim room of about 0.1 with lamps of 1000: two hard discs, a row of single pixels and a slit. RGB."""
    x, y = grid(height, width)
    room = 0.1 + 0.05 * np.cos(2.2 * x) * np.cos(1.7 * y + 0.6)
    colour = room[..., None] * np.array([1.0, 0.85, 0.7])
    sources = [(-0.45, -0.4, 0.11, (1000.0, 900.0, 700.0)), (0.5, -0.25, 0.055, (1000.0, 500.0, 160.0))]
    for cx, cy, radius, power in sources:
        r = np.hypot(x - cx, y - cy)
        colour += 0.02 * np.asarray(power) / 1000 / (0.03 + r[..., None] ** 2)
        colour = np.where((r < radius)[..., None], power, colour)
    slit = (np.abs(y - 0.45) < 0.012) & (np.abs(x) < 0.6)
    colour = np.where(slit[..., None], (300.0, 700.0, 1000.0), colour)
    row, columns = int(height * 0.86), np.arange(width // 8, width - width // 8, width // 16)
    colour[row, columns] = 1000.0
    return colour


def texture(height, width):
    """A zone plate that reaches the highest frequency at the border, two checkerboards and a stripe in it. One plane."""
    x, y = grid(height, width)
    rate = np.pi * min(height, width) / 4
    plane = 0.5 + 0.45 * np.cos(rate * (x**2 + y**2) / 2)
    rows, columns = np.indices(plane.shape)
    for top, left, size in ((0.08, 0.08, 1), (0.08, 0.72, 2)):
        block = (slice(int(top * height), int((top + 0.2) * height)), slice(int(left * width), int((left + 0.2) * width)))
        plane[block] = 0.1 + 0.8 * ((rows[block] // size + columns[block] // size) % 2)
    stripe = slice(int(0.9 * height), int(0.96 * height))
    plane[stripe] = 0.1 + 0.8 * (columns[stripe] % 2)
    return plane


def shuffled(height, width, density, seed):
    """A low-discrepancy sampling mask: an additive recurrence with the plastic number, the nested kind."""
    rows, columns = np.indices((height, width))
    return (columns * 0.7548776662466927 + rows * 0.5698402909980532 + seed * 0.618) % 1.0 < density
