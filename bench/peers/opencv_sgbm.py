"""OpenCV StereoSGBM as a peer: two posed photos -> a z-depth map per view.

    python bench/peers/opencv_sgbm.py SCENE OUT --pair 0 1 --size 320 256 [--mode hh|3way] [--filled]

SCENE holds `images/` and `cameras.json` (`[{image, width, height, K[9], camera_from_world[16], near?, far?}]`,
row-major, K in continuous pixels: first pixel centre at 0.5). OUT receives `depth/<stem>.pfm` (z-depth in the
original view, scene units, 0 = none) and the `cameras.json` of the resized views.

The script computes depth and nothing else: scoring is done by surfel-eval for both sides, so that both are
measured by one ruler. Rectification is closed-form from the known poses rather than `cv2.stereoRectify`, which
leaves a vertical pair vertical, where StereoSGBM cannot match it; here the new x axis is the baseline itself.
"""

import argparse
import json
import time
from pathlib import Path

import cv2
import numpy as np

BLOCK = 5
# A rectified canvas larger than this many times the photograph means a baseline close to the viewing direction.
MAX_ENLARGEMENT = 6.0


def load_view(scene, entry, size):
    """Photograph resized with INTER_AREA and its camera in continuous pixels of that size."""
    path = scene / entry["image"]
    path = path if path.exists() else scene / "images" / entry["image"]
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise SystemExit(f"cannot read image {path}")
    width, height = size
    K = np.array(entry["K"], float).reshape(3, 3)
    K[0] *= width / entry["width"]
    K[1] *= height / entry["height"]
    pose = np.array(entry["camera_from_world"], float).reshape(4, 4)
    return {
        "stem": Path(entry["image"]).stem,
        "entry": entry,
        "image": cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA),
        "K": K,
        "R": pose[:3, :3],
        "t": pose[:3, 3],
        "centre": -pose[:3, :3].T @ pose[:3, 3],
    }


def index_K(K):
    """Continuous pixels -> OpenCV's, whose first pixel centre is 0."""
    K = K.copy()
    K[:2, 2] -= 0.5
    return K


def rectifying_rotation(view, other):
    """rectified_from_world with x along the baseline towards `other`; one of the two has positive disparity."""
    x = other["centre"] - view["centre"]
    baseline = np.linalg.norm(x)
    x /= baseline
    forward = view["R"][2] + other["R"][2]
    y = np.cross(forward, x)
    if np.linalg.norm(y) < 1e-3:
        raise SystemExit("the baseline runs along the viewing direction; this pair cannot be rectified")
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)]), baseline


def rectified_rays(view, R_rect, pixels):
    """Rays (N, 3) in the rectified frame of index pixels (N, 2); the camera-frame ray has z = 1."""
    rays = np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(index_K(view["K"])).T
    return rays @ (R_rect @ view["R"].T).T


def border(width, height, steps=24):
    """Index pixels along the image border."""
    xs, ys = np.linspace(-0.5, width - 0.5, steps), np.linspace(-0.5, height - 0.5, steps)
    return np.array([(x, y) for x in xs for y in (ys[0], ys[-1])] + [(x, y) for y in ys for x in (xs[0], xs[-1])])


def depth_of(view, other, depth_range, mode, filled):
    """z-depth map of `view` matched against `other`."""
    height, width = view["image"].shape[:2]
    R_rect, baseline = rectifying_rotation(view, other)
    f = float(np.mean([view["K"][0, 0], view["K"][1, 1]]))
    corners = [rectified_rays(v, R_rect, border(width, height)) for v in (view, other)]
    if any((c[:, 2] <= 0.05).any() for c in corners):
        raise SystemExit("the pair looks too far along its baseline to be rectified")
    spans = [f * c[:, :2] / c[:, 2:] for c in corners]
    y0, y1 = min(s[:, 1].min() for s in spans), max(s[:, 1].max() for s in spans)
    # Rectified depth differs from z-depth by the ray's z in the rectified frame.
    near, far = depth_range
    z_near, z_far = near * corners[0][:, 2].min(), far * corners[0][:, 2].max()
    d_min, d_max = f * baseline / z_far, f * baseline / z_near
    num_disparities = int(np.ceil((d_max - d_min + 4) / 16) * 16)
    # The right principal point takes up the smallest disparity; the pad keeps StereoSGBM, which gives up the
    # first `num_disparities` columns, from losing any part of the photograph.
    pad = num_disparities + BLOCK
    cx_left = pad - spans[0][:, 0].min()
    cx_right = cx_left + np.floor(d_min) - 2
    cy = BLOCK - y0
    canvas_w = int(np.ceil(spans[0][:, 0].max() + cx_left)) + BLOCK
    canvas_h = int(np.ceil(y1 - y0)) + 2 * BLOCK
    if canvas_w * canvas_h > MAX_ENLARGEMENT * (width + pad) * height:
        raise SystemExit(f"rectified canvas of {canvas_w}x{canvas_h} is too large for a {width}x{height} pair")

    def warp(v, cx):
        P = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
        maps = cv2.initUndistortRectifyMap(index_K(v["K"]), None, R_rect @ v["R"].T, P, (canvas_w, canvas_h), cv2.CV_32FC1)
        inside = cv2.remap(np.full((height, width), 255, np.uint8), *maps, cv2.INTER_NEAREST)
        return cv2.remap(v["image"], *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), inside > 0

    (left, left_inside), (right, right_inside) = warp(view, cx_left), warp(other, cx_right)
    matcher = cv2.StereoSGBM_create(
        minDisparity=0,
        numDisparities=num_disparities,
        blockSize=BLOCK,
        P1=8 * 3 * BLOCK**2,
        P2=32 * 3 * BLOCK**2,
        disp12MaxDiff=1,
        preFilterCap=63,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode={"hh": cv2.STEREO_SGBM_MODE_HH, "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY}[mode],
    )
    disparity = matcher.compute(left, right).astype(np.float32) / 16
    # A match outside the other photograph is a match with padding.
    ys, xs = np.indices(disparity.shape)
    partner = np.clip(np.rint(xs - disparity).astype(int), 0, canvas_w - 1)
    valid = (disparity >= 0) & left_inside & right_inside[ys, partner]
    if filled:
        disparity, valid = fill_rows(disparity, valid, left_inside)

    # Every original pixel looks its disparity up in the rectified picture: bilinear on one surface, else nearest.
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 2).astype(float)
    rays = rectified_rays(view, R_rect, pixels)
    u, v = f * rays[:, 0] / rays[:, 2] + cx_left, f * rays[:, 1] / rays[:, 2] + cy
    d, ok = sample(disparity, valid, u, v)
    d = d - (cx_left - cx_right)
    ok &= d > 0
    z = np.where(ok, f * baseline / np.where(ok, d, 1) / rays[:, 2], 0)
    return z.reshape(height, width).astype(np.float32)


def sample(disparity, valid, u, v):
    x0 = np.clip(np.floor(u).astype(int), 0, disparity.shape[1] - 2)
    y0 = np.clip(np.floor(v).astype(int), 0, disparity.shape[0] - 2)
    fx, fy = u - x0, v - y0
    corners = [(0, 0), (0, 1), (1, 0), (1, 1)]
    values = np.stack([disparity[y0 + dy, x0 + dx] for dy, dx in corners])
    present = np.stack([valid[y0 + dy, x0 + dx] for dy, dx in corners])
    weights = np.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy])
    smooth = present.all(0) & (values.max(0) - values.min(0) <= 1)
    near_y, near_x = y0 + (fy > 0.5), x0 + (fx > 0.5)
    d = np.where(smooth, (values * weights).sum(0), disparity[near_y, near_x])
    return d, smooth | valid[near_y, near_x]


def fill_rows(disparity, valid, inside):
    """Holes take the smaller (farther) of the nearest disparities left and right, as KITTI's evaluation does."""
    index = np.arange(disparity.shape[1])
    left = np.maximum.accumulate(np.where(valid, index, -1), 1)
    right = np.minimum.accumulate(np.where(valid, index, len(index))[:, ::-1], 1)[:, ::-1]
    rows = np.arange(disparity.shape[0])[:, None]
    from_left = np.where(left >= 0, disparity[rows, np.maximum(left, 0)], np.inf)
    from_right = np.where(right < len(index), disparity[rows, np.minimum(right, len(index) - 1)], np.inf)
    filled = np.where(valid, disparity, np.minimum(from_left, from_right))
    ok = np.isfinite(filled) & inside
    return np.where(ok, filled, 0).astype(np.float32), ok


def write_pfm(path, depth):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as file:
        file.write(f"Pf\n{depth.shape[1]} {depth.shape[0]}\n-1.0\n".encode())
        file.write(depth[::-1].astype("<f4").tobytes())


def find(entries, name):
    """The view with that stem; `7` also finds `000007`."""
    for entry in entries:
        stem = Path(entry["image"]).stem
        if stem == name or (stem.isdigit() and name.isdigit() and int(stem) == int(name)):
            return entry
    raise SystemExit(f"no view named {name}; there are {[Path(e['image']).stem for e in entries]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cameras", type=Path, help="cameras.json (default: SCENE/cameras.json); `reconstruct` writes one for any scene")
    parser.add_argument("--pair", nargs=2, default=["0", "1"], help="image stems")
    parser.add_argument("--size", nargs=2, type=int, default=[320, 256], metavar=("W", "H"))
    parser.add_argument("--range", nargs=2, type=float, metavar=("NEAR", "FAR"), help="overrides near/far of the cameras")
    parser.add_argument("--mode", choices=["hh", "3way"], default="hh")
    parser.add_argument("--filled", action="store_true", help="fill holes along rectified rows")
    args = parser.parse_args()

    entries = json.loads((args.cameras or args.scene / "cameras.json").read_text())
    views = [load_view(args.scene, find(entries, name), args.size) for name in args.pair]
    cv2.setNumThreads(1)
    for view, other in (views, views[::-1]):
        depth_range = args.range or (view["entry"].get("near"), view["entry"].get("far"))
        if None in depth_range:
            raise SystemExit(f"view {view['stem']} has no near/far in cameras.json; give --range NEAR FAR")
        start = time.perf_counter()
        depth = depth_of(view, other, depth_range, args.mode, args.filled)
        seconds = time.perf_counter() - start
        write_pfm(args.out / "depth" / f"{view['stem']}.pfm", depth)
        print(f"{view['stem']}: {100 * (depth > 0).mean():.1f} % of the pixels have depth, {seconds * 1e3:.0f} ms on one core")
    resized = [
        {**v["entry"], "width": args.size[0], "height": args.size[1], "K": v["K"].ravel().tolist()} for v in views
    ]
    (args.out / "cameras.json").write_text(json.dumps(resized, indent=1))


if __name__ == "__main__":
    main()
