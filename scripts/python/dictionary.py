"""Tables and pictures of docs/measurements/dictionary.md. Called by scripts/dictionary; arguments: the folder of the pictures, the folder of
the volumes, [a folder that keeps views and dictionaries], [the sections that are wanted, all without]."""

import contextlib
import json
import pathlib
import sys
import tempfile

import numpy as np
from dictionary_views import ROOT, colour, decibels, lacuna, picture, read, sparse
from dictionary_views import shuffle as even

SIZE = (288, 512)
TEST = 18
GREY = np.array([0.2126, 0.7152, 0.0722])
# As the thesis has it: blocks side by side, the pure approximation.
THESIS = ("--dict-stride", "16", "--dict-restore", "--limit", "off", "--domain", "linear")
# Blocks overlapping by half, measured pixels kept.
KEPT = ("--dict-stride", "8", "--limit", "off", "--domain", "linear")
MISSING = (0, 10, 30, 40, 50, 60, 70, 80, 90)


def scattered(height, width, density):
    order = np.random.default_rng(1).permutation(height * width).reshape(height, width)
    return order < density * height * width


class Bench:
    def __init__(self, folder, volumes):
        self.folder, self.volumes = folder, volumes

    def view(self, name, scene="chest-hues", volume="chest", *words):
        path = self.folder / f"{name}.exr"
        if not path.exists():
            scene = ROOT / "samples" / "scenes" / f"{scene}.toml"
            volume = self.volumes / f"{volume}.nrrd"
            lacuna("render", "-q", scene, "--volume", volume, "-o", path, "--size", "512x288", *words)
        return colour(read(path))

    def views(self):
        if not (self.folder / "view.0036.exr").exists():
            scene = ROOT / "samples" / "scenes" / "chest-hues.toml"
            volume = self.volumes / "chest.nrrd"
            lacuna("render", "-q", scene, "--volume", volume, "-o", self.folder / "view.####.exr", "--frames", "1-36")
        return [self.folder / f"view.{frame:04}.exr" for frame in range(1, 37) if frame != TEST]

    def train(self, name, *words):
        path = self.folder / f"{name}.npz"
        if not path.exists():
            seconds, text = lacuna("dictionary", "train", *self.views(), "-o", path, *words)
            print(f"{name}: {seconds:.0f} s; {text.strip().splitlines()[-1]}\n", flush=True)
        return path

    def fill(self, planes, mask, *words):
        """The filled planes and the seconds of solving."""
        with tempfile.TemporaryDirectory() as folder:
            source, target = pathlib.Path(folder) / "sparse.exr", pathlib.Path(folder) / "filled.exr"
            sparse(source, planes, mask)
            report = lacuna("fill", "-q", source, "-o", target, "--json", "-", *words)[1]
            filled = read(target)
        names = "RGB" if planes.ndim == 3 else "Y"
        found = np.stack([filled[name] for name in names], -1).astype(np.float64)
        return found.reshape(planes.shape), json.loads(report)["frames"][0]["seconds"]["solve"]


def table(head, rows):
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)
    print(flush=True)


def curve(bench, truth, filters, missing=MISSING):
    """PSNR of filters, (name, words, scattered mask), a row for each part of missing pixels."""
    rows = []
    for percent in missing:
        row = [f"{percent} %"]
        for _, words, *other in filters:
            mask = (scattered if other else even)(*truth.shape[:2], 1 - percent / 100)
            if percent == 0 and "--dict-restore" not in words:
                row.append("-")
                continue
            row.append(f"{decibels(bench.fill(truth, mask, *words)[0], truth):.2f}")
        rows.append(row)
    table(["missing", *(name for name, *_ in filters)], rows)


def words_of(dictionary, sparsity=30, mode=THESIS):
    return ("--filter", "dictionary", "--dictionary", dictionary, "--dict-sparsity", str(sparsity), *mode)


def cosines(sparsity=30, mode=THESIS):
    return ("--filter", "dct", "--dict-sparsity", str(sparsity), *mode)


def grey_levels(bench, pictures):
    print("## Figure 4.7: grey, L = 30\n")
    grey = bench.train("grey", "--grey")
    truth = bench.view(f"view.{TEST:04}") @ GREY
    curve(bench, truth, (("trained", words_of(grey)), ("dct", cosines()), ("ss", ("--filter", "ss"))))
    mask = even(*SIZE, 0.3)
    shown = [bench.fill(truth, mask, *words)[0] for words in (words_of(grey), cosines(), ("--filter", "ss"))]
    picture(pictures / "dictionary-grey.jpg", [[shown[0], truth], [shown[1], shown[2]]], 384)


def rgb_levels(bench, pictures):
    trained = bench.train("rgb")
    truth = bench.view(f"view.{TEST:04}")
    for sparsity in (30, 60):
        print(f"## Figure 4.8: colour, L = {sparsity}\n")
        filters = [("trained", words_of(trained, sparsity)), ("dct", cosines(sparsity))]
        if sparsity == 30:
            filters += [("stride 8, kept", words_of(trained, sparsity, KEPT)), ("ss", ("--filter", "ss"))]
        curve(bench, truth, filters)
    print("## Table 4.1\n")
    rows, shown = [], [[truth]]
    for percent in (80, 60, 10):
        mask = even(*SIZE, 1 - percent / 100)
        row = [f"{percent} %"]
        for words in (words_of(trained), cosines(), ("--filter", "ss")):
            filled, seconds = bench.fill(truth, mask, *words)
            row += [f"{seconds:.2f} s", f"{decibels(filled, truth):.2f}"]
            if "--dict-restore" in words:
                shown.append([filled])
        rows.append(row)
    head = [f"{name} {what}" for name in ("trained", "dct", "ss") for what in ("time", "PSNR")]
    table(["missing", *head], rows)
    tiles = [tile for row in shown for tile in row]
    picture(pictures / "dictionary-colour.jpg", [tiles[1:3], tiles[3:5], tiles[5:7]], 320)


def strides(bench, _):
    print("## Stride\n")
    trained = bench.train("rgb")
    truth = bench.view(f"view.{TEST:04}")
    rows = []
    for percent in (70, 80):
        mask = even(*SIZE, 1 - percent / 100)
        found = [bench.fill(truth, mask, *words_of(trained, 30, ("--dict-stride", str(stride), *KEPT[2:]))) for stride in (16, 8, 4)]
        rows.append([f"{percent} %", *(f"{decibels(filled, truth):.2f}, {seconds:.2f} s" for filled, seconds in found)])
    table(["missing", "stride 16", "stride 8", "stride 4"], rows)


def distributions(bench, pictures):
    print("## Figure 4.5: random and even masks\n")
    trained = bench.train("rgb")
    truth = bench.view(f"view.{TEST:04}")
    words = words_of(trained)
    curve(bench, truth, (("trained, even", words), ("trained, random", words, True), ("ss, even", ("--filter", "ss")),
                         ("ss, random", ("--filter", "ss"), True)), (30, 50, 70, 80))
    tiles = [bench.fill(truth, make(*SIZE, 0.3), *words)[0] for make in (even, scattered)]
    picture(pictures / "dictionary-masks.jpg", [tiles], 384)


def methods(bench, pictures):
    print("## Figure 4.11: all methods\n")
    trained = bench.train("rgb")
    truth = bench.view(f"view.{TEST:04}")
    named = [("ss", ("--filter", "ss")), ("tv", ("--filter", "tv")), ("trained (thesis)", words_of(trained)),
             ("cs-wavelet", ("--filter", "cs-wavelet")), ("cs-gradient, random", ("--filter", "cs-gradient"), True)]
    curve(bench, truth, named, (10, 30, 50, 70, 80))
    rows = []
    for percent in (80, 50):
        make = lambda other: (scattered if other else even)(*SIZE, 1 - percent / 100)
        shown = [bench.fill(truth, make(other), *words)[0] for _, words, *other in (named[0], named[1], named[2], named[3])]
        rows.append(shown)
    picture(pictures / "dictionary-methods.jpg", rows, 240)


def elsewhere(bench, pictures):
    trained = bench.train("rgb")
    plain = "[[0.0,0.9,0.8,0.6,0.0],[0.39,0.9,0.8,0.6,0.0],[0.4,0.9,0.8,0.6,0.15],[1.0,0.9,0.8,0.6,0.15]]"
    bluer = ("[[0.0,0.1,0.2,1.0,0.0],[0.13,0.1,0.2,1.0,0.0],[0.22,0.1,0.3,1.0,0.1],[0.32,0.1,0.5,0.7,0.04],"
             "[0.4,0.1,0.9,0.2,0.03],[0.52,0.2,1.0,0.2,0.08],[0.62,0.9,0.5,0.1,0.2],[0.8,1.0,0.2,0.1,0.5],[1.0,1.0,0.3,0.2,0.9]]")
    angle = ("--set", f"camera.azimuth={10 * (TEST - 1)}")
    scenes = {
        "test view": bench.view(f"view.{TEST:04}"),
        "viewpoint": bench.view("viewpoint", "chest-hues", "chest", "--set", "camera.azimuth=45", "--set", "camera.elevation=65"),
        "zoom 0.5": bench.view("half", "chest-hues", "chest", *angle, "--set", "camera.zoom=1.3"),
        "zoom 1.5": bench.view("larger", "chest-hues", "chest", *angle, "--set", "camera.zoom=3.9"),
        "one colour": bench.view("plain", "chest-hues", "chest", *angle, "--set", f"transfer.points={plain}",
                                 "--set", "transfer.joining=constant"),
        "bluer, zoom 1.3": bench.view("bluer", "chest-hues", "chest", *angle, "--set", f"transfer.points={bluer}",
                                      "--set", "camera.zoom=3.4"),
        "head": bench.view("head", "cthead", "cthead"),
        "foot": bench.view("foot", "foot", "foot"),
    }
    filters = (words_of(trained), cosines(), words_of(trained, 30, KEPT), ("--filter", "ss"))
    for percent in (70, 0):
        print(f"## Section 4.6: {percent} % missing, L = 30\n")
        rows = []
        for name, truth in scenes.items():
            mask = even(*SIZE, 1 - percent / 100)
            wanted = filters if percent else filters[:2]
            rows.append([name, *(f"{decibels(bench.fill(truth, mask, *words)[0], truth):.2f}" for words in wanted)])
        table(["image", "trained", "dct", "stride 8, kept", "ss"][: len(rows[0])], rows)
    print("## Figure 4.22: another viewpoint\n")
    curve(bench, scenes["viewpoint"], (("trained", filters[0]), ("dct", filters[1]), ("ss", filters[3])), (10, 30, 50, 70, 90))
    full = even(*SIZE, 1)
    rows = [[scenes[name], *(bench.fill(scenes[name], full, *words)[0] for words in filters[:2])] for name in ("head", "foot")]
    picture(pictures / "dictionary-foreign.jpg", rows, 288)


def sizes(bench, _):
    print("## Encoding the test view\n")
    trained = bench.train("rgb")
    rows = []
    for sparsity in (5, 10, 30):
        for bits in (6, 8, 10):
            words = ("--dictionary", trained, "--dict-sparsity", str(sparsity), "--bits", str(bits))
            text = lacuna("dictionary", "encode", bench.folder / f"view.{TEST:04}.exr", "-o", bench.folder / "view.code", *words)[1]
            found = text.strip().splitlines()[-1].split(", ")
            rows.append([str(sparsity), str(bits), *found])
    table(["L", "bits", "size", "rate", "quality", "atoms"], rows)


def main():
    pictures, volumes = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]).resolve()
    keep = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else None
    sections = {"grey": grey_levels, "colour": rgb_levels, "stride": strides, "masks": distributions, "methods": methods,
                "elsewhere": elsewhere, "sizes": sizes}
    with contextlib.ExitStack() as stack:
        folder = keep or pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(exist_ok=True)
        bench = Bench(folder.resolve(), volumes)
        bench.views()
        for name in sys.argv[4:] or sections:
            sections[name](bench, pictures)


main()
