"""Counts the rays that a pixel list sends through each pixel. Called by tests/test_renderers.py with a scene.

Prints JSON: samples a pixel asked for, the counts that masked pixels got, and the number of rays elsewhere.
"""

import json
import pathlib
import sys

import drjit as dr
import mitsuba as mi
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "scripts" / "renderers"))
import mitsuba_sparse  # noqa: E402

SPP = 9


def main():
    mi.set_variant("llvm_ad_rgb")
    scene = mi.load_file(sys.argv[1], width="96", height="72", frame="1")
    inner = scene.sensors()[0]
    width, height = (int(side) for side in inner.film().crop_size())
    counter = dr.zeros(mi.UInt32, width * height)

    class Counting(mitsuba_sparse.sensor_class()):
        def place(self, position):
            found = super().place(position)
            pixel = mi.UInt32(found.y * height) * width + mi.UInt32(found.x * width)
            dr.scatter_add(counter, 1, pixel)
            return found

    mask = np.random.default_rng(3).random((height, width)) < 0.3
    mitsuba_sparse.sensor_class = lambda: Counting
    mitsuba_sparse.render_pixels(scene, scene.integrator(), mask, SPP, (1, 0))
    counts = np.array(counter).reshape(height, width)
    print(json.dumps({
        "spp": SPP,
        "masked": int(mask.sum()),
        "least": int(counts[mask].min()),
        "total": int(counts.sum()),
        "outside": int(counts[~mask].sum()),
    }))


if __name__ == "__main__":
    main()
