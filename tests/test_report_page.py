"""The HTML report in a headless Chromium: the slider moves, the zoom shows the right values, sorting sorts, nothing leaves the page."""

import os
import re

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
