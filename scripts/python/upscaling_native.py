"""What guides gain, native small frames against large ones, and seconds of lacuna upscale, as Markdown tables.

Called by scripts/upscaling with the names of tables: native, converged, cycles, vectors, points, ramps, guided, sampled, speed. Renders are kept in target/upscaling.
"""

import os
import pathlib
import statistics
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

import frames  # noqa: E402
from tool import DATA, LACUNA, OIIO_BIN, ROOT, lacuna, run  # noqa: E402

KEPT = ROOT / "target" / "upscaling"
# Scene, volume, side of the small frame.
SCENES = [("head", None, 360), ("engine-soft", "engine", 120)]
# The same for frames of one ray a pixel.
POINTS = [("aneurism", "aneurism", 300), ("engine", "engine", 300), ("vessels", None, 300), ("foot", "foot", 300),
          ("head", None, 300), ("tooth", "tooth", 300)]
DENSE = [("head", None), ("vessels", None), ("foot", "foot"), ("chest", "chest"), ("cthead", "cthead"),
         ("aneurism-steep", "aneurism"), ("tooth", "tooth")]
FACTORS = [1.25, 1.5, 2, 2.5, 3]
OIIO = ["triangle", "gaussian", "sharp-gaussian", "catmull-rom", "blackman-harris", "lanczos3", "radial-lanczos3",
        "nuke-lanczos6", "mitchell", "bspline", "cubic", "keys", "simon", "rifman"]
GUIDES = ["N.X", "N.Y", "N.Z", "Z", "A"]


def psnr(image, full, margin=4, most=np.inf):
    """Peak 1; values above `most` count as that."""
    inside = (slice(margin, -margin or None),) * 2
    image, full = (np.minimum(plane[inside], most) for plane in (image, full))
    return -10 * np.log10(np.mean((image - full) ** 2))


def rgb(path):
    planes = frames.read(path)[0]
    return np.stack([planes[name].astype(np.float64) for name in "RGB"], -1)


def done(result):
    assert result.status == 0, result
    return result


def rendered(scene, volume, side, words=(), samples=16):
    KEPT.mkdir(parents=True, exist_ok=True)
    path = KEPT / (f"{scene}-{side}.exr" if samples == 16 else f"{scene}-{side}-{samples}.exr")
    if not path.exists():
        volume = ["--volume", DATA / "volumes" / f"{volume}.nrrd"] if volume else []
        done(lacuna("render", ROOT / "samples" / "scenes" / f"{scene}.toml", *volume, "--samples", str(samples), "--size",
                    f"{side}x{side}", *words, "-o", path, timeout=3000))
    return path


def cornell(side):
    """Mitsuba's Cornell box in the light of a point, box filter, 256 samples a pixel."""
    KEPT.mkdir(parents=True, exist_ok=True)
    path = KEPT / f"cornell-{side}.exr"
    if not path.exists():
        import mitsuba

        mitsuba.set_variant("scalar_rgb")
        scene = mitsuba.cornell_box()
        scene["integrator"] = {"type": "direct"}
        scene["light"] = {"type": "point", "position": [0.0, 0.5, 0.2], "intensity": {"type": "rgb", "value": 1.5}}
        scene["sensor"]["sampler"] = {"type": "multijitter", "sample_count": 256}
        scene["sensor"]["film"].update(width=side, height=side, rfilter={"type": "box"}, pixel_format="rgb",
                                       component_format="float32")
        image = np.array(mitsuba.render(mitsuba.load_dict(scene), seed=side))
        frames.write(path, {name: np.ascontiguousarray(image[..., k]) for k, name in enumerate("RGB")})
    return path


def blender(side, *words):
    """Meshes by Cycles, 256 samples a pixel."""
    KEPT.mkdir(parents=True, exist_ok=True)
    path = KEPT / f"{'-'.join(['cycles', str(side), *words])}.exr"
    if not path.exists():
        python = os.environ.get("LACUNA_BPY") or sys.exit("set LACUNA_BPY to a Python with Blender's package bpy")
        done(run([python, ROOT / "scripts" / "python" / "cycles_scene.py", str(side), "256", path, *words], timeout=3000))
    return path


def converged():
    against([("cornell", 64, cornell)])


def cycles():
    against([("meshes", 120, blender)])


def native():
    against([(scene, side, lambda size, of=(scene, volume): rendered(*of, size)) for scene, volume, side in SCENES])


def vectors():
    """Motion vectors of Cycles, small and large: enlarged by `upscale`, and by oiiotool and multiplied by the factor by hand."""
    side, names = 120, [f"ViewLayer.Vector.{axis}" for axis in "XYZW"]
    print("| factor | RMS of the vectors | `upscale` | oiiotool's default | triangle | nearest | of the best by hand |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    small, flat, out = blender(side, "vectors"), KEPT / "flat.exr", KEPT / "out.exr"

    def read(path):
        return {name: plane for part in frames.read(path) for name, plane in part.items() if "Vector" in name}

    frames.write(flat, read(small))
    for factor in FACTORS:
        size = round(side * factor)
        full = read(blender(size, "vectors"))

        def off(planes):
            inside = (slice(4, -4),) * 2
            return np.sqrt(np.mean([(planes[name][inside] - full[name][inside]) ** 2 for name in names]))

        done(lacuna("upscale", "-q", small, "-o", out, "--size", f"{size}x{size}"))
        ours = off(read(out))
        by_hand = []
        for words in ["--resize", "--resize:filter=triangle", "--resize:filter=box"]:
            done(run([OIIO_BIN / "oiiotool", flat, words, f"{size}x{size}", "--mulc", str(factor), "-d", "float", "-o", out]))
            by_hand.append(off(read(out)))
        rms = np.sqrt(np.mean([full[name] ** 2 for name in names]))
        hands = " | ".join(f"{value:.4f}" for value in by_hand)
        print(f"| {factor} | {rms:.3f} | {ours:.4f} | {hands} | {ours / min(by_hand):.2f} |", flush=True)


def points():
    against([(scene, side, lambda size, of=(scene, volume): rendered(*of, size, samples=1)) for scene, volume, side in POINTS],
            "point", [1.1, *FACTORS])


def against(scenes, own="box", factors=FACTORS):
    """Frames rendered small and large, enlarged by every filter; how far one of lacuna's is ahead of oiiotool's."""
    print("| scene | factor | `upscale` | `--sampling point` | Lanczos3 | Mitchell | best of oiiotool | ahead | ahead, clipped to 1 |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    for scene, side, render in scenes:
        small = render(side)
        for factor in factors:
            size = round(side * factor)
            full = rgb(render(size))
            judged = {}
            for name in ["box", "point", *OIIO]:
                out = KEPT / "out.exr"
                if name in OIIO:
                    done(run([OIIO_BIN / "oiiotool", small, "--resize:filter=" + name, f"{size}x{size}", "-d", "float", "-o", out]))
                else:
                    done(lacuna("upscale", "-q", small, "-o", out, "--size", f"{size}x{size}", "--sampling", name, timeout=3000))
                judged[name] = [psnr(rgb(out), full, most=most) for most in (np.inf, 1.0)]
            best = max(OIIO, key=lambda name: judged[name][0])
            ahead = [judged[own][k] - max(judged[name][k] for name in OIIO) for k in range(2)]
            values = " | ".join(f"{judged[name][0]:.2f}" for name in ("box", "point", "lanczos3", "mitchell"))
            print(f"| {scene} {side} | {factor} | {values} | {judged[best][0]:.2f} ({best}) | {ahead[0]:+.2f} | {ahead[1]:+.2f} |", flush=True)


def ramps():
    """The largest error of a slanted ramp, border included, over its steps from pixel to pixel of both frames."""
    KEPT.mkdir(parents=True, exist_ok=True)
    small, out = KEPT / "ramp.exr", KEPT / "out.exr"
    step = 1 / 64
    y, x = np.mgrid[0:48, 0:64] + 0.5
    frames.write(small, {"R": (0.5 + step * (x + 0.5 * y)).astype(np.float32)})
    worst = {}
    for factor in np.arange(11, 41) / 10:
        done(lacuna("upscale", "-q", small, "-o", out, "--scale", str(factor), timeout=3000))
        got = frames.read(out)[0]["R"].astype(np.float64)
        y, x = np.mgrid[0 : got.shape[0], 0 : got.shape[1]] + 0.5
        expected = 0.5 + step * (x * 64 / got.shape[1] + 0.5 * y * 48 / got.shape[0])
        worst[factor] = np.abs(got - expected).max() / step
    fine = max(factor * error for factor, error in worst.items())
    print(f"A ramp from 0.5 to 2 at {len(worst)} factors from 1.1 to 4: off by at most {max(worst.values()):.1e} of its step from pixel to "
          f"pixel of the small frame, {fine:.1e} of that of the large one.")


def means(image, factor):
    height, width = image.shape
    return image.reshape(height // factor, factor, width // factor, factor).mean((1, 3)).astype(np.float32)


def guided():
    names = ["none", "N, Z, A", "constant", "noise", "of another frame"]
    print("| frame | factor | Lanczos3 | " + " | ".join(names) + " |\n|---|---:|" + "---:|" * (len(names) + 1))
    KEPT.mkdir(parents=True, exist_ok=True)
    small, out, guides = (KEPT / f"{name}.exr" for name in ("small", "out", "guides"))
    sources = {name: DATA / "frames" / f"{name}-aov.exr" for name in ("engine", "aneurism-iso")}
    for name, path in sources.items():
        planes = frames.read(path)[0]
        full = rgb(path)
        other = frames.read(sources["engine" if name != "engine" else "aneurism-iso"])[0]
        noise = np.random.default_rng(1)
        cases = {
            "none": None,
            "N, Z, A": {guide: planes[guide] for guide in GUIDES},
            "constant": {guide: np.full_like(planes[guide], 0.5) for guide in GUIDES},
            "noise": {guide: noise.random(full.shape[:2], np.float32) for guide in GUIDES},
            "of another frame": {guide: other[guide] for guide in GUIDES},
        }
        for factor in (2, 4):
            frames.write(small, {channel: means(planes[channel].astype(np.float64), factor) for channel in "RGBA"})
            side = full.shape[0]
            theirs = KEPT / "theirs.exr"
            done(run([OIIO_BIN / "oiiotool", small, "--resize:filter=lanczos3", f"{side}x{side}", "-d", "float", "-o", theirs]))
            row = [psnr(rgb(theirs), full, 0)]
            for case in cases.values():
                words = []
                if case:
                    frames.write(guides, {guide: np.ascontiguousarray(plane) for guide, plane in case.items()})
                    words = ["--guides-from", guides]
                done(lacuna("upscale", "-q", small, "-o", out, "--scale", str(factor), *words, timeout=3000))
                image = rgb(out)
                worst = max(np.abs(means(image[..., k], factor) - frames.read(small)[0][c]).max() for k, c in enumerate("RGB"))
                assert worst < 1e-5, worst
                row.append(psnr(image, full, 0))
            print(f"| {name} | {factor} | " + " | ".join(f"{value:.2f}" for value in row) + " |", flush=True)


def sampled():
    """Renders of 16 samples a pixel, guides of one: what a renderer gives for next to nothing."""
    print("| scene | factor | none | dense N, Z, A |\n|---|---:|---:|---:|")
    small, out, guides = (KEPT / f"{name}.exr" for name in ("small", "out", "guides"))
    for scene, volume in DENSE:
        large = frames.read(rendered(scene, volume, 480, ["--dense-aovs"]))[0]
        full = rgb(KEPT / f"{scene}-480.exr")
        frames.write(guides, {guide: large["dense." + guide] for guide in GUIDES})
        for factor in (2, 4):
            little = frames.read(rendered(scene, volume, 480 // factor))[0]
            frames.write(small, {channel: little[channel] for channel in "RGBA"})
            row = []
            for words in ([], ["--guides-from", guides]):
                done(lacuna("upscale", "-q", small, "-o", out, "--scale", str(factor), *words, timeout=3000))
                row.append(psnr(rgb(out), full, 0))
            print(f"| {scene} | {factor} | " + " | ".join(f"{value:.2f}" for value in row) + " |", flush=True)


def seconds(*command):
    """The median of five."""
    return statistics.median(done(run([str(word) for word in command])).seconds for _ in range(5))


def speed():
    KEPT.mkdir(parents=True, exist_ok=True)
    small, out, guides = (KEPT / f"{name}.exr" for name in ("hd", "uhd", "aovs"))
    crop = DATA / "frames" / "engine-aov.exr"
    oiiotool = OIIO_BIN / "oiiotool"
    done(run([oiiotool, crop, "--ch", "R,G,B,A", "--resize", "1920x1080", "-d", "half", "--compression", "zip", "-o", small]))
    done(run([oiiotool, crop, "--ch", "N.X,N.Y,N.Z,Z,R,G,B", "--chnames", "N.X,N.Y,N.Z,Z,albedo.R,albedo.G,albedo.B",
              "--resize", "3840x2160", "-d", "half", "--compression", "zip", "-o", guides]))
    theirs = seconds(oiiotool, small, "--resize:filter=lanczos3", "3840x2160", "-o", out)
    plain = seconds(LACUNA, "upscale", "-q", small, "-o", out, "--scale", "2")
    steered = seconds(LACUNA, "upscale", "-q", small, "-o", out, "--scale", "2", "--guides-from", guides)
    print("| 1920x1080 to 3840x2160, RGBA, half | seconds | of oiiotool |\n|---|---:|---:|")
    for name, value in [("oiiotool, Lanczos3", theirs), ("`upscale`", plain), ("`upscale`, N, Z, albedo", steered)]:
        print(f"| {name} | {value:.2f} | {value / theirs:.2f} |")
    print("\n| `--sampling point`, 600x600 to 1200x1200 | seconds |\n|---|---:|")
    names = sorted(path for path in (DATA / "frames").glob("*.exr") if "aov" not in path.name)
    for path in names:
        done(run([oiiotool, path, "--ch", "R,G,B,A", "--resize:filter=box", "600x600", "-o", small]))
        taken = seconds(LACUNA, "upscale", "-q", small, "-o", out, "--scale", "2", "--sampling", "point")
        print(f"| {path.stem} | {taken:.2f} |", flush=True)


if __name__ == "__main__":
    tables = {"native": native, "converged": converged, "points": points, "ramps": ramps, "guided": guided, "sampled": sampled, "speed": speed}
    for table in sys.argv[1:] or tables:
        {**tables, "cycles": cycles, "vectors": vectors}[table]()
        print(flush=True)
