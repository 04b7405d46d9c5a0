#!/usr/bin/env python3
"""Many pairs of every development scene with a reference, at two sizes, and some larger sets of views, as Markdown:
matching and network scored by one ruler.

    bench/pairs.py SCENES OUT [NAME=WEIGHTS ...]

SCENES holds the development scenes in their original formats; OUT receives the results. Files of WEIGHTS, of training
runs or of this repository's history, get rows of their own under their NAME. One pair may go one way or the other; a
scene's mean over its pairs says more. The pairs of Middlebury's `cones` and `teddy` have no published focal length, so
one is assumed: shares and relative errors do not depend on it. The reference of `sceaux_castle` is a mesh that spans the
sky between its roofs, so that scene is scored once more where its photographs show no sky. Needs numpy and
opencv-python-headless; about half an hour on two cores, and a quarter more for each file of weights.
"""
import json
import pathlib
import subprocess
import sys

import cv2
import numpy as np

from peers.opencv_sgbm import write_pfm

TOOL = pathlib.Path(__file__).resolve().parent.parent / "target/release/surfelsplat"
# Focal length in pixels and baseline in millimetres, as published for the same rig two years later.
ASSUMED = (935, 160)
# Scene, size, pairs.
PAIRS = [
    ("dtu_scan24", "320x256", "0,2 23,24 23,33 24,25 31,32 33,34 43,42 43,44"),
    ("strecha_fountain_p11", "384x256", " ".join(f"{i:04},{i + 1:04}" for i in range(10))),
    ("redwood_rgbd5", "320x240", "00000,00002 00000,00003 00000,00004 00001,00003 00001,00004 00002,00004"),
    ("hololens_000", "384x256", " ".join(f"{i:05},{i + 6:05}" for i in (27, 36, 45, 99, 105, 111, 207, 216, 225))),
    ("middlebury_stereo/cones", "450x375", "im0,im1"),
    ("middlebury_stereo/teddy", "450x375", "im0,im1"),
    ("sceaux_castle", "384x288", "00001,00002 00003,00004 00005,00006 00007,00008"),
]
# The pairs of these scenes once more with four times the pixels, or with all that the photographs have.
LARGER = {
    "dtu_scan24": "640x512",
    "strecha_fountain_p11": "768x512",
    "redwood_rgbd5": "640x480",
    "hololens_000": "540x360",
    "sceaux_castle": "768x576",
}
# Scenes that are scored once more without their sky.
UNDER_FALSE_SKY = ["sceaux_castle"]
# Three to five views at once.
SETS = [
    ("dtu_scan24", "320x256", "23,24,33 43,42,44 23,24,25,33,34"),
    ("strecha_fountain_p11", "384x256", "0004,0005,0006 0006,0007,0008 0002,0003,0004,0005,0006"),
    ("redwood_rgbd5", "320x240", "00000,00002,00004 00000,00001,00002,00003,00004"),
    ("hololens_000", "384x256", "00099,00105,00111 00207,00216,00222"),
    ("sceaux_castle", "384x288", "00002,00003,00004 00005,00006,00007"),
]
COLUMNS = ["within 1 %", "median error %", "normals mean deg"]
SURFACES = ["depth maps", "mesh"]


def rectified(source, folder):
    """A pair of 2003 as later ones are published: photographs, calib.txt and disparities with infinity for unknown."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, name in enumerate("26"):
        picture = cv2.imread(str(source / f"im{name}.png"))
        cv2.imwrite(str(folder / f"im{number}.png"), picture)
        disparity = cv2.imread(str(source / f"disp{name}.png"), cv2.IMREAD_GRAYSCALE).astype("<f4") / 4
        disparity[disparity == 0] = np.inf
        height, width = disparity.shape
        write_pfm(folder / f"disp{number}.pfm", disparity)
    focal, baseline = ASSUMED
    k = f"[{focal} 0 {(width - 1) / 2}; 0 {focal} {(height - 1) / 2}; 0 0 1]"
    lines = [f"cam0={k}", f"cam1={k}", "doffs=0", f"baseline={baseline}", f"width={width}", f"height={height}"]
    (folder / "calib.txt").write_text("\n".join(lines) + "\n")
    return folder


def sky(picture):
    """True where a photograph shows sky: bright, no warmer than white, wider than a gutter, joined to the upper border."""
    blue, _, red = cv2.split(cv2.GaussianBlur(picture, (5, 5), 0))
    like = ((blue >= 150) & (blue >= red)).astype(np.uint8)
    like = cv2.morphologyEx(like, cv2.MORPH_OPEN, np.ones((15, 15), np.uint8))
    _, labels = cv2.connectedComponents(like)
    above = np.unique(labels[0])
    return np.isin(labels, above[above > 0])


def skyless(source, folder):
    """The same scene with masks that leave the sky out."""
    (folder / "masks").mkdir(parents=True, exist_ok=True)
    for path in source.iterdir():
        link = folder / path.name
        if not link.is_symlink():
            link.symlink_to(path.resolve())
    for path in (source / "images").iterdir():
        mask = np.where(sky(cv2.imread(str(path))), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / "masks" / f"{path.stem}.png"), mask)
    return folder


def run(*arguments):
    return subprocess.run([TOOL, *map(str, arguments)], check=True, capture_output=True, text=True).stdout


def reconstructed(scene, views, size, depth, out):
    """The folder of a reconstruction; `depth` is what the command line says of the source of depth."""
    run("--quiet", "reconstruct", scene, "--views", views, "--size", size, *depth, "-o", out)
    return out


def score(scene, folder, *masks):
    """Means over the views of one reconstruction, and its Chamfer distances, scene units."""
    maps, surfaces = json.loads(run("eval", "depth", scene, folder, "--json", *masks))["tables"]
    mean = dict(zip(maps["columns"], maps["rows"][-1]))
    overall = {row[0]: row[-1] for row in surfaces["rows"]}
    return [mean[column] for column in COLUMNS] + [overall[surface] for surface in SURFACES]


def table(kind, sets, scenes, out, methods):
    print(f"| scene | {kind} | method | within 1 % | median error | normals | Chamfer, depth maps | Chamfer, mesh |")
    print("|---|---:|---|---:|---:|---:|---:|---:|")
    for name, size, views in sets:
        scene = scenes / name
        if "middlebury" in name:
            scene = rectified(scene, out / "rectified" / scene.name)
        folders = {method: [] for method in methods}
        for method, depth in methods.items():
            for chosen in views.split():
                folder = out / f"{scene.name}.{size}.{chosen.replace(',', '_')}.{method}"
                folders[method].append(reconstructed(scene, chosen, size, depth, folder))
        rows(f"`{name}` at {size}", {m: np.array([score(scene, f) for f in found]) for m, found in folders.items()})
        if name in UNDER_FALSE_SKY:
            masked = skyless(scene, out / "skyless" / scene.name)
            scores = {m: np.array([score(masked, f, "--masks") for f in found]) for m, found in folders.items()}
            rows(f"`{name}` at {size}, without the sky", scores)


def rows(label, of_methods):
    """Prints a row for each method: means of its scores."""
    matching = of_methods["matching"]
    # Lengths as shares of matching's: scenes count in different units.
    for method, scores in of_methods.items():
        share, median, normals = scores[:, :3].mean(axis=0)
        ratios = np.exp(np.log(scores[:, 3:] / matching[:, 3:]).mean(axis=0))
        ahead = np.hstack([scores[:, :1] > matching[:, :1], scores[:, 1:] < matching[:, 1:]]).sum(axis=0)
        wins = [""] * len(ahead) if method == "matching" else [f" ({n})" for n in ahead]
        cells = [f"{100 * share:.1f} %", f"{median:.3f} %", f"{normals:.1f}°", *(f"{ratio:.3f}" for ratio in ratios)]
        cells = [cell + win for cell, win in zip(cells, wins)]
        print(f"| {label} | {len(scores)} | {method} |", " | ".join(cells), "|", flush=True)


def main():
    scenes, out = map(pathlib.Path, sys.argv[1:3])
    methods = {"matching": ["--depth", "matching"], "network": ["--depth", "network"]}
    for name, weights in (argument.split("=", 1) for argument in sys.argv[3:]):
        methods[name] = ["--depth", "network", "--weights", weights]
    larger = [(name, LARGER[name], pairs) for name, _, pairs in PAIRS if name in LARGER]
    tables = [
        ("Many pairs of every scene", "pairs", PAIRS),
        ("The same pairs at larger sizes", "pairs", larger),
        ("Three to five views at once", "sets", SETS),
    ]
    for heading, kind, sets in tables:
        print(f"## {heading}\n")
        table(kind, sets, scenes, out, methods)
        print()


if __name__ == "__main__":
    main()
