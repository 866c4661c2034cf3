"""Rooms of the tool and of the library, as ARCHITECTURE.md lists them, import in one direction: no two of them need each other, over however many others."""

import graphlib
import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Crates of their own, which the compiler keeps apart.
APART = {"core", "python", "transforms", "exr", "volume"}


def code(path):
    """What a file compiles without its tests and comments."""
    text = re.split(r"#\[cfg\(test\)\]\s*mod tests \{", path.read_text())[0]
    return "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("//"))


def is_test(path):
    return path.stem.endswith("tests") or path.stem == "testing" or "tests" in path.parts


def members(group):
    """The first words of what stands in braces, separated by commas: {a, b::c, d::{e, f}} are a, b and d."""
    flat = group
    while (shorter := re.sub(r"\{[^{}]*\}", "", flat)) != flat:
        flat = shorter
    return {re.match(r"\s*(\w*)", part).group(1) for part in flat.split(",")}


def imported(text):
    """The names that follow `crate::`."""
    names = set(re.findall(r"\bcrate::(\w+)", text))
    for group in re.findall(r"\bcrate::\{([^;]*)\}\s*;", text):
        names |= members(group)
    return names


def rooms(source):
    """By room, those that it imports; what the crate's root passes on belongs to the room that it is from."""
    passed_on = {}
    for room, names in re.findall(r"^pub use (\w+)::(\{[^}]*\}|\w+);", code(source / "lib.rs"), re.M):
        passed_on |= dict.fromkeys(members(names.strip("{}")), room)
    found = {}
    for path in sorted(source.rglob("*.rs")):
        inner = path.relative_to(source)
        room = inner.parts[0].removesuffix(".rs")
        if room in APART | {"lib", "main"} or is_test(inner):
            continue
        found.setdefault(room, set()).update(imported(code(path)))
    # A call and a room may have one name; paths lead through the room.
    of = {name: room for name, room in passed_on.items() if name not in found}
    return {room: {of.get(name, name) for name in names} & found.keys() - {room} for room, names in found.items()}


@pytest.mark.parametrize("source", ["src", "filters/src"])
def test_no_rooms_import_each_other(source):
    found = rooms(ROOT / source)
    assert len(found) > 10 and sum(map(len, found.values())) > 30
    graphlib.TopologicalSorter(found).prepare()


def test_a_circle_over_three_rooms_would_be_found(tmp_path):
    files = {
        "lib.rs": "mod a;\nmod b;\nmod c;\npub use c::Seen;\n",
        "a.rs": "use crate::{Unknown, b::{one, two}};\n#[cfg(test)]\nmod tests { use crate::a; }\n",
        "b/part.rs": "// crate::a\nuse crate::Seen;\n",
        "c.rs": "fn f() { crate::a::g() }\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert rooms(tmp_path) == {"a": {"b"}, "b": {"c"}, "c": {"a"}}
    with pytest.raises(graphlib.CycleError):
        graphlib.TopologicalSorter(rooms(tmp_path)).prepare()
