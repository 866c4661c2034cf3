"""What the page and the maps of `lacuna compare` show: the right group, at the right scale."""

import base64
import io
import json
import re

import imageio.v3
import numpy as np
import OpenEXR

import frames
import tool


def grey(height=40, width=50):
    rows, columns = np.indices((height, width))
    return (0.5 + 0.4 * np.sin(rows / 5.0) * np.cos(columns / 7.0)).astype(np.float32)


def page(folder, reference, test, *words):
    """The page of one pair of frames, each given by its channels; and the tables."""
    paths = [frames.write(folder / f"{name}.exr", channels) for name, channels in (("r", reference), ("t", test))]
    tables = tool.lacuna("compare", *paths, "--html", folder / "page.html", *words).stdout
    return (folder / "page.html").read_text(), tables


def layer(name, image):
    return {f"{name}.{component}": image for component in "RGB"}


def thumbnail(text, name):
    picture = re.search(rf'alt="{name} of frame [^"]*" src="data:image/png;base64,([^"]+)"', text)
    return imageio.v3.imread(io.BytesIO(base64.b64decode(picture.group(1))))


def test_the_page_is_about_the_beauty(tmp_path):
    image = grey()
    both = layer("ViewLayer.AO", image) | layer("ViewLayer.Combined", image)
    text, _ = page(tmp_path, both, both | layer("ViewLayer.Combined", image * np.float32(0.7)))
    headline = re.search(r'<p class="sum">.*?</p>', text).group()
    psnr = -10 * np.log10(np.mean((0.3 * image.astype(np.float64)) ** 2))
    assert f"<b>{psnr:.2f}</b> psnr" in headline and "ViewLayer.Combined.RGB: whole image" in headline, headline
    assert thumbnail(text, "error x 10").mean() > 100


def test_equal_images_hide_no_others(tmp_path):
    image = grey()
    for number, error in ((1, 0.0), (2, 0.01)):
        frames.write(tmp_path / f"r.{number:04}.exr", dict.fromkeys("RGB", image))
        frames.write(tmp_path / f"t.{number:04}.exr", dict.fromkeys("RGB", image + np.float32(error)))
    tables = tool.lacuna("compare", tmp_path / "r.####.exr", tmp_path / "t.####.exr", "--html", tmp_path / "page.html").stdout
    (mean,) = [line for line in tables.splitlines() if "**mean**" in line]
    assert "| 40.00 (1 of 2 equal) |" in mean and "inf" not in mean, mean
    assert "<b>40.00</b> psnr (dB) (1 of 2 equal)" in (tmp_path / "page.html").read_text()
    # A mean is over frames: layers of one frame are no frames, and each layer has its own.
    dark = layer("key", np.zeros_like(image))
    _, tables = page(tmp_path, dark | layer("fill", image), dark | layer("fill", image + np.float32(0.01)))
    assert "**mean**" not in tables
    for number in (1, 2):
        frames.write(tmp_path / f"l.{number:04}.exr", dark | layer("fill", image))
        frames.write(tmp_path / f"m.{number:04}.exr", dark | layer("fill", image + np.float32(number * 0.01)))
    tables = tool.lacuna("compare", tmp_path / "l.####.exr", tmp_path / "m.####.exr").stdout
    key, fill = [line for line in tables.splitlines() if "**mean**" in line]
    sides = {"key": key, "fill": fill} if "key" in key else {"key": fill, "fill": key}
    assert "| inf |" in sides["key"] and "fill" in sides["fill"] and f"| {40 - 10 * np.log10(2):.2f} |" in sides["fill"], tables


def test_white_is_the_peak(tmp_path):
    image = grey()
    seen = {}
    for peak in (1, 100):
        # Powers of two would scale without rounding; the pictures have eight bits.
        one, other = (np.float32(peak) * plane for plane in (image, image + np.float32(0.02)))
        text, _ = page(tmp_path, dict.fromkeys("RGB", one), dict.fromkeys("RGB", other), "--peak", peak)
        seen[peak] = [thumbnail(text, name) for name in ("reference", "result", "error x 10")]
        assert f'"white":{peak}.0' in text
    for one, other in zip(seen[1], seen[100]):
        assert np.abs(one.astype(int) - other).max() <= 1 and one.mean() < 250


def test_maps_lie_where_the_reference_does(tmp_path):
    image = grey()
    one, other = (dict(R=plane.copy(), Z=plane.copy()) for plane in (image, image + np.float32(0.01)))
    one["R"][3, 4], other["R"][10, 10], one["R"][5, 5], other["R"][5, 5] = np.nan, np.inf, np.inf, np.inf
    words = dict(origin=(20, 10), display=((0, 0), (99, 79)), pixelAspectRatio=2.0, view="left")
    paths = [frames.write(tmp_path / f"{name}.exr", channels, **words) for name, channels in (("r", one), ("t", other))]
    tool.lacuna("compare", *paths, "--maps", tmp_path / "maps")
    file = OpenEXR.File(str(tmp_path / "maps" / "t.maps.exr"), separate_channels=True)
    header = file.header()
    assert [corner.tolist() for corner in header["displayWindow"]] == [[0, 0], [99, 79]]
    assert [corner.tolist() for corner in header["dataWindow"]] == [[20, 10], [69, 49]]
    assert (header["pixelAspectRatio"], header["view"]) == (2.0, "left")
    error = file.channels()["error.R"].pixels
    assert np.isfinite(error).all() and error[3, 4] == error[10, 10] == error[5, 5] == 0 < error[0, 0]


def test_maps_of_one_name_stand_beside_each_other(tmp_path):
    one, other = (np.full((20, 30), value, np.float32) for value in (0.2, 0.3))
    pair = [frames.write(tmp_path / f"{k}.exr", dict.fromkeys(["R", "G", "B", "Y"], plane)) for k, plane in enumerate((one, other))]
    tool.lacuna("compare", *pair, "--maps", tmp_path / "maps")
    maps = frames.read(tmp_path / "maps" / "1.maps.exr")[0]
    assert {"cieluv", "cieluv.Y", "flip", "flip.Y"} <= set(maps)
    layers = lambda dark, light: {f"{layer}.{c}": plane for layer, plane in (("a b", dark), ("a-b", light)) for c in "RGB"}
    pair = [frames.write(tmp_path / f"l{k}.exr", layers(one, plane)) for k, plane in enumerate((one, other))]
    tool.lacuna("compare", *pair, "--maps", tmp_path / "maps")
    found = sorted(path.name for path in (tmp_path / "maps").glob("l1.*error.png"))
    assert found == ["l1.a-b.RGB-2.error.png", "l1.a-b.RGB.error.png"]


def test_maps_that_cannot_be_written_leave_the_measures(tmp_path):
    pair = [frames.write(tmp_path / f"{k}.exr", dict.fromkeys("RGB", np.full((20, 30), k / 4, np.float32))) for k in range(2)]
    (tmp_path / "maps" / "1.maps.exr").mkdir(parents=True)
    result = tool.lacuna("compare", *pair, "--maps", tmp_path / "maps", "--json", tmp_path / "report.json", ok=False)
    (frame,) = json.loads((tmp_path / "report.json").read_text())["frames"]
    assert result.status == 1 and "1.maps.exr" in result.stderr
    assert frame["groups"][0]["regions"][0]["measures"]["mse"] == 1 / 16 and frame["error"] is None
    assert any("1.maps.exr" in note for note in frame["notes"])


def test_alpha_has_a_table_where_it_tells_more_than_the_whole(tmp_path):
    image, alpha = grey(), np.ones((40, 50), np.float32)
    for holes in [0, 9]:
        alpha[:holes] = 0
        text, tables = page(tmp_path, layer("beauty", image) | {"A": alpha}, layer("beauty", image * np.float32(0.9)) | {"A": alpha})
        assert ("### Where alpha is above 0" in tables) == (holes > 0), tables
        assert '<th scope="row">where alpha is above 0</th>' in text
