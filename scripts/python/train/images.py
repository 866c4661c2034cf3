"""Procedural images that the network of the filter `cnn` is trained on: shapes, textures, smooth fields, highlights and noise of few samples.

An image is [size, size, 3], linear light; x and y go from -1 to 1. All draw from the generator that they are given: the order of the draws
is part of the recipe.
"""

import numpy as np
from scipy.ndimage import gaussian_filter, zoom

# The share of images with one sample a pixel; all others have so many along each side of one.
ALIASED, SUPERSAMPLING = 0.6, 4


def log_uniform(random, low, high, count=None):
    """Equally likely at every scale between the two."""
    return np.exp(random.uniform(np.log(low), np.log(high), count))


def field(random, size, scale):
    """Smooth random values, most of them between -1 and 1, that vary over so many pixels."""
    knots = max(4, int(size / scale) + 3)
    return zoom(random.normal(size=(knots, knots)), (size + 8) / knots, order=3)[:size, :size]


def coordinates(size, samples):
    line = (np.arange(size * samples) + 0.5) / (size * samples) * 2 - 1
    return np.meshgrid(line, line)


def averaged(image, samples):
    """Samples to pixels."""
    size = image.shape[0] // samples
    return image.reshape(size, samples, size, samples, -1).mean((1, 3))


def samples_of(random):
    return 1 if random.random() < ALIASED else SUPERSAMPLING


def shade(random, x, y):
    """Brightness over a surface: flat, a ramp or waves."""
    kind, angle = random.random(), random.uniform(0, 2 * np.pi)
    along = np.cos(angle) * x + np.sin(angle) * y
    if kind < 0.3:
        return np.full(x.shape, 1.0)
    if kind < 0.65:
        return np.clip(1 + random.uniform(0, 0.9) * along, 0, 2)
    return np.clip(1 + 0.5 * random.random() * np.sin(random.uniform(1, 12) * along + random.uniform(0, 6)), 0, 2)


def ellipse(random, x, y, pixel, centre, tone):
    """Where it is and its brightness there, as of all shapes: flat, a lit ball, or a ring."""
    angle = random.uniform(0, np.pi)
    long, wide = log_uniform(random, 2 * pixel, 0.6, 2)
    across = (np.cos(angle) * (x - centre[0]) + np.sin(angle) * (y - centre[1])) / long
    down = (-np.sin(angle) * (x - centre[0]) + np.cos(angle) * (y - centre[1])) / wide
    radius = across * across + down * down
    inside = radius < 1
    if random.random() < 0.6:
        light = random.normal(size=3)
        light /= np.linalg.norm(light)
        lit = np.clip(across * light[0] + down * light[1] + np.sqrt(np.clip(1 - radius, 0, 1)) * abs(light[2]), 0, 1)
        tone = 0.2 + 0.8 * lit + (0.6 * lit**40 if random.random() < 0.5 else 0)
    if random.random() < 0.2:
        inside &= radius > random.uniform(0.5, 0.95)
    return inside, tone


def polygon(random, x, y, pixel, centre, tone):
    """Convex: where all of several half planes meet."""
    radius = log_uniform(random, 4 * pixel, 0.6)
    inside = np.ones(x.shape, bool)
    for angle in random.uniform(0, 2 * np.pi, random.integers(3, 7)):
        inside &= (x - centre[0]) * np.cos(angle) + (y - centre[1]) * np.sin(angle) < radius * random.uniform(0.5, 1)
    return inside, tone


def band(random, x, y, pixel, _, tone):
    """A half plane, or a band from half a pixel on."""
    angle = random.uniform(0, 2 * np.pi)
    along = x * np.cos(angle) + y * np.sin(angle) - random.uniform(-1, 1)
    return along > 0 if random.random() < 0.3 else np.abs(along) < pixel * log_uniform(random, 0.5, 20), tone


def tube(random, x, y, pixel, *_):
    """A vessel: a curve of changing width, from half a pixel on, mostly round."""
    points, time = random.uniform(-0.96, 0.96, (4, 2)), np.linspace(0, 1, 80)[:, None]
    weights = (1 - time) ** 3, 3 * time * (1 - time) ** 2, 3 * time * time * (1 - time), time**3
    curve = weights[0] * points[0] + weights[1] * points[1] + weights[2] * points[2] + weights[3] * points[3]
    radii = pixel * log_uniform(random, 0.5, 14) * np.linspace(1, random.uniform(0.3, 1), len(curve))
    distance = np.full(x.shape, 9.0)  # from the curve, over its radius
    for start, end, radius in zip(curve, curve[1:], radii):
        margin, step = radius + pixel * 2, end - start
        left, right = np.searchsorted(x[0], [min(start[0], end[0]) - margin, max(start[0], end[0]) + margin])
        top, bottom = np.searchsorted(y[:, 0], [min(start[1], end[1]) - margin, max(start[1], end[1]) + margin])
        if left >= right or top >= bottom:
            continue
        part = slice(top, bottom), slice(left, right)
        near = np.clip(((x[part] - start[0]) * step[0] + (y[part] - start[1]) * step[1]) / (step @ step + 1e-12), 0, 1)
        found = np.hypot(x[part] - start[0] - near * step[0], y[part] - start[1] - near * step[1]) / radius
        distance[part] = np.minimum(distance[part], found)
    if random.random() < 0.8:
        return distance < 1, random.uniform(0.1, 0.5) + 0.8 * np.sqrt(np.clip(1 - distance**2, 0, 1))
    return distance < 1, np.ones(x.shape)


def shapes(random, size, samples):
    """Shapes on each other, some of them translucent; of one image in three, tubes alone."""
    (x, y), pixel = coordinates(size, samples), 2 / size
    image = np.zeros((*x.shape, 3))
    if random.random() < 0.6:
        image += random.uniform(0, 1, 3) * shade(random, x, y)[..., None] * random.random()
    only_tubes = random.random() < 0.35
    for _ in range(random.integers(4, 26)):
        colour = random.uniform(0, 1, 3) if random.random() < 0.7 else np.full(3, random.random())
        kind, tone, centre = random.random(), shade(random, x, y), random.uniform(-1, 1, 2)
        if only_tubes:
            kind = 1
        draw = ellipse if kind < 0.2 else polygon if kind < 0.45 else band if kind < 0.6 else tube
        inside, tone = draw(random, x, y, pixel, centre, tone)
        opacity = 1 if random.random() < 0.7 else random.uniform(0.2, 1)
        image = np.where(inside[..., None], (1 - opacity) * image + opacity * colour * tone[..., None], image)
    return averaged(image, samples)


def checkers(random, size, across, down):
    """In perspective."""
    depth = 1 + random.uniform(0, 0.6) * down
    squares = size / 2 / log_uniform(random, 5, 40)
    return (np.floor(across / depth * squares) + np.floor(down / depth * squares)) % 2


def waves(random, size, samples, across):
    """Waves or stripes, bent."""
    frequency = np.pi * size / log_uniform(random, 5, 60)
    wave = 0.5 + 0.5 * np.sin(frequency * across + random.uniform(0, 4) * field(random, size * samples, size * samples / 3))
    return (wave > 0.5) * 1.0 if random.random() < 0.5 else wave


def grain(random, size, samples):
    """Filtered noise: in two tones, soft or of strong contrast."""
    values = gaussian_filter(random.normal(size=(size, size)), log_uniform(random, 1.2, 8), mode="wrap")
    values = np.kron(values / values.std(), np.ones((samples, samples)))
    kind = random.random()
    if kind < 0.35:
        return (values > random.normal()) * 1.0
    return np.clip(0.5 + 0.25 * values, 0, 1) if kind < 0.7 else 1 / (1 + np.exp(-4 * values))


def texture(random, size, samples):
    """Two colours mixed by a pattern."""
    (x, y), kind = coordinates(size, samples), random.random()
    first, second = random.uniform(0, 1, (2, 3))
    angle = random.uniform(0, np.pi)
    across, down = np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y
    if kind < 0.35:
        mixed = checkers(random, size, across, down)
    else:
        mixed = waves(random, size, samples, across) if kind < 0.6 else grain(random, size, samples)
    return averaged((first + (second - first) * mixed[..., None]) * shade(random, x, y)[..., None], samples)


def image(random, size):
    """Shapes, a texture, or shapes of which some are textured."""
    samples, kind = samples_of(random), random.random()
    if kind < 0.7:
        drawn = shapes(random, size, samples)
    elif kind < 0.9:
        drawn = texture(random, size, samples)
    else:
        drawn = shapes(random, size, samples)
        drawn = np.where(shapes(random, size, samples)[..., :1] > 0.4, drawn, texture(random, size, samples))
    return np.clip(drawn, 0, 4)


def smooth(random, size):
    """Nothing sharp: where a correction can only lose."""
    kind = random.random()
    if kind < 0.5:
        values = sum(random.normal() * 0.3**octave * field(random, size, size / 2 ** (octave + 1)) for octave in range(4))[..., None]
    elif kind < 0.8:
        values = gaussian_filter(shapes(random, size, 1), [log_uniform(random, 1.5, 12)] * 2 + [0])
    else:
        x, y = coordinates(size, 1)
        bumps = (random.normal() * np.exp(-((x - random.normal()) ** 2 + (y - random.normal()) ** 2) / random.uniform(0.1, 3)) for _ in range(4))
        values = sum(bumps)[..., None]
    values = (values - values.min()) / (np.ptp(values) + 1e-9) * random.uniform(0.2, 1, 3)
    return 1 - np.exp(-3 * values) if random.random() < 0.4 else values


def lamps(random, image):
    """The image with highlights 2 to 200 times as bright: long range."""
    size, brightness = len(image), log_uniform(random, 2, 200)
    pattern, level, kind = shapes(random, size, samples_of(random))[..., :1], random.uniform(0.3, 0.9), random.random()
    if kind < 0.4:
        return image * (1 + brightness * np.clip((pattern - level) / (1 - level), 0, 1) ** random.choice([0.1, 1, 2]))
    if kind < 0.7:
        return image * (1 + brightness * (pattern > level))
    lit = image.copy()
    for _ in range(random.integers(2, 30)):
        row, column = random.integers(0, size, 2)
        radius = log_uniform(random, 0.4, 6)
        y, x = np.ogrid[:size, :size]
        distance = (x - column) ** 2 + (y - row) ** 2
        if random.random() < 0.6:
            lit += (distance < radius * radius)[..., None] * brightness * random.uniform(0.2, 1)
        else:
            lit += brightness * np.exp(-distance / radius / radius)[..., None]
    return lit


def noisy(random, image):
    """The image as a path tracer of few samples a pixel has it, perhaps with fireflies."""
    size, samples = len(image), log_uniform(random, 2, 200)
    if random.random() < 0.5:
        samples = samples * np.exp(random.uniform(0.5, 2) * field(random, size, size / 3))[..., None]
    shape = (size, size, 1) if random.random() < 0.5 else (size, size, 3)
    result = image * random.gamma(samples, 1 / samples, shape)
    if random.random() < 0.4:
        result = result + log_uniform(random, 0.003, 0.1) * np.sqrt(np.abs(image)) * random.normal(size=image.shape)
    if random.random() < 0.3:
        fireflies = random.random((size, size, 1)) < log_uniform(random, 1e-4, 0.01)
        result = result + fireflies * random.exponential(2, (size, size, 1))
    return np.clip(result, 0, None)
