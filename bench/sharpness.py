#!/usr/bin/env python3
"""How sharp photographs are: the energy of their finest octave over that of the next.

    bench/sharpness.py PICTURE...

Prints a line per picture. Pictures wider than 320 pixels are first scaled down to that width by area, so that real
photographs and rendered ones (`surfelsplat synth export`) compare. Needs numpy and opencv-python-headless.
"""
import sys

import cv2
import numpy as np

WIDTH = 320

for path in sys.argv[1:]:
    picture = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    if picture is None:
        sys.exit(f"{path}: cannot be read as a picture")
    scale = WIDTH / picture.shape[1]
    if scale < 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    picture = picture.astype(np.float32)
    fine, coarse = (cv2.GaussianBlur(picture, (0, 0), sigma) for sigma in (0.8, 1.6))
    print(f"{(picture - fine).std() / (fine - coarse).std():.2f} {path}")
