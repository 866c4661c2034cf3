"""Dictionaries: training, filling, encoding, against scikit-learn's pursuit and NumPy, and what bad input meets."""

import json
import zipfile

import numpy as np
import OpenEXR
import pytest
from sklearn.linear_model import orthogonal_mp

import frames
from tool import SAMPLES, lacuna, quick_fill

BLOCK = 8


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A small dictionary over colour blocks, and the frame that it was trained on."""
    folder = tmp_path_factory.mktemp("dictionary")
    result = lacuna("dictionary", "train", SAMPLES / "smooth.exr", "-o", folder / "show.dict", "--block", BLOCK, "--atoms", 300, "--stride", 2,
                    "--sparsity", 5, "--iterations", 6, "--seed", 3, "-v")
    return folder / "show.dict", frames.colour(SAMPLES / "smooth.exr"), result


def blocks(image, stride=BLOCK):
    """Blocks of the rows and columns that whole blocks fill, channel after channel, one a row."""
    height, width = (length // BLOCK * BLOCK for length in image.shape[:2])
    corners = [(y, x) for y in range(0, height, stride) for x in range(0, width, stride)]
    return np.stack([image[y : y + BLOCK, x : x + BLOCK].transpose(2, 0, 1).ravel() for y, x in corners])


def restored(folder, image, dictionary, *words):
    """The pure approximation of an image of whole blocks without a missing pixel."""
    mask = np.ones(image.shape[:2], bool)
    source = frames.write_sparse(folder / "whole.exr", image, mask)
    quick_fill("-q", source, "-o", folder / "restored.exr", "--filter", "dictionary", "--dictionary", dictionary, "--dict-restore",
           "--dict-stride", BLOCK, "--domain", "linear", *words)
    return frames.colour(folder / "restored.exr")


def whole(image):
    height, width = (length // BLOCK * BLOCK for length in image.shape[:2])
    return np.ascontiguousarray(image[:height, :width].astype(np.float32))


def test_numpy_opens_a_dictionary_and_finds_what_was_asked_for(trained):
    path, _, result = trained
    with np.load(path) as file:
        atoms = file["atoms"]
        assert atoms.shape == (3 * BLOCK * BLOCK, 300) and atoms.dtype == np.float32
        np.testing.assert_allclose(np.linalg.norm(atoms, axis=0), 1, atol=1e-5)
        assert (file["block"], file["channels"], file["sparsity"], file["seed"], file["iterations"]) == (BLOCK, 3, 5, 3, 6)
        errors = file["errors"]
        assert len(errors) == 6 and np.all(np.diff(errors) <= 1e-6 * errors[:-1])
        assert len(file["data_hash"]) == 32 and file["usage"].sum() <= 5 * file["signals"]
        # The codes, with which training goes on, say the same as usage.
        assert len(file["code_lengths"]) == file["signals"] and file["code_lengths"].sum() == len(file["code_factors"])
        np.testing.assert_array_equal(np.bincount(file["code_atoms"], minlength=300), file["usage"])
    assert "iteration 6 of 6: error" in result.stderr


def test_full_blocks_get_the_code_of_scikit_learn(tmp_path, trained):
    path, image, _ = trained
    image = whole(image)
    found = blocks(restored(tmp_path, image, path, "--dict-sparsity", 7))
    with np.load(path) as file:
        atoms = file["atoms"].astype(np.float64)
    signals = blocks(image).astype(np.float64)
    expected = (atoms @ orthogonal_mp(atoms, signals.T, n_nonzero_coefs=7, precompute=True)).T
    scale = np.linalg.norm(signals, axis=1) + 1e-12
    apart = np.linalg.norm(found - expected, axis=1) / scale
    # Where two atoms are equally good, rounding to 32 bits decides; what is left over is as small then.
    assert np.mean(apart < 2e-4) > 0.95
    left, other = (np.linalg.norm(image - signals, axis=1) / scale for image in (found, expected))
    assert np.abs(left - other).max() < 0.02 and abs(left.mean() - other.mean()) < 1e-3


def test_filling_keeps_measured_bits_and_atoms_learned_here_beat_cosines(tmp_path, trained):
    path, image, _ = trained
    image = whole(image)
    mask = frames.shuffle(*image.shape[:2], 0.3)
    source = frames.write_sparse(tmp_path / "in.exr", image, mask)
    found = {}
    for name, words in {"trained": ("--filter", "dictionary", "--dictionary", path), "dct": ("--filter", "dct")}.items():
        outputs = []
        for threads in ("1", "3"):
            out = tmp_path / f"{name}{threads}.exr"
            report = tmp_path / "report.json"
            quick_fill("-q", source, "-o", out, *words, "--threads", threads, "--json", report)
            outputs.append(out.read_bytes())
        assert outputs[0] == outputs[1]
        assert json.loads(report.read_text())["frames"][0]["density"] == pytest.approx(0.3, abs=0.01)
        filled = frames.colour(out)
        assert frames.same_bits(filled[mask], image[mask]) and np.isfinite(filled).all()
        lacuna("verify", "-q", source, out)
        found[name] = frames.psnr(filled, image)
    assert found["trained"] > 30 and found["dct"] > 25, found


def test_other_channels_go_with_splines_and_the_attributes_name_the_dictionary(tmp_path, trained):
    path, image, _ = trained
    image = whole(image)
    mask = frames.shuffle(*image.shape[:2], 0.4)
    planes = {name: np.where(mask, image[..., k], 0).astype(np.float32) for k, name in enumerate("RGB")}
    source = frames.write(tmp_path / "in.exr", planes | {"A": mask.astype(np.float32), "mask": mask.astype(np.float32)})
    result = quick_fill(source, "-o", tmp_path / "out.exr", "--filter", "dictionary", "--dictionary", path, "-v")
    assert "A: not of the dictionary, filled by auto" in result.stderr
    settings = OpenEXR.File(str(tmp_path / "out.exr")).parts[0].header["lacuna/settings"]
    name = next(line.split()[1] for line in lacuna("dictionary", "info", path).stdout.splitlines() if line.startswith("dictionary"))
    assert len(name) == 16 and f"dictionary={name}" in settings
    assert np.allclose(frames.read(tmp_path / "out.exr")[0]["A"], 1)


def test_encoded_frames_come_back(tmp_path, trained):
    path, image, _ = trained
    lacuna("dictionary", "encode", SAMPLES / "smooth.exr", "--dictionary", path, "-o", tmp_path / "frame.code", "--dict-sparsity", 12, "--bits", 12)
    said = lacuna("dictionary", "encode", SAMPLES / "smooth.exr", "--dictionary", path, "-o", tmp_path / "frame.code", "--dict-sparsity", 12).stdout
    lacuna("dictionary", "decode", tmp_path / "frame.code", "--dictionary", path, "-o", tmp_path / "back.exr")
    back = frames.colour(tmp_path / "back.exr")
    assert back.shape == image.shape and frames.psnr(back, image) > 30
    size = (tmp_path / "frame.code").stat().st_size
    assert said.startswith(f"{size} bytes, {8 * size / image[..., 0].size:.3f} bits per pixel, PSNR ")


def test_encoding_tells_what_compare_does(tmp_path, trained):
    path, _, _ = trained
    frame, back = SAMPLES / "hdr.exr", tmp_path / "back.exr"
    said = lacuna("dictionary", "encode", frame, "--dictionary", path, "-o", tmp_path / "frame.code")
    lacuna("dictionary", "decode", tmp_path / "frame.code", "--dictionary", path, "-o", back)
    measures = json.loads(lacuna("compare", "-q", frame, back, "--json", "/dev/stdout").stdout)["frames"][0]["groups"][0]["regions"][0]["measures"]
    assert f"PSNR {measures['psnr']:.2f} dB" in said.stdout, said
    before, after = (frames.colour(name).max() for name in (frame, back))
    assert before > 2 and not before / 2 <= after <= before * 2, (before, after)
    told = [line for line in said.lines() if "light above 1 is not kept" in line]
    assert len(told) == 1 and str(frame) in told[0] and f"{before:g}" in told[0], said


def test_values_that_are_not_finite_are_told(tmp_path, trained):
    path, image, _ = trained
    broken = image.astype(np.float32)
    broken[3, 4, 0] = broken[5, 6, 0] = np.inf
    broken[7, 8, 1] = np.nan
    frame = frames.write(tmp_path / "broken.0007.exr", dict(zip("RGB", np.moveaxis(broken, -1, 0))))
    told = f"lacuna: warning: {frame}: 3 values are not finite and count as 0: R 2, G 1"
    for words in (["dictionary", "encode", frame, "--dictionary", path, "-o", tmp_path / "frame.code"],
                  ["dictionary", "train", frame, "-o", tmp_path / "b.npz", "--block", 4, "--atoms", 60, "--iterations", 1]):
        result = lacuna(*words)
        assert result.lines().count(told) == 1, result


def test_sparse_frames_are_refused_until_they_are_filled(tmp_path, trained):
    path, image, _ = trained
    sparse = frames.write_sparse(tmp_path / "sparse.exr", image.astype(np.float32), frames.shuffle(*image.shape[:2], 0.4))
    filled = tmp_path / "filled.exr"
    quick_fill("-q", sparse, "-o", filled, "--filter", "linear")
    assert "mask" in frames.read(filled)[0]
    words = {"encode": ["--dictionary", path, "-o", tmp_path / "frame.code"],
             "train": ["-o", tmp_path / "b.npz", "--block", 4, "--atoms", 60, "--iterations", 1]}
    for command, more in words.items():
        refused = lacuna("dictionary", command, sparse, *more, ok=False)
        told = f"lacuna: error: {sparse}: the frame has a channel 'mask': the frame looks sparse; fill it first"
        assert refused.status == 1 and len(refused.lines()) == 1 and refused.stderr.startswith(told), refused
        assert not more[more.index("-o") + 1].exists()
        lacuna("dictionary", command, filled, *more)


def test_info_draws_the_atoms(tmp_path, trained):
    path, _, _ = trained
    said = lacuna("dictionary", "info", path, "--png", tmp_path / "atoms.png").stdout
    assert "300 of 192 numbers" in said and "usage" in said and "coherence" in said
    assert (tmp_path / "atoms.png").read_bytes().startswith(b"\x89PNG")


def without_codes(path):
    """The file as versions before this one left it at the end."""
    with zipfile.ZipFile(path) as archive:
        kept = {name: archive.read(name) for name in archive.namelist() if not name.startswith("code_")}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in kept.items():
            archive.writestr(name, data)
    return path.read_bytes()


def test_a_finished_training_resumes_and_other_settings_do_not(tmp_path):
    path = tmp_path / "a.npz"
    words = ["dictionary", "train", SAMPLES / "smooth.exr", "-q", "--block", 4, "--atoms", 60, "--sparsity", 3]
    mine = [*words, "-o", path]
    lacuna(*mine, "--iterations", 2)
    before = path.read_bytes()
    lacuna(*mine, "--iterations", 2, "--resume")
    assert path.read_bytes() == before and before[:4] == b"PK\x03\x04"
    lacuna(*mine, "--iterations", 5, "--resume")
    lacuna(*words, "-o", tmp_path / "straight.npz", "--iterations", 5)
    assert path.read_bytes() == (tmp_path / "straight.npz").read_bytes()
    old = without_codes(path)
    lacuna(*mine, "--iterations", 5, "--resume")
    for other, reason in ((["--iterations", 5, "--seed", 9], "is of other frames or settings"), (["--iterations", 4], "has 5 iterations already"),
                          (["--iterations", 6], "codes of its blocks, so it cannot be continued")):
        refused = lacuna(*mine, *other, "--resume", ok=False)
        assert refused.status == 1 and f"{path}: " in refused.stderr and reason in refused.stderr and len(refused.lines()) == 1, refused
    assert path.read_bytes() == old


def bad_files(folder, good):
    """Files that are no dictionary, by name."""
    content = good.read_bytes()
    yield "text", b"no dictionary"
    yield "empty", b""
    yield "half", content[: len(content) // 2]
    with zipfile.ZipFile(good) as archive:
        arrays = {name: archive.read(name) for name in archive.namelist()}
    header = b"\x93NUMPY\x01\x00\x76\x00" + b"{'descr': '<f4', 'fortran_order': False, 'shape': (999999999, 999999999), }".ljust(117) + b"\n"
    for name, changed in {"huge": {"atoms.npy": header}, "none": {"atoms.npy": None}}.items():
        path = folder / f"{name}.npz"
        with zipfile.ZipFile(path, "w") as archive:
            for entry, data in (arrays | changed).items():
                if data is not None:
                    archive.writestr(entry, data)
        yield name, path.read_bytes()
    bomb = folder / "bomb.npz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("atoms.npy", bytes(1 << 28))
    yield "bomb", bomb.read_bytes()


def test_frames_that_do_not_exist_are_passed_over_if_asked(tmp_path):
    words = ["dictionary", "train", SAMPLES / "smooth.exr", tmp_path / "none.exr", "--block", 4, "--atoms", 60, "--iterations", 1, "-o"]
    assert "none.exr" in lacuna(*words, tmp_path / "a.npz", ok=False).stderr
    assert "1 of 2 frames do not exist" in lacuna(*words, tmp_path / "b.npz", "--missing-frame", "skip").stderr
    lacuna(*words[:3], *words[4:], tmp_path / "c.npz")
    assert (tmp_path / "b.npz").read_bytes() == (tmp_path / "c.npz").read_bytes()


@pytest.mark.parametrize("height, width", [(5, 40), (40, 5), (3, 3), (1, 1)])
def test_frames_smaller_than_a_block_are_encoded_as_well_as_others(tmp_path, trained, height, width):
    path, image, _ = trained
    small = image[30 : 30 + height, 40 : 40 + width].astype(np.float32)
    frame = frames.write(tmp_path / "small.exr", dict(zip("RGB", np.moveaxis(small, -1, 0).copy())))
    lacuna("dictionary", "encode", frame, "--dictionary", path, "-o", tmp_path / "small.code", "--dict-sparsity", 12, "--bits", 14)
    lacuna("dictionary", "decode", tmp_path / "small.code", "--dictionary", path, "-o", tmp_path / "back.exr")
    assert frames.psnr(frames.colour(tmp_path / "back.exr"), small) > 35
    assert "less than a block" in lacuna("dictionary", "train", frame, "-o", tmp_path / "d.npz", "--block", 8, "--atoms", 1, "--sparsity", 1, ok=False).stderr


def test_colours_of_other_names_are_told(tmp_path, trained):
    path, image, _ = trained
    planes = np.moveaxis(image.astype(np.float32), -1, 0)
    for names, told in (("RGB", False), ("rgb", True), (("lit.red", "lit.green", "lit.blue"), True)):
        frame = frames.write(tmp_path / "frame.exr", {name: plane.copy() for name, plane in zip(names, planes)})
        result = lacuna("dictionary", "encode", frame, "--dictionary", path, "-o", tmp_path / "frame.code")
        assert ("decoded as R, G, B" in result.stderr) == told, result
        assert "PSNR unknown" not in result.stdout


def test_values_past_all_light_are_refused(tmp_path, trained):
    path, _, _ = trained
    rng = np.random.default_rng(1)
    frame = frames.write(tmp_path / "huge.exr", {name: (3e38 * rng.uniform(-1, 1, (64, 64))).astype(np.float32) for name in "RGB"})
    for words in (["dictionary", "encode", frame, "--dictionary", path], ["dictionary", "train", frame, "--block", 8, "--atoms", 20]):
        result = lacuna(*words, "-o", tmp_path / "out", ok=False)
        assert result.status == 1 and "too large to" in result.stderr and not (tmp_path / "out").exists(), result


def test_bad_input_ends_in_one_line(tmp_path, trained):
    path, _, _ = trained
    frame = SAMPLES / "smooth.exr"
    lacuna("dictionary", "encode", frame, "--dictionary", path, "-o", tmp_path / "frame.code")
    lacuna("dictionary", "train", frame, "-q", "-o", tmp_path / "other.npz", "--block", 4, "--atoms", 60, "--iterations", 1)
    code = (tmp_path / "frame.code").read_bytes()
    commands = {
        "no dictionary": (["fill", frame, "-o", tmp_path / "o.exr", "--filter", "dictionary"], "needs --dictionary"),
        "a foreign setting": (["fill", frame, "-o", tmp_path / "o.exr", "--dict-sparsity", 3], "--filter dictionary"),
        "a stride": (["fill", frame, "-o", tmp_path / "o.exr", "--filter", "dictionary", "--dictionary", path, "--dict-stride", 9], "block"),
        "too many atoms": (["dictionary", "train", frame, "-o", tmp_path / "o.npz", "--block", 64, "--atoms", 16384], "blocks"),
        "no folder": (["dictionary", "train", frame, "-o", tmp_path / "none/o.npz", "--block", 4, "--atoms", 60], "--create-dir"),
        "no frame": (["dictionary", "train", tmp_path / "none.exr", "-o", tmp_path / "o.npz"], "none.exr"),
        "another dictionary": (["dictionary", "decode", tmp_path / "frame.code", "--dictionary", tmp_path / "other.npz", "-o", tmp_path / "o.exr"],
                               "encoded with dictionary"),
        "a frame called .png": (["dictionary", "decode", tmp_path / "frame.code", "--dictionary", path, "-o", tmp_path / "o.png"], "o.png: the file that is written ends in .exr"),
        "a picture called .exr": (["dictionary", "info", path, "--png", tmp_path / "o.exr"], "o.exr: the file that is written ends in .png"),
        "no code": (["dictionary", "decode", frame, "--dictionary", path, "-o", tmp_path / "o.exr"], "not an encoded frame"),
    }
    for name, content in bad_files(tmp_path, path):
        (tmp_path / name).write_bytes(content)
        commands[name] = (["dictionary", "info", tmp_path / name], name)
    for length in (0, 20, 60, len(code) // 2, len(code) - 3):
        (tmp_path / f"cut{length}").write_bytes(code[:length])
        commands[f"cut{length}"] = (["dictionary", "decode", tmp_path / f"cut{length}", "--dictionary", path, "-o", tmp_path / "o.exr"], "cut")
    for at in (8, 9, 30, 50, 64, len(code) - 3):
        (tmp_path / f"flip{at}").write_bytes(code[:at] + bytes([code[at] ^ 1]) + code[at + 1 :])
        commands[f"flip{at}"] = (["dictionary", "decode", tmp_path / f"flip{at}", "--dictionary", path, "-o", tmp_path / "o.exr"], f"flip{at}")
    for name, (words, reason) in commands.items():
        result = lacuna(*words, ok=False)
        assert result.status in (1, 2) and len(result.lines()) == 1 and reason in result.stderr, (name, str(result))
        assert result.peak_bytes < 600 << 20, name
        assert not any((tmp_path / f"o.{ending}").exists() for ending in ("exr", "npz", "png"))
