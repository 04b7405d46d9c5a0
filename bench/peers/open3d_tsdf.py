#!/usr/bin/env python3
"""Fuses the depth maps written by `cargo bench -p surfel-mesh --bench tsdf -- --dump DIR` with Open3D's
ScalableTSDFVolume, same voxel and truncation, and prints its time beside ours.

Usage: python bench/peers/open3d_tsdf.py DIR
Needs: pip install "open3d<0.20" numpy
"""

import json
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import open3d as o3d

RUNS = 3


def read_pfm(path):
    with open(path, "rb") as file:
        channels = {b"Pf": 1, b"PF": 3}[file.readline().strip()]
        width, height = map(int, file.readline().split())
        scale = float(file.readline())
        pixels = np.fromfile(file, "<f4" if scale < 0 else ">f4").reshape(height, width, channels)
    return np.ascontiguousarray(pixels[::-1].squeeze())


def load(folder, view):
    depth = read_pfm(folder / view["depth"])
    colour = np.round(read_pfm(folder / view["colour"]) * 255).astype(np.uint8)
    rgbd = o3d.geometry.RGBDImage.create_from_color_and_depth(
        o3d.geometry.Image(colour),
        o3d.geometry.Image(depth),
        depth_scale=1.0,
        depth_trunc=1e9,
        convert_rgb_to_intensity=False,
    )
    height, width = depth.shape
    # Open3D puts the centre of the first pixel at 0, as cx_index does.
    intrinsic = o3d.camera.PinholeCameraIntrinsic(
        width, height, view["fx"], view["fy"], view["cx_index"], view["cy_index"]
    )
    return rgbd, intrinsic, np.array(view["camera_from_world"], dtype=float)


def measure(folder):
    scene = json.loads((folder / "cameras.json").read_text())
    views = [load(folder, view) for view in scene["views"]]
    fuse_ms, extract_ms = [], []
    for _ in range(RUNS):
        start = time.perf_counter()
        volume = o3d.pipelines.integration.ScalableTSDFVolume(
            voxel_length=scene["voxel"],
            sdf_trunc=scene["truncation"],
            color_type=o3d.pipelines.integration.TSDFVolumeColorType.RGB8,
        )
        for rgbd, intrinsic, camera_from_world in views:
            volume.integrate(rgbd, intrinsic, camera_from_world)
        fused = time.perf_counter()
        mesh = volume.extract_triangle_mesh()
        fuse_ms.append((fused - start) * 1e3)
        extract_ms.append((time.perf_counter() - fused) * 1e3)
    if not mesh.triangles:
        sys.exit(
            f"Open3D {o3d.__version__} made no triangle. Version 0.20 divides float depth by 1000 when it selects"
            " volume units, so ScalableTSDFVolume stays empty; use 0.19."
        )
    theirs = statistics.median(fuse_ms), statistics.median(extract_ms)
    ours = scene["ours_fuse_ms"], scene["ours_extract_ms"]
    print(
        f"{folder.name}: Open3D {o3d.__version__} fuse {theirs[0]:.1f} ms + extract {theirs[1]:.1f} ms"
        f" = {sum(theirs):.1f} ms, {len(mesh.triangles)} triangles (no normals);"
        f" ours {ours[0]:.1f} + {ours[1]:.1f} = {sum(ours):.1f} ms (with normals);"
        f" ratio {sum(theirs) / sum(ours):.1f}"
    )


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folders = sorted(path.parent for path in Path(sys.argv[1]).glob("*/cameras.json"))
    if not folders:
        sys.exit(f"{sys.argv[1]} holds no */cameras.json; write it with the bench first (see the top of this file)")
    for folder in folders:
        measure(folder)


if __name__ == "__main__":
    main()
