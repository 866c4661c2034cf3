"""The HTML report in a headless Chromium: the slider moves, the zoom shows the right values, sorting sorts, nothing leaves the page."""

import base64
import csv
import io
import os
import re

import imageio.v3
import numpy as np
import pytest

import chromium
import frames
import tool


@pytest.fixture(scope="module", autouse=True)
def browser():
    chromium.require("the report")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Ten HDR frames, the worst first; their pixels and the page."""
    folder = tmp_path_factory.mktemp("report")
    rows, columns = np.indices((120, 160)) / 20.0
    images = []
    for number in range(1, 11):
        base = 0.4 + 0.4 * np.sin(rows + number / 3) * np.cos(columns)
        light = np.stack([base, 0.6 * base + 0.1, 0.3 * base], axis=-1)
        light += 12 * np.exp(-((rows - 2) ** 2 + (columns - 4) ** 2) * 6)[..., None]
        noise = np.random.default_rng(number).normal(size=light.shape) / (50 * number)
        mask = frames.shuffle(120, 160, 0.25, seed=number)
        one = light.astype(np.float32)
        other = np.where(mask[..., None], one, (light + noise).astype(np.float32))
        images.append((one, other, mask))
        frames.write(folder / f"r.{number:04}.exr", dict(zip("RGB", np.moveaxis(one, -1, 0))))
        frames.write(folder / f"t.{number:04}.exr", dict(zip("RGB", np.moveaxis(other, -1, 0))) | {"mask": mask.astype(np.float32)})
    page = folder / "report.html"
    tool.lacuna("compare", folder / "r.####.exr", folder / "t.####.exr", "--html", page, timeout=300)
    return page, images


def open_page(report, **options):
    page = chromium.Page(report[0].as_uri(), **options)
    page.wait("document.body.dataset.ready !== undefined")
    return page


BOX = "(() => { const b = lacuna.viewer.canvas.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()"
FIRST = "[...document.querySelectorAll('#frames tbody tr')].map(row => Number(row.dataset.index))"


def test_nothing_leaves_the_page_and_nothing_is_wrong(report):
    with open_page(report) as page:
        assert all(url.startswith(("data:", "blob:")) or url == report[0].as_uri() for url in page.requests), page.requests
        assert page.messages == []
        assert "http" not in re.sub(r"http-equiv", "", report[0].read_text())


def test_the_table_sorts_up_and_down(report):
    with open_page(report) as page:
        head = "[...document.querySelectorAll('#frames thead button')].find(b => b.textContent.startsWith('psnr'))"
        page.run(f"{head}.click()")
        assert page.run(FIRST) == list(range(10))
        page.run(f"{head}.click()")
        assert page.run(FIRST) == list(range(9, -1, -1))
        assert page.run(f"{head}.closest('th').getAttribute('aria-sort')") == "descending"


def test_the_slider_moves_by_pointer_key_and_control(report):
    with open_page(report) as page:
        left, top, width, height = page.run(BOX)
        assert page.run("lacuna.viewer.state.split") == 0.5
        page.mouse("mousePressed", left + width / 2, top + height / 2)
        page.mouse("mouseMoved", left + width * 0.25, top + height / 2)
        page.mouse("mouseReleased", left + width * 0.25, top + height / 2)
        assert page.run("lacuna.viewer.state.split") == pytest.approx(0.25, abs=0.01)
        page.run("lacuna.viewer.canvas.focus()")
        page.key("ArrowRight", "ArrowRight")
        assert page.run("Number(document.getElementById('split').value)") == pytest.approx(0.27, abs=0.01)
        page.run("(s => { s.value = 0.8; s.dispatchEvent(new Event('input')); })(document.getElementById('split'))")
        assert page.run("lacuna.viewer.state.split") == 0.8


def test_the_zoom_shows_the_right_pixel_values(report):
    one, other, mask = report[1][0]
    with open_page(report) as page:
        left, top, width, height = page.run(BOX)
        x, y = left + width * 0.4, top + height * 0.6
        for _ in range(12):
            page.mouse("mouseWheel", x, y, deltaX=0, deltaY=-240, button="none", buttons=0)
        assert page.run("lacuna.viewer.state.zoom") == 128
        for dx in (0, 150, 290):
            page.mouse("mouseMoved", x + dx, y, button="none", buttons=0)
            text = page.run("document.getElementById('readout').textContent")
            column, row = map(int, re.search(r"Pixel \((\d+), (\d+)\)", text).groups())
            shown = [list(map(float, re.search(rf"{name} ([-\d. e]+)", text).group(1).split())) for name in ("reference", "result")]
            for found, image in zip(shown, (one, other)):
                print(text, image[row, column])
                assert found == pytest.approx(image[row, column], rel=2e-3, abs=2e-4)
            assert ("measured" if mask[row, column] else "missing") in text


def test_every_frame_and_view_can_be_shown(report):
    with open_page(report) as page:
        page.run("lacuna.viewer.canvas.focus()")
        for key in "1234567":
            page.key(key, f"Digit{key}")
            assert page.run("lacuna.viewer.state.right") == page.run(f"lacuna.viewer.views()[{int(key) - 1}]")
        page.key("g", "KeyG")
        page.key("]", "BracketRight")
        page.key("l", "KeyL")
        assert page.run("[lacuna.viewer.state.grid, lacuna.viewer.state.exposure, lacuna.viewer.state.curve]") == [True, 0.5, "linear"]
        page.key("n", "KeyN")
        page.wait("document.body.dataset.ready === '1'")
        one, other, _ = report[1][1]
        n = one.shape[0] * one.shape[1]
        found = page.run(f"[...Array({n}).keys()].map(at => lacuna.viewer.frame.value(lacuna.viewer.frame.test, 1, at))")
        assert np.allclose(np.array(found).reshape(one.shape[:2]), other[..., 1], rtol=2e-3, atol=2e-4)
        assert page.messages == []


def test_without_javascript_tables_pictures_and_plots_are_there(report):
    with chromium.Page(report[0].as_uri(), javascript=False) as page:
        text = report[0].read_text()
        assert text.count("<tr data-index") == 10 and text.count("<svg") >= 4 and text.count("<img") == 40
        root = page.call("DOM.getDocument", depth=1)["root"]["nodeId"]
        viewer = page.call("DOM.querySelector", nodeId=root, selector="#viewer")["nodeId"]
        assert "hidden" in page.call("DOM.getAttributes", nodeId=viewer)["attributes"]
        image = page.call("DOM.querySelector", nodeId=root, selector="#frames img")["nodeId"]
        assert page.call("DOM.getBoxModel", nodeId=image)["model"]["width"] > 50


def test_every_table_fits_and_every_picture_says_what_it_is(report):
    with open_page(report) as page:
        page.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")
        assert page.run("[...document.querySelectorAll('.scroll')].map(box => box.scrollWidth - box.clientWidth)") == [0] * page.run("document.querySelectorAll('.scroll').length")
        captions = page.run("[...document.querySelectorAll('#frames tbody tr:first-child figcaption')].map(one => one.textContent)")
        assert captions == ["reference", "sparse", "result", "error x 10"]
        assert "on measured pixels: largest error 0, 0 values whose bits differ\n" in page.run("document.body.innerText").replace("\t", "\n")


def test_a_phone_needs_no_sideways_scrolling(report):
    with open_page(report, width=390, height=800) as page:
        assert page.run("document.documentElement.scrollWidth") <= 390


def shown(folder, one, other, then, **header):
    """What `then` finds on the page of two frames, each given by its channels."""
    paths = [frames.write(folder / f"{k}.exr", channels, **header) for k, channels in enumerate((one, other))]
    tool.lacuna("compare", "-q", *paths, "--html", folder / "page.html", "--csv", folder / "all.csv")
    with chromium.Page((folder / "page.html").as_uri()) as page:
        page.wait("document.body.dataset.ready !== undefined")
        then(page)
        assert page.messages == []


LEVEL = "lacuna.level(lacuna.viewer.frame, '%s', %d)"
PAINTED = "[...lacuna.paint(lacuna.viewer.frame, '%s', lacuna.viewer.state).getContext('2d').getImageData(%d, 0, 1, 1).data]"


def test_an_outlier_hides_no_other_error(tmp_path):
    one = np.full((20, 30), 0.25, np.float32)
    other = one + np.float32(0.01)
    other[0, 0] = 5000

    def then(page):
        assert page.run(LEVEL % ("error", 40)) == pytest.approx(0.01, rel=0.05)
        assert page.run(LEVEL % ("error", 0)) == pytest.approx(5000, rel=2e-3)
        assert page.run("lacuna.viewer.values('error', 5, 5)") == ["0.010"]

    shown(tmp_path, dict.fromkeys("RGB", one), dict.fromkeys("RGB", other), then)


def test_black_and_faint_frames_have_values(tmp_path):
    for number, value in enumerate((0, 1e-20)):
        folder = tmp_path / str(number)
        folder.mkdir()
        plane = np.full((20, 30), value, np.float32)
        found = []
        shown(folder, dict.fromkeys("RGB", plane), dict.fromkeys("RGB", plane), lambda page: found.append(page.run("lacuna.viewer.frame.value(lacuna.viewer.frame.test, 0, 7)")))
        assert abs(found[0] - value) <= 1e-3 * value
        text = (folder / "page.html").read_text()
        assert "to within 0.01 %" in text and "dark ones to within 0e0" not in text


def test_what_is_not_finite_is_told_and_drawn(tmp_path):
    one = np.full((20, 30), 0.25, np.float32)
    other = one.copy()
    other[0, 3], other[0, 4] = np.nan, np.inf

    def then(page):
        for at in (3, 4):
            for view in ("result", "error", "cieluv"):
                assert page.run(PAINTED % (view, at)) == [0, 255, 255, 255], view
            assert page.run(f"lacuna.viewer.values('error', {at}, 0)") == ["n/a"]
        assert page.run(PAINTED % ("error", 5))[:3] == [0, 0, 4]
        heads = page.run("[...document.querySelectorAll('#frames thead th')].map(one => one.textContent)")
        assert "new-nan" in heads and "new-inf" in heads, heads

    shown(tmp_path, dict.fromkeys("RGB", one), dict.fromkeys("RGB", other), then)
    picture = re.search(r'alt="error x 10 of [^"]*" src="data:image/png;base64,([^"]+)"', (tmp_path / "page.html").read_text())[1]
    picture = imageio.v3.imread(io.BytesIO(base64.b64decode(picture)))
    assert picture[0, 3].tolist() == picture[0, 4].tolist() == [0, 255, 255] and picture[0, 5].tolist() == [0, 0, 4]
    found = []
    shown(tmp_path, dict.fromkeys("RGB", one), dict.fromkeys("RGB", one), lambda page: found.append(page.run("document.querySelector('#frames thead').textContent")))
    assert "psnr" in found[0] and "new-nan" not in found[0]


def test_cieluv_is_the_measure_of_the_table(tmp_path):
    rows, columns = np.indices((20, 30), dtype=np.float32)
    one = {"R": rows / 40, "G": columns / 60, "B": (rows + columns) / 100}
    other = {name: plane * np.float32(0.8) for name, plane in one.items()}
    wide = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)

    def then(page):
        mean = np.mean(page.run(f"[...Array(600).keys()].map(at => {LEVEL.replace('%d', 'at') % 'cieluv'})"))
        told = [row for row in csv.DictReader((tmp_path / "all.csv").open()) if row["region"] == "all" and row["cieluv"]]
        assert mean == pytest.approx(float(told[0]["cieluv"]), rel=5e-3)

    shown(tmp_path, one, other, then, chromaticities=wide)
    found = []
    shown(tmp_path, {"Z": rows}, {"Z": rows + 1}, lambda page: found.extend(page.run("lacuna.viewer.views()")))
    assert found == ["reference", "result", "error", "ssim"]


def test_pixels_are_as_wide_as_the_file_says_and_wide_frames_as_high_as_can_be_seen(tmp_path):
    def then(page):
        assert page.run("document.querySelector('#frames img').width / document.querySelector('#frames img').height") == pytest.approx(3, rel=0.1)
        left, top, width, height = page.run(BOX)
        scale = page.run("lacuna.viewer.scale(lacuna.viewer.cells()[0])")
        page.mouse("mouseMoved", left + width / 2 + 4.5 * 2 * scale, top + height / 2, button="none", buttons=0)
        assert page.run("document.getElementById('readout').textContent").startswith("Pixel (34, 20)")

    plane = np.full((40, 60), 0.5, np.float32)
    shown(tmp_path, dict.fromkeys("RGB", plane), dict.fromkeys("RGB", plane), then, pixelAspectRatio=2.0)
    plane = np.full((1, 900), 0.5, np.float32)
    found = []
    shown(tmp_path, dict.fromkeys("RGB", plane), dict.fromkeys("RGB", plane), lambda page: found.append(page.run("document.querySelector('#frames img').height")))
    assert found[0] >= 4


@pytest.mark.data
def test_five_renders_weigh_no_more_than_they_may(tmp_path):
    for number, name in enumerate(("engine", "engine-soft", "tooth", "head", "aneurism-iso"), 1):
        os.symlink(tool.DATA / "frames" / f"{name}.exr", tmp_path / f"r.{number:04}.exr")
        tool.lacuna("sparsify", tmp_path / f"r.{number:04}.exr", "-o", tmp_path / f"s.{number:04}.exr", "--density", "0.2", "--seed", number)
    tool.quick_fill(tmp_path / "s.####.exr", "-o", tmp_path / "t.####.exr", timeout=300)
    page = tmp_path / "report.html"
    tool.lacuna("compare", tmp_path / "r.####.exr", tmp_path / "t.####.exr", "--html", page, "--parallel-frames", 2, timeout=600)
    print(f"{page.stat().st_size / 1e6:.2f} MB")
    assert page.stat().st_size <= 7.5e6
    with chromium.Page(page.as_uri()) as opened:
        opened.wait("document.body.dataset.ready !== undefined")
        assert opened.messages == []
