"""Files that broke something, read by every subcommand that reads such files: one line of refusal or an image, within the budget; and
public multi-view files, which make the round trip."""

import resource

import pytest

import header
from tool import DATA, SAMPLES, lacuna, run, LACUNA

pytestmark = pytest.mark.data

MIB = 1 << 20
BUDGET = 200 * MIB
FOLDER = DATA / "hostile"
FILES = sorted(path for path in FOLDER.iterdir() if path.suffix != ".md") if FOLDER.is_dir() else []
FRAME = SAMPLES / "sequence" / "shot.0001.exr"
# For the program, its threads, and what the allocator loses.
BESIDE = 64 * MIB
QUICK = ("--filter", "ss", "--no-estimate")


def commands(path, out):
    """Every subcommand that reads such a file, by its kind."""
    memory = ("--memory", "200M")
    if path.suffix == ".exr":
        yield ("info", path, *memory)
        yield ("fill", path, "-o", out, *QUICK, *memory)
        yield ("fill", FRAME, "-o", out, "--mask", f"file:{path}", *QUICK, *memory)
        yield ("fill", path, "-o", out, "--filter", "cs-gradient", *memory)
        yield ("upscale", path, "-o", out, "--scale", "2", "--filter", "tv", *memory)
        yield ("sparsify", path, "-o", out, "--density", "0.2", *memory)
        yield ("verify", FRAME, path, *memory)
        yield ("compare", FRAME, path, *memory)
        yield ("mask", "--after", path, "--add", "0.1", "-o", out, *memory)
        yield ("analyze", path, *memory)
    elif path.suffix == ".png":
        yield ("fill", FRAME, "-o", out, "--mask", f"file:{path}", *QUICK, *memory)
        yield ("analyze", path, *memory)
        yield ("mask", "-o", out, "--size", "64x64", "--density", "0.2", "--inside", path, *memory)
    else:
        raw = ("--raw", "2x2x2:u8:1,1,1e-300") if path.suffix == ".raw" else ()
        yield ("render", path, "-o", out, "--size", "8x8", *raw, *memory)
        yield ("render", path, "-o", out, "--size", "8x8", "--set", "resample=true", *raw, *memory)
    for words in (("dictionary", "info", path), ("dictionary", "decode", path, "--dictionary", path, "-o", out)):
        yield (*words, *memory)


def no_core():
    """A crash leaves no file."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_reader_takes_more_than_its_budget(path, tmp_path):
    for number, words in enumerate(commands(path, tmp_path / "out.exr")):
        plain = words[0] == "info"
        result = run([LACUNA, *words, *(() if plain else ("--threads", "2", "-q"))], timeout=50, before=no_core)
        assert result.status in (0, 1), result
        assert "panicked" not in result.stderr and "internal error" not in result.stderr, result
        assert result.status == 0 or len(result.lines()) >= 1, result
        assert result.peak_bytes <= BUDGET + BESIDE, f"{result.peak_bytes / MIB:.0f} MiB: {result}"
        print(f"{result.peak_bytes / MIB:6.0f} MiB, exit {result.status}: {' '.join(map(str, words))}"[:180])
        (tmp_path / "out.exr").unlink(missing_ok=True)


def multi_view():
    """Public files with several views, in one part or in several, that can be read."""
    if not (DATA / "exr").is_dir():
        return []
    found = []
    for path in sorted((DATA / "exr").rglob("*.exr")):
        if any(word in path.parts for word in ("Damaged", "invalid", "fuzzed")) or header.unsupported(path):
            continue
        parts, _ = header.read(path)
        views = {part.attributes["view"][1] for part in parts if "view" in part.attributes}
        if len(views) > 1 or any("multiView" in part.attributes for part in parts):
            found.append(path)
    return found


@pytest.mark.parametrize("path", multi_view(), ids=lambda path: path.relative_to(DATA / "exr").as_posix())
def test_multi_view_files_make_the_round_trip(path, tmp_path):
    sparse, full = tmp_path / "sparse.exr", tmp_path / "full.exr"
    lacuna("sparsify", path, "-o", sparse, "--density", "0.3", timeout=120)
    lacuna("fill", sparse, "-o", full, "--filter", "pushpull", "--no-estimate", timeout=120)
    lacuna("verify", sparse, full, timeout=120)
    compared = lacuna("compare", path, full, "-q", "--fail-below", "psnr=5", ok=False, timeout=120)
    # What is compared may well be poor: frames of noise. It must be comparable.
    assert compared.status in (0, 1) and "cannot" not in compared.stderr, compared
