"""Renders a fifth of the pixels with Mitsuba 3, in two rounds, and fills the rest: one process, no files but the picture.

    python mitsuba_rounds.py filled.exr [scene.xml]

Mitsuba's own render call takes whole rectangles, so the rays of single pixels are sent here, one by one. For scenes of size take a variant
that traces many at once: scripts/renderers has a bridge.
"""

import sys

import lacuna
import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")


def render(scene, mask, samples=4):
    """(height, width, 3) float32, NaN where the mask is False; the mean of some samples within each pixel."""
    sensor = scene.sensors()[0]
    width, height = sensor.film().crop_size()
    integrator = scene.integrator()
    sampler = mi.load_dict({"type": "independent"})
    image = np.full((height, width, 3), np.nan, np.float32)
    for y, x in zip(*np.nonzero(mask)):
        # Each pixel by its own seed, so that no order matters.
        sampler.seed(int(y) * width + int(x))
        light = np.zeros(3)
        for _ in range(samples):
            inside = sampler.next_2d()
            place = mi.Point2f((x + inside[0]) / width, (y + inside[1]) / height)
            ray, weight = sensor.sample_ray_differential(0, sampler.next_1d(), place, sampler.next_2d())
            colour, _, _ = integrator.sample(scene, sampler, ray)
            light += np.array(weight * colour)
        image[y, x] = light / samples
    return image


def main(target, path=None):
    scene = mi.load_file(path) if path else mi.load_dict(mi.cornell_box() | {"sensor": small(mi.cornell_box()["sensor"])})
    width, height = scene.sensors()[0].film().crop_size()

    mask = lacuna.mask((height, width), 0.15)
    image = render(scene, mask)
    more = lacuna.next_mask(image, mask, 0.05)
    image = np.where(more[:, :, None], render(scene, more), image)
    mask |= more

    filled, said = lacuna.fill(image, mask, estimate=True)
    mi.Bitmap(filled).write(target)
    told = "its error cannot be told" if said.psnr is None else f"about {said.psnr:.1f} dB"
    print(f"{mask.mean():.0%} of the pixels rendered, the rest filled: {told}")


def small(sensor):
    """The same at 64x64 pixels."""
    film = {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}}
    return sensor | {"film": film}


if __name__ == "__main__":
    main(*sys.argv[1:])
