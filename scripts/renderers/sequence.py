"""Frame numbers and the names of their files, as `lacuna` has them."""

import argparse
import os
import pathlib
import re

from bridge import Misuse

# A run of #; a run of two or more @; %d, %04d; $F, $F4.
PLACE = re.compile(r"(?P<hash>#+)|(?P<at>@@+)|%(?P<percent>0[0-9]{0,2}|1?[0-9]?)d|\$F(?P<dollar>[0-9]{1,2}|(?!\w))")
# More frames than this in one range are a slip of the keyboard.
MOST = 1_000_000


def width_of(place):
    """The least number of digits at a place."""
    if place["hash"]:
        return 4 if place["hash"] == "#" else len(place["hash"])
    if place["at"]:
        return len(place["at"])
    digits = place["percent"] if place["percent"] is not None else place["dollar"]
    if place["percent"] and not digits.startswith("0"):
        raise Misuse(f"'%{digits}d' pads with spaces: write %0{digits}d")
    return max(1, int(digits or 1))


def split(pattern):
    """The folders that a path begins with and that exist, whatever signs their names have, and the rest."""
    text = str(pattern)
    ends = (found.end() for found in re.finditer(re.escape(os.sep), text))
    known = max((end for end in ends if os.path.isdir(text[:end])), default=0)
    return text[:known], text[known:]


def frame_name(pattern, frame):
    """The path of a frame: #### (a single # is four digits), %04d, @@@@ and $F4 (four digits), or a plain name."""
    known, rest = split(pattern)
    return known + PLACE.sub(lambda place: str(frame).zfill(width_of(place)), rest)


def source_name(pattern, frame):
    """The same for a file to read: one that exists under the very name is that file."""
    return str(pattern) if pathlib.Path(pattern).is_file() else frame_name(pattern, frame)


def is_pattern(text):
    return bool(PLACE.search(split(text)[1]))


def frame_range(text):
    """1-10, 1-10x2 (or 1-10:2) and 1,5,9-12 as a list of numbers, each once."""
    frames = {}
    for piece in text.split(","):
        found = re.fullmatch(r"(-?[0-9]{1,9})(?:-(-?[0-9]{1,9})(?:[x:]([0-9]{1,9}))?)?", piece.strip())
        if not found:
            raise argparse.ArgumentTypeError(f"'{piece}' is not a frame or a range such as 1-10, 1-10x2 or 1,5,9-12")
        first, last, step = (int(part) if part else None for part in found.groups())
        last, step = first if last is None else last, 1 if step is None else step
        if step == 0:
            raise argparse.ArgumentTypeError(f"the step of '{piece}' must be 1 or more")
        if abs(last - first) // step + len(frames) >= MOST:
            raise argparse.ArgumentTypeError(f"'{piece}' makes more than {MOST} frames")
        numbers = range(first, last + 1, step) if last >= first else range(first, last - 1, -step)
        frames |= dict.fromkeys(numbers)
    return list(frames)
