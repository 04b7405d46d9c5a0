"""Writes `cameras.json` for a scene whose cameras are an IDR/NeuS npz (`world_mat_i` = K[R|t], integer pixel centres).

    python bench/peers/export_cameras.py SCENE/cameras_sphere.npz SCENE/image OUT [STEM ...]

OUT receives `cameras.json` (near and far from the unit sphere of `scale_mat_i`) and `images/` with links to the photographs.
"""

import json
import sys
from pathlib import Path

import cv2
import numpy as np


def decompose(P):
    """K (K[2, 2] = 1, positive focals) and camera_from_world of a 3x4 projection, by RQ."""
    flip = np.eye(3)[::-1]
    Q, R = np.linalg.qr((flip @ P[:, :3]).T)
    K, R = flip @ R.T @ flip, flip @ Q.T
    sign = np.diag(np.sign(np.diag(K)))
    K, R = K @ sign, sign @ R
    t = np.linalg.solve(K, P[:, 3])
    if np.linalg.det(R) < 0:
        R, t = -R, -t
    return K / K[2, 2], R, t


def main():
    npz, images, out, *stems = map(str, sys.argv[1:])
    data, out = np.load(npz), Path(out)
    (out / "images").mkdir(parents=True, exist_ok=True)
    cameras = []
    for path in sorted(Path(images).iterdir()):
        if stems and path.stem not in stems:
            continue
        i = int(path.stem)
        P = data[f"world_mat_{i}"][:3].astype(float)
        K, R, t = decompose(P)
        reprojected = K @ np.c_[R, t]
        assert np.allclose(reprojected / reprojected[2, 3], P / P[2, 3], rtol=1e-5, atol=1e-5)
        K[:2, 2] += 0.5
        scale = data[f"scale_mat_{i}"].astype(float)
        z, radius = (R @ scale[:3, 3] + t)[2], scale[0, 0]
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R, t
        height, width = cv2.imread(str(path)).shape[:2]
        link = out / "images" / path.name
        if not link.exists():
            link.symlink_to(path.resolve())
        cameras.append({
            "image": path.name, "width": width, "height": height,
            "K": K.ravel().tolist(), "camera_from_world": pose.ravel().tolist(),
            "near": max(z - radius, 0.05 * z), "far": z + radius,
        })
    (out / "cameras.json").write_text(json.dumps(cameras, indent=1))


if __name__ == "__main__":
    main()
