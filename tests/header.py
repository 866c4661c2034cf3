"""An EXR header reader of our own: attributes as raw bytes, so that a comparison does not depend on anyone's library.

Source: "OpenEXR File Layout", Academy Software Foundation.
"""

import dataclasses
import struct

MAGIC = 0x01312F76
DEEP, MULTI_PART = 1 << 11, 1 << 12
COMPRESSIONS = ["none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab"]
LOSSY = {5, 6, 7, 8, 9}


@dataclasses.dataclass
class Part:
    """One header: attributes `name -> (type, value)` in file order."""

    attributes: dict

    def window(self, name="dataWindow"):
        """x_min, y_min, x_max, y_max."""
        return struct.unpack("<4i", self.attributes[name][1])

    @property
    def compression(self):
        return self.attributes["compression"][1][0]

    @property
    def name(self):
        return self.attributes.get("name", ("string", b""))[1].decode("utf-8", "replace")

    def channels(self):
        """A list of (name, pixel type, x sampling, y sampling); types: 0 uint, 1 half, 2 float."""
        data, result, at = self.attributes["channels"][1], [], 0
        while data[at : at + 1] not in (b"\0", b""):
            end = data.index(b"\0", at)
            kind, _, x, y = struct.unpack_from("<iB3xii", data, end + 1)
            result.append((data[at:end].decode("utf-8", "replace"), kind, x, y))
            at = end + 17
        return result

    def unsupported(self, deep):
        """Why lacuna refuses this part, or None."""
        if deep or self.attributes.get("type", ("string", b""))[1].startswith(b"deep"):
            return "deep"
        if any(x != 1 or y != 1 for _, _, x, y in self.channels()):
            return "subsampled"
        if self.compression >= len(COMPRESSIONS):
            return "compression"
        return None


class Reader:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        piece = self.data[self.at : self.at + count]
        if len(piece) != count:
            raise ValueError("the file ends within the header")
        self.at += count
        return piece

    def text(self):
        end = self.data.find(b"\0", self.at, self.at + 256)
        if end < 0:
            raise ValueError("a name does not end")
        piece, self.at = self.data[self.at : end], end + 1
        return piece.decode("utf-8", "surrogateescape")


def read(path):
    """The parts of a file, and whether its version field says deep. ValueError or struct.error if it is damaged."""
    with open(path, "rb") as file:
        reader = Reader(file.read(1 << 20))
    magic, version = struct.unpack("<II", reader.take(8))
    if magic != MAGIC:
        raise ValueError("not an EXR file")
    parts = []
    while True:
        attributes = {}
        while name := reader.text():
            kind = reader.text()
            attributes[name] = (kind, reader.take(struct.unpack("<I", reader.take(4))[0]))
        if attributes:
            parts.append(Part(attributes))
        if not attributes or not version & MULTI_PART:
            break
    if not parts:
        raise ValueError("a file without parts")
    return parts, bool(version & DEEP) and not version & MULTI_PART


def unsupported(path):
    """Why lacuna refuses the file (deep, subsampled, compression), or None."""
    parts, deep = read(path)
    return next((reason for part in parts if (reason := part.unsupported(deep))), None)
