"""Features to surfels: the attribute head (spec 2.7.1) and the adapter (spec 2.7.2, 1.4, 1.5, 1.7)."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import nn

from cameras import quaternion
from layers import Conv

NUM_SHAPE = 6
FRESH_PX = 0.6


@dataclass
class Surfels:
    """One per pixel, view-major then row-major; world frame."""

    centres: torch.Tensor  # [surfels, 3]
    scales: torch.Tensor  # [surfels, 2]
    rotations: torch.Tensor  # [surfels, 4] w x y z
    opacities: torch.Tensor  # [surfels]
    sh: torch.Tensor  # [surfels, coefficients, 3]


class AttributeHead(nn.Module):
    """A neutral head, that of a seeded network, adds a tenth of its output to discs of 0.6 pixel in the surface."""

    def __init__(self, features, config, neutral=False):
        super().__init__()
        outputs = NUM_SHAPE + 3 * (config["sh_degree"] + 1) ** 2
        hidden = config.get("hidden_channels", 2 * outputs)
        self.first, self.second = Conv(features, hidden, 3), Conv(hidden, outputs, 3)
        self.start, self.gain = torch.zeros(1, outputs, 1, 1, dtype=torch.float64), 0.1 if neutral else 1.0
        if neutral:
            low, high = config["scale_min"], config["scale_max"]
            share = torch.tensor((FRESH_PX / 0.2 - low) / (high - low), dtype=torch.float64)
            self.start[:, :2] = share.clamp(0.01, 0.99).logit()
            self.start[:, 2] = 1

    def forward(self, features):
        return self.gain * self.second(F.gelu(self.first(features))) + self.start.to(features.dtype)


def surfels_of(attributes, depth, opacity, cameras, config, base=None):
    """Surfels of raw attributes `[views, outputs, h, w]`, z-depth and opacity `[views, 1, h, w]`.

    With a base (tangent frames `[views, 4, h, w]` and colours `[views, 3, h, w]`), rotations are turns of its frames
    and the constant coefficients corrections of its colours.
    """
    degree, low, high = config["sh_degree"], config["scale_min"], config["scale_max"]
    views, _, height, width = attributes.shape
    dtype = attributes.dtype
    parts = []
    for view in range(views):
        fx, fy, cx, cy = cameras.intrinsics[view]
        world_from_camera = cameras.rotation[view].T
        y, x = torch.meshgrid(
            torch.arange(height, dtype=torch.float64) + 0.5,
            torch.arange(width, dtype=torch.float64) + 0.5,
            indexing="ij",
        )
        rays = torch.stack([(x - cx) / fx, (y - cy) / fy, torch.ones_like(x)], dim=2).reshape(-1, 3)
        raw = attributes[view].reshape(attributes.shape[1], -1).T
        d = depth[view].reshape(-1, 1)
        centres = (rays @ world_from_camera.T).to(dtype) * d + cameras.centres()[view].to(dtype)
        unit = 0.1 * (1 / fx + 1 / fy)
        scales = d * unit.to(dtype) * (low + (high - low) * raw[:, 0:2].sigmoid())
        q = raw[:, 2:6]
        q = q / (q.pow(2).sum(dim=1, keepdim=True) + 1e-8).sqrt()
        sh = raw[:, NUM_SHAPE:].reshape(-1, 3, (degree + 1) ** 2)
        if base is not None:
            frames, colours = (x[view].reshape(x.shape[1], -1).T for x in base)
            q = product(frames, q)
            constant = (4 * torch.pi) ** 0.5 * (colours - 0.5)
            sh = torch.cat([sh[:, :, :1] + constant[:, :, None], sh[:, :, 1:]], dim=2)
        rotations = product(quaternion(world_from_camera).to(dtype), q)
        sh = sh @ sh_rotation(world_from_camera, degree).T.to(dtype)
        parts.append((centres, scales, rotations, opacity[view].reshape(-1), sh.transpose(1, 2)))
    return Surfels(*(torch.cat(part) for part in zip(*parts)))


def product(a, b):
    """Hamilton product of quaternions w x y z, one or `[n, 4]`."""
    w, x, y, z = a.unbind(-1)
    bw, bx, by, bz = b.unbind(-1)
    parts = [
        w * bw - x * bx - y * by - z * bz,
        w * bx + x * bw + y * bz - z * by,
        w * by - x * bz + y * bw + z * bx,
        w * bz + x * by - y * bx + z * bw,
    ]
    return torch.stack(parts, dim=1)


def sh_rotation(a_from_b, degree):
    """`[n, n]`: damps each degree (1, then 0.1 * 0.25^l), then turns coefficients of frame b into those of frame a.

    Fitted to the defining property `B(d) . c_a == B(R^T d) . c_b` at generic directions.
    """
    generator = torch.Generator().manual_seed(0)
    directions = F.normalize(torch.randn(200, 3, generator=generator, dtype=torch.float64), dim=1)
    here, there = sh_basis(directions), sh_basis(directions @ a_from_b)
    matrix = torch.zeros(16, 16, dtype=torch.float64)
    for band in range(4):
        s = slice(band**2, (band + 1) ** 2)
        damping = 1.0 if band == 0 else 0.1 * 0.25**band
        matrix[s, s] = damping * torch.linalg.lstsq(here[:, s], there[:, s]).solution
    return matrix[: (degree + 1) ** 2, : (degree + 1) ** 2]


def sh_basis(d):
    """The real basis of 3DGS, `[n, 16]` (spec 1.5)."""
    x, y, z = d.unbind(1)
    pi = torch.pi
    c1, c2, c3 = (3 / (4 * pi)) ** 0.5, (15 / (4 * pi)) ** 0.5, (35 / (32 * pi)) ** 0.5
    columns = [
        torch.full_like(x, (1 / (4 * pi)) ** 0.5),
        -c1 * y,
        c1 * z,
        -c1 * x,
        c2 * x * y,
        -c2 * y * z,
        (5 / (16 * pi)) ** 0.5 * (2 * z * z - x * x - y * y),
        -c2 * x * z,
        c2 / 2 * (x * x - y * y),
        -c3 * y * (3 * x * x - y * y),
        (105 / (4 * pi)) ** 0.5 * x * y * z,
        -((21 / (32 * pi)) ** 0.5) * y * (4 * z * z - x * x - y * y),
        (7 / (16 * pi)) ** 0.5 * z * (2 * z * z - 3 * x * x - 3 * y * y),
        -((21 / (32 * pi)) ** 0.5) * x * (4 * z * z - x * x - y * y),
        (105 / (16 * pi)) ** 0.5 * z * (x * x - y * y),
        -c3 * x * (x * x - 3 * y * y),
    ]
    return torch.stack(columns, dim=1)
