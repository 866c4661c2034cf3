"""Makes what the scenes of this folder need besides their text: engraving, meshes and a cloud, all from formulas.

Usage: .venv/bin/python samples/renderers/make.py

Writes into out/renderers: dial.exr (heights of the watch's dial over radius and angle), bezel.ply (a fluted
ring), knot.ply (a torus knot), ball.ply (a sphere), floor.ply (a square) and cloud.vol (densities between 0 and 1).
Needs numpy and OpenEXR.
"""

import pathlib
import struct
import tempfile

import numpy as np
import OpenEXR

MADE = pathlib.Path(__file__).resolve().parents[2] / "out" / "renderers"


def dial(radii=512, angles=4096):
    """Heights: waves that turn with the radius, a bare ring, sixty ticks, and a rim of fine rays. Row: angle, column: radius."""
    r = (np.arange(radii) + 0.5)[None, :] / radii
    a = (np.arange(angles) + 0.5)[:, None] / angles * 2 * np.pi
    waves = 0.5 + 0.5 * np.cos(48 * a + 4 * np.sin(12 * np.pi * r))
    rosette = 0.5 + 0.5 * np.cos(44 * np.pi * r + 1.5 * np.cos(24 * a))
    ticks = np.where(np.cos(60 * a) > 0.8, 0.0, 1.0) * np.where(np.cos(12 * a) > 0.96, 0.6, 1.0)
    rays = 0.5 + 0.5 * np.cos(240 * a)
    height = np.where(r < 0.35, rosette, np.where(r < 0.68, waves, 1.0))
    height = np.where((r > 0.74) & (r < 0.83), ticks, height)
    height = np.where(r > 0.88, rays, height)
    return height.astype(np.float16)


def grid(rows, columns, point):
    """A closed surface: vertices `point(v, u)` with v and u from 0 to 2 pi, and its triangles."""
    v, u = np.meshgrid(np.arange(rows) * 2 * np.pi / rows, np.arange(columns) * 2 * np.pi / columns, indexing="ij")
    vertices = np.stack(np.broadcast_arrays(*point(v, u)), -1).reshape(-1, 3)
    i, j = np.indices((rows, columns))
    at = lambda di, dj: (i + di) % rows * columns + (j + dj) % columns
    quads = np.stack([at(0, 0), at(0, 1), at(1, 1), at(1, 0)], -1).reshape(-1, 4)
    return vertices, np.concatenate([quads[:, [0, 2, 1]], quads[:, [0, 3, 2]]])


def bezel(v, u):
    """A ring about z; its outside has 90 flutes."""
    out = 0.06 + 0.012 * np.cos(90 * v) * (np.cos(u) > 0)
    return (1.06 + out * np.cos(u)) * np.cos(v), (1.06 + out * np.cos(u)) * np.sin(v), 0.05 + 1.2 * out * np.sin(u)


def knot(v, u):
    """A (2, 3) torus knot about y, and around it a tube."""
    def line(t):
        return np.stack([(2 + np.cos(3 * t)) * np.cos(2 * t), np.sin(3 * t), (2 + np.cos(3 * t)) * np.sin(2 * t)], -1) / 3

    along = line(v + 1e-3) - line(v - 1e-3)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    side = np.cross(along, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    up = np.cross(side, along)
    place = line(v) + 0.2 * (np.cos(u)[..., None] * side + np.sin(u)[..., None] * up)
    return place[..., 0], place[..., 1], place[..., 2]


def ball(rows=64, columns=128):
    """A unit sphere with (u, v), closed at the poles by thin triangles."""
    polar, turn = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij")
    vertices = np.stack([np.sin(polar) * np.cos(turn), np.cos(polar), np.sin(polar) * np.sin(turn)], -1).reshape(-1, 3)
    places = np.stack([turn / (2 * np.pi), 1 - polar / np.pi], -1).reshape(-1, 2)
    at = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    corners = [at, at + 1, at + columns + 2, at + columns + 1]
    faces = np.stack([corners[k] for k in (0, 1, 2, 0, 2, 3)], -1).reshape(-1, 3)
    return vertices, faces, places


def ply(path, vertices, faces, places=None):
    """A binary PLY file of triangles with normals, and texture coordinates if given."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    columns = [vertices, normals / np.where(length > 0, length, 1)] + ([places] if places is not None else [])
    names = "x y z nx ny nz".split() + (["s", "t"] if places is not None else [])
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {name}" for name in names]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header\n"]
    rows = np.empty(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    path.write_bytes("\n".join(head).encode() + np.hstack(columns).astype("<f4").tobytes() + rows.tobytes())


def cloud(side=96, seed=5):
    """Densities of a cloud: a heap of balls, eaten away by smooth noise; Mitsuba's grid volume, x fastest."""
    rng = np.random.default_rng(seed)
    place = (np.indices((side, side, side)) + 0.5) / side * 2 - 1
    heap = np.full((side, side, side), -1.0)
    for _ in range(14):
        centre = rng.normal(0, [0.16, 0.22, 0.34])
        radius = rng.uniform(0.22, 0.42)
        heap = np.maximum(heap, 1 - np.sqrt(sum((place[k] - centre[k]) ** 2 for k in range(3))) / radius)
    frequency = np.sqrt(sum(f**2 for f in np.meshgrid(*[np.fft.fftfreq(side) * side] * 3, indexing="ij")))
    noise = np.fft.ifftn(np.fft.fftn(rng.normal(size=heap.shape)) / np.maximum(frequency, 3) ** 2.2).real
    density = np.clip(4 * (heap + 0.22 * noise / noise.std() - 0.12), 0, 1)
    head = b"VOL" + struct.pack("<B5i6f", 3, 1, side, side, side, 1, 0, 0, 0, 1, 1, 1)
    return head + density.astype("<f4").tobytes()


def make(folder):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Y": dial()}).write(str(folder / "dial.exr"))
    ply(folder / "bezel.ply", *grid(1440, 32, bezel))
    ply(folder / "knot.ply", *grid(600, 48, knot))
    ply(folder / "ball.ply", *ball())
    square = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], float)
    ply(folder / "floor.ply", square, np.array([[0, 2, 1], [0, 3, 2]]), square[:, [0, 2]] * 0.5 + 0.5)
    (folder / "cloud.vol").write_bytes(cloud())


def main():
    MADE.mkdir(parents=True, exist_ok=True)
    # Others may be reading what an earlier run made: each file is replaced as a whole.
    with tempfile.TemporaryDirectory(dir=MADE) as folder:
        make(pathlib.Path(folder))
        for path in pathlib.Path(folder).iterdir():
            path.replace(MADE / path.name)


if __name__ == "__main__":
    main()
