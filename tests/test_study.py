"""`lacuna study`: the numbers are those of sparsify, fill and compare; a run goes on where it was cut; the page holds everything."""

import csv
import fcntl
import json
import re
import signal
import subprocess
import time
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import chromium
import frames
import tool

STUDY = """
title = "Two samples"
patterns = ["random", "shuffle"]
densities = [0.2, 0.5]
seeds = [3]
filters = {filters}

[[frames]]
name = "smooth"
file = "{samples}/smooth.exr"
class = "smooth"
crop = [40, 40, 96, 64]

[[frames]]
name = "texture"
file = "{samples}/texture.exr"
class = "texture"
crop = [0, 0, 64, 64]

[[sheets]]
name = "sheet"
frame = "smooth"
pattern = "shuffle"
densities = [0.2]
tile = 48
"""
FILTERS = ["ss", "tv --tv-gap 1e-1", "nearest", "linear"]


def definition(folder, filters=FILTERS):
    path = folder / "study.toml"
    path.write_text(STUDY.format(samples=tool.SAMPLES, filters=json.dumps(filters)))
    return path


def table(folder):
    return list(csv.DictReader((folder / "results.csv").open()))


def test_a_sequence_is_studied_as_fill_fills_it(tmp_path):
    scene = tool.SAMPLES / "scenes" / "marschner-lobb.toml"
    tool.lacuna("render", scene, "-o", tmp_path / "full.####.exr", "--frames", "1-5", "--size", "80x60", "--set", "camera.orbit=1", "--depth")
    along = ["--temporal", "1", "--motion", "camera"]
    path = tmp_path / "study.toml"
    text = f"""patterns = ["shuffle", "adaptive", "half"]
densities = [0.2]
filters = ["ss", "auto {' '.join(along)}"]
[[frames]]
name = "turn"
file = "full.####.exr"
frames = "2-4"
"""
    path.write_text(text)
    tool.lacuna("study", path, "-o", tmp_path / "out")
    rows = {(row["pattern"], row["filter"]): row for row in table(tmp_path / "out")}
    assert len(rows) == 5 and not any(row["error"] for row in rows.values())
    assert float(rows["half", "lanczos3"]["flicker"]) > 0 and "Flicker" in (tmp_path / "out" / "tables.md").read_text()
    read = lambda kind, k, names="RGB": np.stack([frames.read(tmp_path / f"{kind}.{k:04}.exr")[0][name].astype(np.float64) for name in names])
    for pattern, words in (("shuffle", []), ("adaptive", ["--adaptive"])):
        tool.lacuna("sparsify", tmp_path / "full.####.exr", "-o", tmp_path / "sparse.####.exr", "--density", "0.2", *words)
        for label, filter in (("ss", ["--filter", "ss"]), (f"auto {' '.join(along)}", along)):
            # A study knows no alpha, by which fill keeps light within an element.
            tool.lacuna("fill", tmp_path / "sparse.####.exr", "-o", tmp_path / "filled.####.exr", "--frames", "2-4", "--channels", "A=keep", *filter)
            errors = [read("filled", k) - read("full", k) for k in (2, 3, 4)]
            missing = [read("sparse", k, ["mask"])[0] < 0.5 for k in (2, 3, 4)]
            psnr = np.mean([-10 * np.log10(np.mean(error**2)) for error in errors])
            change = [np.mean(((errors[k + 1] - errors[k]) ** 2)[:, missing[k] | missing[k + 1]]) for k in (0, 1)]
            row = rows[pattern, label]
            assert float(row["psnr_db"]) == pytest.approx(psnr, abs=1e-6), (pattern, label)
            assert float(row["flicker"]) == pytest.approx(np.sqrt(np.mean(change)), rel=1e-6), (pattern, label)
    # Cells of frames alone do not run again because another filter asks for neighbours.
    path.write_text(text.replace(', "auto ' + " ".join(along) + '"', ""))
    result = tool.lacuna("study", path, "-o", tmp_path / "out", "-n")
    assert "3 cells, 0 of them to be run" in result.stderr, result.stderr
    for old, new, words in (('frames = "2-4"', "", ["full.####.exr", 'frames = "3-7"']), ("full.####.exr", "full.0002.exr", ["full.0002.exr", "pattern"]),
                            ('"2-4"', '"5-6"', ["full.0006.exr"]), ('"2-4"', '"x"', ["'x' is not a frame"])):
        path.write_text(text.replace(old, new))
        result = tool.lacuna("study", path, "-o", tmp_path / "out", ok=False)
        assert result.status != 0 and all(word in result.stderr for word in words), result.stderr


def steady(rows):
    """Rows without what differs from run to run."""
    return [{key: value for key, value in row.items() if "seconds" not in key} for row in rows]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    tool.lacuna("study", "-q", definition(folder), "-o", folder / "out", timeout=300)
    return folder


def test_rows_are_what_sparsify_fill_and_compare_find(study, tmp_path):
    rows = table(study / "out")
    assert len(rows) == 2 * 2 * 2 * 4 and not any(row["error"] for row in rows)
    full = frames.colour(tool.SAMPLES / "smooth.exr")[40:104, 40:136].astype(np.float16)
    source = frames.write(tmp_path / "full.exr", {name: full[..., k] for k, name in enumerate("RGB")}, origin=(40, 40))
    tool.lacuna("sparsify", "-q", source, "-o", tmp_path / "sparse.exr", "--density", "0.2", "--seed", "3")
    for filter in FILTERS:
        tool.lacuna("fill", "-q", tmp_path / "sparse.exr", "-o", tmp_path / "out.exr", "--filter", *filter.split())
        row = next(row for row in rows if (row["frame"], row["pattern"], row["density"], row["filter"]) == ("smooth", "shuffle", "0.2", filter))
        theirs = frames.psnr(frames.colour(tmp_path / "out.exr"), full.astype(np.float32))
        print(f"{filter:18} study {float(row['psnr_db']):.6f} dB   numpy on fill's output {theirs:.6f} dB")
        assert float(row["psnr_db"]) == pytest.approx(theirs, rel=1e-9)
        compared = json.loads(tool.lacuna("compare", "-q", source, tmp_path / "out.exr", "--measures", "cieluv", "--json", "/dev/stdout").stdout)
        measures = compared["frames"][0]["groups"][0]["regions"][0]["measures"]
        assert float(row["ssim"]) == pytest.approx(measures["ssim"], rel=1e-12)
        assert float(row["cieluv"]) == pytest.approx(measures["cieluv"], rel=1e-12)


def test_values_that_are_not_finite_are_told_once(tmp_path):
    image = frames.colour(tool.SAMPLES / "smooth.exr")[:32, :32].astype(np.float32)
    image[1, 2, 0], image[3, 4, :2] = np.nan, np.inf
    frame = frames.write(tmp_path / "broken.exr", dict(zip("RGB", np.moveaxis(image, -1, 0))))
    path = tmp_path / "study.toml"
    path.write_text('patterns = ["shuffle"]\ndensities = [0.5]\nfilters = ["nearest", "pushpull"]\n'
                    '[[frames]]\nname = "broken"\nfile = "broken.exr"\nclass = "smooth"\n')
    result = tool.lacuna("study", path, "-o", tmp_path / "out")
    told = f"lacuna: warning: {frame}: 3 values are not finite; measured ones count as missing, and no measure counts any: G 1, R 2"
    assert [line for line in result.lines() if "not finite" in line] == [told], result


def test_light_beyond_what_measures_show_is_told_and_the_density_that_came(tmp_path):
    image = np.linspace(0, 3, 3 * 32 * 32, dtype=np.float32).reshape(32, 32, 3)
    frames.write(tmp_path / "bright.exr", dict(zip("RGB", np.moveaxis(image, -1, 0))))
    path = tmp_path / "study.toml"
    path.write_text('patterns = ["grid"]\ndensities = [0.3]\nfilters = ["nearest"]\n[[frames]]\nname = "bright"\nfile = "bright.exr"\n')
    result = tool.lacuna("study", path, "-o", tmp_path / "out")
    assert f"{100 * np.mean(image > 1):.0f} % of its values are above 1, and all measures take them for 1" in result.stderr
    assert "70 % (75 %)" in (tmp_path / "out" / "tables.md").read_text()


def test_a_sparse_frame_is_refused_until_it_is_filled(tmp_path):
    image = frames.colour(tool.SAMPLES / "smooth.exr")[:32, :32].astype(np.float32)
    frames.write_sparse(tmp_path / "sparse.exr", image, frames.shuffle(32, 32, 0.5))
    tool.lacuna("fill", "-q", tmp_path / "sparse.exr", "-o", tmp_path / "filled.exr", "--filter", "linear")
    head = 'title = "T"\npatterns = ["random"]\ndensities = [0.5]\nseeds = [1]\nfilters = ["nearest"]\n'
    for name in ("sparse", "filled"):
        (tmp_path / f"{name}.toml").write_text(head + f'[[frames]]\nname = "a"\nfile = "{name}.exr"\nclass = "c"\n')
    refused = tool.lacuna("study", tmp_path / "sparse.toml", "-o", tmp_path / "out", ok=False)
    assert refused.status == 1 and len(refused.lines()) == 1 and not (tmp_path / "out").exists(), refused
    assert "sparse.exr: the frame has a channel 'mask': the frame looks sparse; fill it first" in refused.stderr
    tool.lacuna("study", "-q", tmp_path / "filled.toml", "-o", tmp_path / "out")


def test_a_cell_that_fails_is_named_as_its_reader_knows_it(tmp_path):
    image = frames.colour(tool.SAMPLES / "smooth.exr")[:8, :8].astype(np.float32)
    frames.write(tmp_path / "small.exr", dict(zip("RGB", np.moveaxis(image, -1, 0))))
    path = tmp_path / "study.toml"
    path.write_text('patterns = ["random"]\ndensities = [0.001]\nseeds = [2]\nfilters = ["nearest"]\n'
                    '[[frames]]\nname = "tiny"\nfile = "small.exr"\nclass = "smooth"\n')
    result = tool.lacuna("study", path, "-o", tmp_path / "out", ok=False)
    errors = [line for line in result.lines() if "error:" in line]
    assert errors and errors[0].startswith("lacuna: error: tiny: nearest, random 0.001, seed 2: "), result


def test_a_cell_that_fails_costs_its_own_tile_and_no_report(tmp_path):
    path, out = tmp_path / "study.toml", tmp_path / "out"
    sheet = f'patterns = ["shuffle"]\ndensities = [0.9, 0.2]\nfilters = ["nearest", "cs-gradient"]\n[[frames]]\nname = "e"\nfile = "{tool.SAMPLES}/edges.exr"\n' \
            'class = "hard"\ncrop = [60, 60, 24, 24]\n[[sheets]]\nname = "q"\nframe = "e"\npattern = "shuffle"\ndensities = [0.2]\nfilters = ["nearest", "cs-gradient"]\n'
    path.write_text(sheet)
    # The same again: what failed is tried again, in the sheet as well.
    for cells in ("4 cells, 4 of them", "4 cells, 1 of them"):
        result = tool.lacuna("study", path, "-o", out, ok=False)
        assert result.status == 1 and cells in result.stderr, result
        told = f"lacuna: error: {out / 'q.svg'}: e: cs-gradient, shuffle 0.2, seed 0: channel B: no two neighbours"
        assert any(line.startswith(told) for line in result.lines()), result
        assert {file.name for file in out.iterdir()} == {"results.jsonl", "results.csv", "results.json", "tables.md", "report.html", "q.svg", "psnr-e.svg", "seconds-e.svg"}
        svg = ElementTree.fromstring((out / "q.svg").read_text())
        assert len(svg.findall("{*}image")) == 2 + 3 and "channel B: no" in "".join(svg.itertext())
        assert "fails at 80 %" in (out / "tables.md").read_text()
    rows = json.loads((out / "results.json").read_text())["rows"]
    assert [row["missing"] is None for row in rows] == [False, False, False, True] == [row["equal"] is None for row in rows]


def test_what_decides_a_result_is_in_its_key(tmp_path):
    image = frames.colour(tool.SAMPLES / "smooth.exr")[:32, :32].astype(np.float16)
    wide = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    for name, kind, header in (("half", np.float16, {}), ("float", np.float32, {}), ("wide", np.float32, {"chromaticities": wide})):
        frames.write(tmp_path / f"{name}.exr", {channel: image[..., k].astype(kind) for k, channel in enumerate("RGB")}, **header)
    path = tmp_path / "study.toml"
    path.write_text('patterns = ["shuffle"]\ndensities = [0.5]\nfilters = ["linear"]\n' + "".join(
        f'[[frames]]\nname = "{name}"\nfile = "{name}.exr"\n' for name in ("half", "float", "wide")))
    tool.lacuna("study", path, "-o", tmp_path / "out")
    assert len((tmp_path / "out" / "results.jsonl").read_text().splitlines()) == 3
    rows = {row["frame"]: row for row in table(tmp_path / "out")}
    assert rows["wide"]["cieluv"] != rows["float"]["cieluv"] and rows["half"]["psnr_db"] != rows["float"]["psnr_db"]


@pytest.mark.parametrize("chosen", ["", 'filters = ["linear"]'])
def test_a_sheet_of_half_the_resolution_names_what_it_shows(tmp_path, chosen):
    path = tmp_path / "study.toml"
    path.write_text(f'patterns = ["shuffle", "half"]\ndensities = [0.2]\nfilters = ["nearest", "linear"]\n[[frames]]\nname = "e"\nfile = "{tool.SAMPLES}/edges.exr"\n'
                    f'crop = [60, 60, 24, 24]\n[[sheets]]\nname = "q"\nframe = "e"\npattern = "half"\ndensities = [0.2]\n{chosen}\n')
    tool.lacuna("study", path, "-o", tmp_path / "out")
    svg = ElementTree.fromstring((tmp_path / "out" / "q.svg").read_text())
    texts = [text.text for text in svg.findall("{*}text")]
    assert texts[0] == "lanczos3" and texts[1].startswith("e, half, 75 % missing:") and not {"nearest", "linear", "sparse"} & set(texts), texts
    assert len(svg.findall("{*}image")) == 1 + 3


def test_a_journal_that_was_cut_is_continued(study, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    lines = (study / "out" / "results.jsonl").read_text().splitlines(keepends=True)
    assert len(lines) == 32
    # A line of another's bytes is as good as one that was cut.
    (out / "results.jsonl").write_bytes("".join(lines[:20]).encode() + b"\xff{}\n" + lines[20][:50].encode())
    path = definition(tmp_path)
    result = tool.lacuna("study", path, "-o", out, timeout=300)
    assert "32 cells, 12 of them to be run" in result.stderr
    assert steady(table(out)) == steady(table(study / "out"))
    # A run names what it would do as its reader knows it.
    told = tool.lacuna("study", definition(tmp_path, [*FILTERS, "pushpull"]), "-o", out, "-n").stderr
    assert "lacuna: texture: pushpull, shuffle 0.5, seed 3\n" in told and "pixels=" not in told
    again = tool.lacuna("study", definition(tmp_path), "-o", out, timeout=300)
    assert "0 of them to be run" in again.stderr and "pictures" not in again.stderr
    more = tool.lacuna("study", definition(tmp_path, [*FILTERS, "pushpull"]), "-o", out, timeout=300)
    assert "40 cells, 8 of them to be run" in more.stderr


def test_a_signal_ends_a_run_and_the_next_one_goes_on(study, tmp_path):
    path, out = definition(tmp_path), tmp_path / "out"
    command = [tool.LACUNA, "study", "-q", path, "-o", out, "--threads", "1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as process:
        journal = out / "results.jsonl"
        while process.poll() is None and not (journal.exists() and journal.read_text().count("\n") > 2):
            time.sleep(0.01)
        process.send_signal(signal.SIGTERM)
        message = process.communicate(timeout=300)[1].decode()
    if process.returncode != 0:
        assert process.returncode == 128 + signal.SIGTERM and "goes on from here" in message
    tool.lacuna("study", "-q", path, "-o", out, timeout=300)
    assert steady(table(out)) == steady(table(study / "out"))


def test_a_folder_is_one_runs_at_a_time(study, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    with (out / "results.jsonl").open("w") as journal:
        fcntl.flock(journal, fcntl.LOCK_EX)
        result = tool.lacuna("study", definition(tmp_path), "-o", out, ok=False)
        assert result.status == 1 and "results.jsonl: another study is running in this folder" in result.stderr, result
        assert len(result.lines()) == 1 and not (out / "results.csv").exists()


def test_pictures_of_frames_that_were_renamed_go(tmp_path):
    out = tmp_path / "out"
    text = ('patterns = ["shuffle"]\ndensities = [0.5]\nfilters = ["nearest"]\n[[frames]]\nname = "NAME"\n'
            f'file = "{tool.SAMPLES}/smooth.exr"\ncrop = [0, 0, 32, 32]\n')
    for name in ("old", "new"):
        (tmp_path / "study.toml").write_text(text.replace("NAME", name))
        out.mkdir(exist_ok=True)
        (out / "mine.svg").write_text("<svg/>\n")
        tool.lacuna("study", "-q", tmp_path / "study.toml", "-o", out)
        # A copy is somebody's.
        (out / f"paper-{name}.svg").write_text((out / f"psnr-{name}.svg").read_text())
    assert {path.name for path in out.glob("*.svg")} == {"psnr-new.svg", "seconds-new.svg", "mine.svg", "paper-old.svg", "paper-new.svg"}


def test_threads_change_no_result(study, tmp_path):
    tool.lacuna("study", "-q", definition(tmp_path), "-o", tmp_path / "out", "--threads", "1", timeout=300)
    assert steady(table(tmp_path / "out")) == steady(table(study / "out"))


def test_figures_are_svg_with_axes_and_small(study):
    names = {path.name for path in (study / "out").glob("*.svg")}
    assert names == {f"{kind}-{frame}.svg" for kind in ("psnr", "seconds", "gain") for frame in ("smooth", "texture")} | {"sheet.svg"}
    for path in (study / "out").glob("*.svg"):
        text = path.read_text()
        ElementTree.fromstring(text)
        assert len(text) < 200_000, path
        if path.name != "sheet.svg":
            assert "missing pixels (%)" in text and "linear" in text
    tables = (study / "out" / "tables.md").read_text()
    assert "| smooth |" in tables and "best filter each time" in tables


def test_the_page_opens_without_network_or_errors(study):
    chromium.require("the study's page")
    page = study / "out" / "report.html"
    with chromium.Page(page.as_uri()) as opened:
        assert opened.messages == []
        assert all(url.startswith(("data:", "blob:")) or url == page.as_uri() for url in opened.requests), opened.requests
        assert opened.run("document.querySelectorAll('figure svg').length") == 6
        assert opened.run("[...document.querySelectorAll('svg image')].every(image => image.getBoundingClientRect().width > 20)")
        opened.run("document.querySelector('details').open = true")
        head = "[...document.querySelectorAll('#frames thead button')].find(b => b.textContent.startsWith('PSNR'))"
        opened.run(f"{head}.click()")
        shown = opened.run("[...document.querySelectorAll('#frames tbody tr')].map(row => Number(row.cells[6].dataset.value))")
        assert len(shown) == 32 and shown == sorted(shown)
    with chromium.Page(page.as_uri(), width=390, height=800) as opened:
        assert opened.run("document.documentElement.scrollWidth") <= 390


@pytest.mark.parametrize("change, words", [
    (("0.5]", "1.5]"), "density 1.5"),
    (('"nearest"', '"nearst"'), "filter 'nearst'"),
    (('"nearest"', '"nearest --tv-gap 1"'), "--tv-gap is a setting of --filter tv"),
    (('"nearest"', '"nearest --time-limit 1"'), "--time-limit depends on the machine"),
    (('frame = "smooth"', 'frame = "rough"'), "there is no frame 'rough'"),
    (("[0.2, 0.5]", "[0.2, 0.2]"), "density '0.2' is there twice"),
    (('"nearest"', '"ss"'), "filter 'ss' is there twice"),
    (('name = "sheet"', 'name = "psnr-smooth"'), "a figure may be called so"),
    (("tile = 48", "window = [0, 0, 9, 9]"), "its window holds no pixel of the frame"),
    (("tile = 48", 'filters = ["all"]'), "filter 'auto' is none of the study's"),
    (("densities = [0.2]\ntile", "densities = []\ntile"), "sheet 'sheet': densities is empty"),
    (('"nearest"', '"nearest --json -"'), "filter 'nearest --json -': a study has no use for --json"),
])
def test_definitions_that_cannot_be_are_usage_errors(tmp_path, change, words):
    path = definition(tmp_path)
    path.write_text(path.read_text().replace(*change))
    result = tool.lacuna("study", path, "-o", tmp_path / "out", ok=False)
    assert result.status == 2 and words in result.lines()[0], result
    assert not (tmp_path / "out").exists()


def test_a_frame_that_is_missing_is_named(tmp_path):
    path = definition(tmp_path)
    path.write_text(path.read_text().replace("smooth.exr", "none.exr"))
    result = tool.lacuna("study", path, "-o", tmp_path / "out", ok=False)
    assert result.status == 1 and "none.exr" in result.stderr and len(result.lines()) == 1


def test_what_is_wrong_with_the_text_is_told_in_one_line(tmp_path):
    path = definition(tmp_path)
    path.write_text(path.read_text() + "\nseeds = [[1]\n")
    result = tool.lacuna("study", path, "-o", tmp_path / "out", ok=False)
    (line,) = result.lines()
    assert result.status == 2 and re.search(r": line \d+: ", line) and "|" not in line, line


def test_frames_that_every_filter_matches_have_no_empty_figure(tmp_path):
    frames.write(tmp_path / "flat.exr", dict.fromkeys("RGB", np.full((24, 30), 0.5, np.float32)))
    (tmp_path / "flat.toml").write_text('patterns = ["grid"]\ndensities = [0.25]\nfilters = ["nearest"]\n[[frames]]\nname = "flat"\nfile = "flat.exr"\n')
    tool.lacuna("study", "-q", tmp_path / "flat.toml", "-o", tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").rglob("*.svg")}
    assert "seconds-flat.svg" in names and "psnr-flat.svg" not in names, names
    assert "1 cell: 1 frame, patterns grid, densities 25 %, 1 seed, filters nearest" in next((tmp_path / "out").glob("*.html")).read_text()
