"""The DTU mesh protocol with numpy and scipy, step by step as the public evaluation scripts do it.

    python bench/peers/dtu_chamfer.py MESH.ply DTU_FOLDER SCAN      the score of a mesh
    python bench/peers/dtu_chamfer.py --toy N FOLDER                writes a toy scan to FOLDER and scores it

The toy is a curved sheet of N x N cells against a denser scan of a shifted copy, made of arithmetic that every language
repeats bit by bit, so surfel-eval rebuilds the same mesh and must get the same numbers. Thinning visits points in the
order of a SplitMix64 hash, as surfel-eval does; everything else is independent of it.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
from scipy.io import loadmat, savemat
from scipy.spatial import cKDTree

SPACING, LIMIT, MARGIN = 0.2, 20.0, 60


def sample_triangle(v0, v1, v2):
    l1, l2, a2 = np.linalg.norm(v1), np.linalg.norm(v2), np.linalg.norm(np.cross(v1, v2))
    if a2 == 0:
        return np.empty((0, 3))
    step = SPACING * np.sqrt(l1 * l2 / a2)
    n1, n2 = np.floor(l1 / step), np.floor(l2 / step)
    c = np.mgrid[: n1 + 1, : n2 + 1].astype(float) + 0.5
    c[0] /= max(n1, 1e-7)
    c[1] /= max(n2, 1e-7)
    c = c.transpose(1, 2, 0)
    k = c[c.sum(-1) < 1]
    return v0 + v1 * k[:, :1] + v2 * k[:, 1:]


def hashed_order(count):
    z = np.arange(count, dtype=np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.argsort(z ^ (z >> np.uint64(31)), kind="stable")


def thin(points):
    points = points[hashed_order(len(points))]
    alive = np.ones(len(points), bool)
    for i, near in enumerate(cKDTree(points).query_ball_point(points, SPACING, workers=-1)):
        if alive[i]:
            alive[near] = False
            alive[i] = True
    return points[alive]


def score(vertices, triangles, folder, scan):
    triangles = vertices[triangles]
    sampled = [sample_triangle(t[0], t[1] - t[0], t[2] - t[0]) for t in triangles]
    # Points are stored in single precision, as a point cloud file stores them.
    data = np.concatenate([vertices, *sampled]).astype(np.float32).astype(float)
    data = thin(data)
    mask = loadmat(folder / f"ObsMask/ObsMask{scan}_10.mat")
    observed, box, res = mask["ObsMask"], mask["BB"].astype(np.float32), mask["Res"]
    data = data[((data >= box[:1] - MARGIN) & (data < box[1:] + MARGIN * 2)).all(-1)]
    grid = np.around((data - box[:1]) / res).astype(np.int32)
    inside = ((grid >= 0) & (grid < observed.shape)).all(-1)
    seen = data[inside][observed[tuple(grid[inside].T)].astype(bool)]
    stl, _ = read_ply(folder / f"Points/stl/stl{scan:03}_total.ply")
    plane = loadmat(folder / f"ObsMask/Plane{scan}.mat")["P"].reshape(1, 4)
    above = stl[(plane * np.c_[stl, np.ones(len(stl))]).sum(-1) > 0]
    d2s = cKDTree(stl).query(seen, workers=-1)[0]
    s2d = cKDTree(data).query(above, workers=-1)[0]
    d2s, s2d = d2s[d2s < LIMIT].mean(), s2d[s2d < LIMIT].mean()
    return {"d2s": d2s, "s2d": s2d, "overall": (d2s + s2d) / 2, "num_data_points": len(seen), "num_surface_points": len(above)}


def read_ply(path):
    """Vertices (N, 3) and triangles (M, 3) of a binary little-endian PLY; triangles need `uchar int` lists."""
    names = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
    with open(path, "rb") as file:
        elements = []
        while (line := file.readline().split()) != [b"end_header"]:
            line = [word.decode() for word in line]
            if line[0] == "element":
                elements.append((line[1], int(line[2]), []))
            elif line[0] == "property" and line[1] == "list":
                elements[-1][2].extend([("n", names[line[2]]), ("v", names[line[3]], 3)])
            elif line[0] == "property":
                elements[-1][2].append((line[2], names[line[1]]))
        rows = {name: np.frombuffer(file.read(np.dtype(kind).itemsize * n), kind) for name, n, kind in elements}
    vertices = np.stack([rows["vertex"][c] for c in "xyz"], -1).astype(float)
    return vertices, rows["face"]["v"] if "face" in rows else np.empty((0, 3), int)


def sheet(n, side, shift):
    """Vertices of a curved sheet of n x n cells, float32 from the same sums and products everywhere."""
    y, x = np.divmod(np.arange((n + 1) ** 2, dtype=float), n + 1)
    x, y = x * side / n, y * side / n
    z = 0.01 * x * x - 0.02 * x * y + 0.3 * y + shift
    return np.stack([x, y, z], -1).astype(np.float32)


def toy(n, folder):
    side = 0.75 * n
    vertices = sheet(n, side, 0.0).astype(float)
    corner = np.arange(n * (n + 1)).reshape(n, n + 1)[:, :-1].ravel()
    a, b, c, d = corner, corner + 1, corner + n + 2, corner + n + 1
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    (folder / "Points/stl").mkdir(parents=True, exist_ok=True)
    (folder / "ObsMask").mkdir(exist_ok=True)
    stl = sheet(2 * n, 0.9 * side, 0.7)
    with open(folder / "Points/stl/stl001_total.ply", "wb") as file:
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(stl)}\nproperty float x\nproperty float y\nproperty float z\n"
        file.write(header.encode() + b"end_header\n" + stl.tobytes())
    low = np.array([0.1 * side, -1, -40])
    high = np.array([0.8 * side, side, 40])
    observed = np.ones(np.ceil((high - low) / 2).astype(int) + 1, bool)
    observed[::3, 1::4] = False
    box = {"ObsMask": observed, "BB": np.stack([low, high]), "Res": 2.0}
    savemat(folder / "ObsMask/ObsMask1_10.mat", box, do_compression=True)
    savemat(folder / "ObsMask/Plane1.mat", {"P": np.array([[0, 1, 0.1, -0.2 * side]]).T})
    return vertices, triangles


def main():
    if sys.argv[1] == "--toy":
        folder, scan = Path(sys.argv[3]), 1
        mesh = toy(int(sys.argv[2]), folder)
    else:
        folder, scan = Path(sys.argv[2]), int(sys.argv[3])
        mesh = read_ply(sys.argv[1])
    start = time.perf_counter()
    result = score(*mesh, folder, scan)
    print(json.dumps({**result, "seconds": time.perf_counter() - start}))


if __name__ == "__main__":
    main()
