"""Renders the scenes of docs/guided.md with Mitsuba 3: colour by path tracing, and what is at the first hit.

Usage: .venv/bin/python scripts/python/guided_scene.py gallery|failures OUT.exr [--size 320x240] [--spp 256] [--seed 1]

gallery has textured albedo and glossy surfaces (rough plastic, rough copper) under a large lamp; failures has what no
guide sees: a mirror, glass with its caustic, and the hard shadow of a small lamp. Each OUT.exr holds R G B (linear),
albedo.R albedo.G albedo.B, N.X N.Y N.Z, P.X P.Y P.Z, Z and id, every one averaged over all samples of a pixel (box filter).
Textures come from formulas. Two renders with the same arguments are the same.
"""
import argparse
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

CHANNELS = "R G B albedo.R albedo.G albedo.B N.X N.Y N.Z P.X P.Y P.Z Z id".split()


def noise(size, seed, cells, octaves=6):
    """Smooth random colours from `cells` cells a side on, each octave 0.7 times as strong as the one before; 0 to 1."""
    rng = np.random.default_rng(seed)
    out = np.zeros((size, size, 3))
    for octave in range(octaves):
        count = cells * 2**octave
        grid = rng.random((count, count, 3))
        place = np.arange(size) * count / size
        low = place.astype(int)
        part = place - low
        part = part * part * (3 - 2 * part)
        low, high = low % count, (low + 1) % count
        v, u = part[:, None, None], part[None, :, None]
        top = grid[low][:, low] * (1 - u) + grid[low][:, high] * u
        bottom = grid[high][:, low] * (1 - u) + grid[high][:, high] * u
        out += 0.7**octave * (top * (1 - v) + bottom * v)
    out -= out.min((0, 1))
    return out / out.max((0, 1))


def tiles(size, seed, count):
    """Tiles of random colours with dark joints and a fine grain."""
    rng = np.random.default_rng(seed)
    side = size // count
    out = np.kron(0.1 + 0.8 * rng.random((count, count, 3)), np.ones((side, side, 1)))
    joint = np.arange(size) % side < max(1, side // 10)
    out[joint] = 0.05
    out[:, joint] = 0.05
    return out * (0.6 + 0.4 * noise(size, seed + 1, 32, 5))


def texture(pixels):
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels.astype(np.float32)), "raw": True, "wrap_mode": "repeat"}


def plastic(pixels, alpha):
    return {"type": "roughplastic", "alpha": alpha, "diffuse_reflectance": texture(pixels)}


def look_at(origin, target):
    return mi.ScalarTransform4f().look_at(origin, target, [0, 1, 0])


def transform():
    return mi.ScalarTransform4f()


def scene(name, width, height, spp):
    aovs = "albedo:albedo,N:sh_normal,P:position,Z:depth,id:shape_index"
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"},
            "pixel_format": "rgb", "component_format": "float32"}
    lamp = 1.6 if name == "gallery" else 0.25
    power = np.array([22, 20, 17]) * (0.7 / lamp) ** 2
    out = {
        "type": "scene",
        "integrator": {"type": "aov", "aovs": aovs, "image": {"type": "path", "max_depth": 6}},
        "sensor": {"type": "perspective", "fov": 42, "film": film,
                   "to_world": look_at([0, 2.6, 6.4], [0, 0.75, 0]),
                   "sampler": {"type": "independent", "sample_count": spp}},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.25, 0.3, 0.4]}},
        "lamp": {"type": "rectangle", "to_world": look_at([2.5, 6, 3], [0, 0.5, 0]) @ transform().scale([lamp, lamp, 1]),
                 "emitter": {"type": "area", "radiance": {"type": "rgb", "value": power.tolist()}}},
        "floor": {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90) @ transform().scale([6, 6, 1]),
                  "bsdf": plastic(tiles(1024, 1, 16), 0.2)},
        "wall": {"type": "rectangle", "to_world": transform().translate([0, 2, -3]) @ transform().scale([6, 4, 1]),
                 "bsdf": {"type": "diffuse", "reflectance": texture(tiles(1024, 7, 32))}},
    }
    if name == "gallery":
        ball = plastic(noise(512, 3, 8), 0.1)
        out["left"] = {"type": "sphere", "center": [-1.7, 0.8, 0], "radius": 0.8, "bsdf": ball}
        out["right"] = {"type": "sphere", "center": [1.7, 0.7, -0.2], "radius": 0.7, "bsdf": plastic(tiles(512, 5, 16), 0.15)}
        copper = {"type": "roughconductor", "alpha": 0.35, "material": "Cu"}
        out["copper"] = {"type": "sphere", "center": [0.3, 0.45, 1.2], "radius": 0.45, "bsdf": copper}
        cube = transform().translate([-0.8, 0.35, 1.8]) @ transform().rotate([0, 1, 0], 30) @ transform().scale(0.35)
        out["box"] = {"type": "cube", "to_world": cube, "bsdf": plastic(tiles(256, 9, 8), 0.2)}
    else:
        mirror = {"type": "conductor", "material": "Ag"}
        out["mirror"] = {"type": "sphere", "center": [1.3, 0.8, -0.2], "radius": 0.8, "bsdf": mirror}
        out["glass"] = {"type": "sphere", "center": [-0.4, 0.45, 1.5], "radius": 0.45, "bsdf": {"type": "dielectric"}}
        grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.6, 0.6]}}
        post = transform().translate([-1.8, 0.9, 0.2]) @ transform().scale([0.15, 0.9, 0.15])
        out["post"] = {"type": "cube", "to_world": post, "bsdf": grey}
    return out


def render(name, size, spp, seed):
    """The pixels, `(height, width, 14)` of float32, in the order of CHANNELS."""
    pixels = np.array(mi.render(mi.load_dict(scene(name, *size, spp)), seed=seed))
    return pixels[..., : len(CHANNELS)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", choices=["gallery", "failures"])
    parser.add_argument("out")
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    size = tuple(int(side) for side in given.size.split("x"))
    pixels = render(given.scene, size, given.spp, given.seed)
    import OpenEXR

    channels = {name: np.ascontiguousarray(pixels[..., at]) for at, name in enumerate(CHANNELS)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(given.out)


if __name__ == "__main__":
    sys.exit(main())
