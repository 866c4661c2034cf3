"""Man pages and completions: every flag is in them, man renders them without a warning, shells load and use them."""

import os
import pty
import re
import shutil
import subprocess
import time

import pytest

from tool import lacuna

SHELLS = {"bash": "bash-completion/completions/lacuna", "zsh": "zsh/site-functions/_lacuna", "fish": "fish/vendor_completions.d/lacuna.fish"}


@pytest.fixture(scope="module")
def share(tmp_path_factory):
    prefix = tmp_path_factory.mktemp("manual") / "local"
    lacuna("manual", prefix)
    return prefix / "share"


def commands():
    """Every command, as the words that follow `lacuna`."""
    found = [[]]
    for words in found:
        text = lacuna(*words, "--help").stdout
        block = re.search(r"^Commands:\n((?:  .*\n|\n)+)", text, re.MULTILINE)
        if block:
            found += [[*words, name] for name in re.findall(r"^  ([a-z-]+)\b", block[1], re.MULTILINE) if name != "help"]
    return found


def flags(words):
    return set(re.findall(r"^ {2,8}(?:-\w, )?(--[a-z][a-z0-9-]*)", lacuna(*words, "--help").stdout, re.MULTILINE))


def test_a_page_for_every_command_with_every_flag(share):
    everything = commands()
    assert ["fill"] in everything and ["dictionary", "train"] in everything and len(everything) > 18
    pages = share / "man" / "man1"
    assert {page.name for page in pages.iterdir()} == {"-".join(["lacuna", *words]) + ".1" for words in everything}
    for words in everything:
        page = (pages / ("-".join(["lacuna", *words]) + ".1")).read_text().replace("\\-", "-")
        missing = flags(words) - set(re.findall(r"--[a-z][a-z0-9-]*", page))
        assert not missing, (words, missing)
    assert "--tv-gap" in flags(["fill"]) and "--csw-blur" in flags(["fill"])


def test_every_flag_on_a_page_is_described(share):
    for page in sorted((share / "man" / "man1").iterdir()):
        entries = re.split(r"^\.TP\n", page.read_text(), flags=re.MULTILINE)[1:]
        silent = [entry.splitlines()[0] for entry in entries if not re.search(r"^[^.\n\\]", "\n".join(entry.splitlines()[1:]), re.MULTILINE)]
        assert not silent, (page.name, silent)


def test_pages_render_without_a_warning(share):
    tools = [command for command in (["groff", "-man", "-Tutf8", "-ww", "-z"], ["mandoc", "-T", "lint", "-W", "warning"])
             if shutil.which(command[0])]
    if not tools:
        pytest.skip("neither groff nor mandoc")
    for page in sorted((share / "man" / "man1").iterdir()):
        for tool in tools:
            result = subprocess.run([*tool, page], capture_output=True, text=True)
            assert result.returncode == 0 and not result.stderr and "WARNING" not in result.stdout, (page.name, result.stderr + result.stdout)


def completed(share, tmp_path, shell):
    """What the shell offers for `lacuna fill --ss-l`, `lacuna dictionary `, a file and a model."""
    script = share / SHELLS[shell]
    program = {
        "bash": f"""source {script}
            say() {{ COMP_WORDS=("$@"); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); COMPREPLY=(); _lacuna lacuna "${{COMP_WORDS[-1]}}" "${{COMP_WORDS[-2]}}"; printf '%s\\n' "${{COMPREPLY[@]}}"; echo =====; }}
            say lacuna fill --ss-l; say lacuna dictionary ''; say lacuna fill --report pict; say lacuna upscale --sampling ''""",
        "fish": f"""source {script}
            complete -C 'lacuna fill --ss-l'; echo =====; complete -C 'lacuna dictionary '; echo =====; complete -C 'lacuna fill --report pict'; echo =====; complete -C 'lacuna upscale --sampling '""",
    }[shell]
    (tmp_path / "picture.html").touch()
    result = subprocess.run([shell, "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert result.returncode == 0 and not result.stderr, result.stderr
    return result.stdout.split("=====\n")[:4]


@pytest.mark.parametrize("shell", ["bash", "fish"])
def test_shells_complete_flags_commands_and_files(share, tmp_path, shell):
    if not shutil.which(shell):
        pytest.skip(f"no {shell}")
    flag, commands, files, models = completed(share, tmp_path, shell)
    assert "--ss-lambda" in flag and "--tv-gap" not in flag
    assert "train" in commands and "info" in commands
    assert "picture.html" in files
    assert "mitchell" in models and "picture.html" not in models


def typed(line):
    """A line that is typed, the tabulator after it, and the key that writes down what stands there."""
    return f"{line}\t\x18".encode()


def test_zsh_completes_flags_commands_and_files(share, tmp_path):
    if not shutil.which("zsh"):
        pytest.skip("no zsh")
    (tmp_path / "picture.html").touch()
    (tmp_path / ".zshrc").write_text(f"""
        fpath=({(share / SHELLS["zsh"]).parent} $fpath)
        autoload -Uz compinit && compinit -D -u
        write-down() {{ print -r -- "$BUFFER" >>written; BUFFER=; }}
        zle -N write-down; bindkey '^I' complete-word; bindkey '^X' write-down
        echo ready""")
    written = tmp_path / "written"
    terminal, side = pty.openpty()
    shell = subprocess.Popen(["zsh", "-i"], stdin=side, stdout=side, stderr=side, cwd=tmp_path, start_new_session=True,
                             env=os.environ | {"ZDOTDIR": str(tmp_path), "TERM": "dumb", "LC_ALL": "C.UTF-8"})
    try:
        said = b""
        while b"ready" not in said:
            said += os.read(terminal, 1024)
        expected = ["lacuna fill --ss-lambda", "lacuna dictionary train", "lacuna fill --report picture.html"]
        for number, line in enumerate(["lacuna fill --ss-l", "lacuna dictionary tr", "lacuna fill --report pict"]):
            os.write(terminal, typed(line))
            for _ in range(600):
                if written.exists() and written.read_text().count("\n") > number:
                    break
                time.sleep(0.1)
        # A flag that takes a value may be followed by "=".
        assert [line.rstrip(" =") for line in written.read_text().splitlines()] == expected
    finally:
        shell.kill()
        shell.wait()
        os.close(side)
        os.close(terminal)


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    result = lacuna("manual", tmp_path / "file", ok=False)
    assert result.status == 1 and len(result.lines()) == 1 and "file" in result.stderr
