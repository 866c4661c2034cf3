"""`fill --report` and `render --report`: a page without a reference, in a headless Chromium."""

import base64
import io
import json
import re

import imageio.v3
import numpy as np
import pytest

import chromium
import frames
import tool


@pytest.fixture(scope="module", autouse=True)
def browser():
    chromium.require("the page of fill and render")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("filled")
    path = folder / "page.html"
    tool.lacuna("fill", "-q", tool.SAMPLES / "sequence" / "shot.####.exr", "-o", folder / "full.####.exr", "--filter", "ss",
              "--no-estimate", "--report", path)
    return path


def test_it_shows_density_mask_result_and_timings(page):
    with chromium.Page(page.as_uri()) as opened:
        assert opened.messages == []
        assert all(url.startswith(("data:", "blob:")) or url == page.as_uri() for url in opened.requests), opened.requests
        assert opened.run("document.querySelectorAll('#frames tbody tr').length") == 4
        names = opened.run("[...document.querySelectorAll('#frames tbody tr:first-child figcaption')].map(f => f.textContent)")
        assert names == ["mask", "sparse", "result"]
        assert opened.run("[...document.images].every(image => image.complete && image.naturalWidth > 100)")
        text = opened.run("document.body.innerText")
        assert "4 of 4 frames done" in text and "% measured" in text and re.search(r"^domain\s+auto$", text, re.MULTILINE)
        for stage in ("read", "solve", "write"):
            assert re.search(rf"\d\.\d\d s {stage}", text), stage
        assert opened.run("document.querySelectorAll('.plots svg').length") == 2
        head = "[...document.querySelectorAll('#frames thead button')].find(b => b.textContent.startsWith('solve'))"
        opened.run(f"{head}.click()")
        seconds = opened.run("[...document.querySelectorAll('#frames tbody tr')].map(row => Number(row.cells[4].dataset.value))")
        assert seconds == sorted(seconds)


def test_the_viewer_shows_sparse_result_and_estimated_error_and_plays(tmp_path):
    path = tmp_path / "page.html"
    tool.lacuna("fill", "-q", tool.SAMPLES / "sequence" / "shot.####.exr", "-o", tmp_path / "full.####.exr", "--filter", "ss",
                "--error-channel=sigma", "--report", path, "--json", tmp_path / "report.json")
    with chromium.Page(path.as_uri()) as opened:
        opened.wait("document.body.dataset.ready !== undefined")
        assert opened.run("lacuna.viewer.views()") == ["sparse", "result", "estimate"]
        assert opened.run("[lacuna.viewer.seen().left, lacuna.viewer.seen().right]") == ["sparse", "result"]
        # The figure that matters stands in the first lines, and no table is cut.
        told = re.search(r"([\d.]+) dB estimated PSNR of R, G, B of the worst frame, (\d) \(([\d.]+) to ([\d.]+)\)", opened.run("document.body.innerText"))
        column = opened.run("[...document.querySelectorAll('#frames tbody tr')].map(row => Number(row.cells[3].dataset.value))")
        assert float(told[1]) == pytest.approx(min(column), abs=0.051) and column.index(min(column)) + 1 == int(told[2])
        assert float(told[3]) <= float(told[1]) <= float(told[4])
        estimates = [frame["estimates"] for frame in json.loads((tmp_path / "report.json").read_text())["frames"]]
        of_colour = [next(of["psnr"]["estimate"] for of in told if "R" in of["channels"]) for told in estimates]
        assert column == pytest.approx(of_colour, abs=1e-6)
        assert opened.run("[...document.querySelectorAll('.scroll')].every(box => box.scrollWidth <= box.clientWidth)")
        # Three square pictures stand beside each other, as high as they are wide.
        opened.run("document.getElementById('grid').click()")
        cells = opened.run("lacuna.viewer.cells().map(cell => [cell.width, cell.height])")
        assert len(cells) == 3 and all(abs(width - height) <= 3 for width, height in cells), cells
        opened.run("document.getElementById('grid').click()")
        # What errors are multiplied with is asked only where there are some, and a bar says what their colours mean.
        hidden = "document.getElementById('gain').parentElement.offsetParent === null"
        assert opened.run(hidden)
        opened.run("lacuna.viewer.set({ right: 'estimate' })")
        assert not opened.run(hidden)
        assert opened.run("lacuna.range('estimate', { ...lacuna.viewer.state, exposure: 1 })") == ["0", "0.05"]
        assert opened.run("lacuna.range('result', lacuna.viewer.state)") is None
        opened.run("lacuna.viewer.set({ right: 'result' })")
        channels = frames.read(tmp_path / "full.0001.exr")[0]
        n = channels["R"].size
        values = np.array(opened.run(f"[...Array({n}).keys()].map(at => lacuna.viewer.frame.value(lacuna.viewer.frame.test, 0, at))"))
        assert np.allclose(values.reshape(channels["R"].shape), channels["R"].astype(np.float32), rtol=2e-3, atol=2e-4)
        levels = np.array(opened.run(f"[...Array({n}).keys()].map(at => lacuna.level(lacuna.viewer.frame, 'estimate', at))"))
        truth = channels["sigma"]
        assert np.allclose(levels.reshape(truth.shape), truth, rtol=2e-3, atol=2e-5)
        before = opened.run("lacuna.paint(lacuna.viewer.frame, 'result', lacuna.viewer.state).toDataURL()")
        opened.run("lacuna.viewer.canvas.focus()")
        opened.key("f", "KeyF")
        assert opened.run("lacuna.viewer.state.curve") == "false"
        assert opened.run("lacuna.paint(lacuna.viewer.frame, 'result', lacuna.viewer.state).toDataURL()") != before
        opened.key(" ", "Space")
        assert opened.run("document.getElementById('play').textContent") == "Stop"
        opened.wait("document.body.dataset.ready === '3'")
        opened.key(" ", "Space")
        assert opened.run("document.getElementById('play').textContent") == "Play"
        # Stopped and started at once it plays no faster: twelve frames a second.
        opened.run("{ const open = lacuna.open; lacuna.opened = 0; lacuna.open = (index) => { lacuna.opened++; return open(index); }; }")
        opened.run("(async () => { const play = document.getElementById('play'); for (let i = 0; i < 9; i++) play.click(); lacuna.opened = 0; await new Promise((end) => setTimeout(end, 1500)); play.click(); })()")
        assert 0 < opened.run("lacuna.opened") <= 25
        assert opened.run("lacuna.viewer.playing") is False and opened.messages == []


def test_the_viewer_goes_to_a_frame_that_lacks_the_chosen_view(tmp_path):
    for number, flag in ((1, "--error-channel"), (2, "--drop-mask")):
        sparse = tool.SAMPLES / "sequence" / f"shot.{number:04}.exr"
        tool.lacuna("fill", "-q", sparse, "-o", tmp_path / f"full.{number:04}.exr", "--filter", "ss", flag)
        tool.lacuna("fill", "-q", sparse, "-o", tmp_path / f"other.{number:04}.exr", "--filter", "tv", "--no-estimate")
    path = tmp_path / "page.html"
    tool.lacuna("compare", "-q", tmp_path / "other.####.exr", tmp_path / "full.####.exr", "--html", path)
    with chromium.Page(path.as_uri()) as opened:
        opened.wait("document.body.dataset.ready !== undefined")
        show = "(() => { delete document.body.dataset.ready; lacuna.open('%d'); })()"
        opened.run(show % 0)
        opened.wait("document.body.dataset.ready === '0'")
        opened.run("lacuna.viewer.set({ left: 'estimate', right: 'estimate' })")
        opened.run(show % 1)
        opened.wait("document.body.dataset.ready === '1'")
        assert opened.run("lacuna.viewer.views().includes('estimate')") is False
        assert opened.run("[lacuna.viewer.seen().left, document.getElementById('right').value]") == ["reference", "result"]
        # What was asked for comes back where there is it.
        opened.run(show % 0)
        opened.wait("document.body.dataset.ready === '0'")
        assert opened.run("lacuna.viewer.seen()") == {"left": "estimate", "right": "estimate", "grid": False}
        assert opened.messages == []


def test_a_depth_alone_is_shown_by_its_range(tmp_path):
    rows, columns = np.indices((24, 30), dtype=np.float32)
    frames.write(tmp_path / "in.exr", {"Z": 100 + 20 * rows + columns, "mask": frames.shuffle(24, 30, 0.6).astype(np.float32)})
    path = tmp_path / "page.html"
    tool.lacuna("fill", "-q", tmp_path / "in.exr", "-o", tmp_path / "out.exr", "--no-estimate", "--report", path)
    picture = re.search(r'alt="result of [^"]*" src="data:image/png;base64,([^"]+)"', path.read_text())[1]
    picture = imageio.v3.imread(io.BytesIO(base64.b64decode(picture)))
    assert picture[0].max() < 150 and picture[-1].min() > 240, picture


def test_a_phone_needs_no_sideways_scrolling(page):
    with chromium.Page(page.as_uri(), width=390, height=800) as opened:
        assert opened.run("document.documentElement.scrollWidth") <= 390


def test_a_frame_that_fails_is_on_the_page(tmp_path):
    (tmp_path / "in.0001.exr").write_bytes((tool.SAMPLES / "sequence" / "shot.0001.exr").read_bytes())
    (tmp_path / "in.0002.exr").write_bytes(b"no picture")
    page = tmp_path / "page.html"
    result = tool.lacuna("fill", "-q", tmp_path / "in.####.exr", "-o", tmp_path / "out.####.exr", "--report", page, ok=False)
    assert result.status == 1
    with chromium.Page(page.as_uri()) as opened:
        text = opened.run("document.body.innerText")
        assert "1 of 2 frames done, 1 failed" in text and "2 frames filled" not in text and "in.0002.exr" in text
        assert opened.run("document.querySelectorAll('tr.bad').length") == 1


def test_render_says_how_long_rendering_and_filling_took(tmp_path):
    page = tmp_path / "page.html"
    tool.lacuna("render", "-q", tool.SAMPLES / "scenes" / "marschner-lobb.toml", "-o", tmp_path / "out.exr", "--size", "96x96",
                "--density", "0.3", "--fill", "ss", "--report", page)
    with chromium.Page(page.as_uri()) as opened:
        assert opened.messages == []
        text = opened.run("document.body.innerText")
        for stage in ("volume", "render", "fill", "write"):
            assert re.search(rf"\d\.\d\d s {stage}", text), stage
        assert re.search(r"(29|30)\.\d\d % measured", text)
        assert opened.run("document.images.length") == 3
        assert re.search(r"^scene.camera.azimuth\s+30.0$", text, re.MULTILINE)


def test_a_frame_that_is_sparse_still_is_shown_once(tmp_path):
    page = tmp_path / "page.html"
    tool.lacuna("render", "-q", tool.SAMPLES / "scenes" / "marschner-lobb.toml", "-o", tmp_path / "out.exr", "--size", "96x48",
                "--density", "0.3", "--report", page)
    with chromium.Page(page.as_uri()) as opened:
        opened.wait("document.body.dataset.ready !== undefined")
        assert opened.run("lacuna.viewer.views()") == ["result"] and opened.run("lacuna.viewer.cells().length") == 1
        assert opened.run("document.getElementById('left').offsetParent === null")
        assert opened.run("document.images.length") == 2 and "s fill" not in opened.run("document.body.innerText")


def test_the_page_is_no_frame_of_the_run(tmp_path):
    source = tool.SAMPLES / "sequence" / "shot.0001.exr"
    result = tool.lacuna("fill", source, "-o", tmp_path / "out.exr", "--report", tmp_path / "out.exr", ok=False)
    assert result.status == 2 and not (tmp_path / "out.exr").exists()
