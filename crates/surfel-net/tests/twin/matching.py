"""Plane sweep by grid sampling (spec 2.4.1) and the coarse depth read from it (spec 2.4.2, 2.4.3)."""

import torch
import torch.nn.functional as F
from torch import nn

from layers import Conv, GroupNorm
from unet import Unet

MIN_DEPTH_RATIO = 1e-3


def uniform_disparities(near, far, count):
    """Far to near."""
    step = torch.arange(count, dtype=torch.float64) / (count - 1)
    return 1 / far + step * (1 / near - 1 / far)


def plane_sweep(features, cameras, neighbours, stride, disparities, base=None):
    """Correlations `[views, candidates, h, w]` of features `[views, C, h, w]`.

    `disparities[v]` are the candidates of view v, the same everywhere or each `[h, w]`, added to `base[v]` (`[h, w]`)
    where given. No gradient flows through positions.
    """
    views, channels, height, width = features.shape
    y, x = torch.meshgrid(
        torch.arange(height, dtype=torch.float64), torch.arange(width, dtype=torch.float64), indexing="ij"
    )
    pixels = torch.stack([x, y, torch.ones_like(x)]).reshape(3, -1)
    volumes = []
    for r in range(views):
        disparity = disparities[r].detach().double().reshape(len(disparities[r]), -1)
        if base is not None:
            disparity = disparity + base[r].detach().double().reshape(1, -1)
        total = 0
        for o in neighbours[r]:
            rotation = cameras.rotation[o] @ cameras.rotation[r].T
            translation = cameras.translation[o] - rotation @ cameras.translation[r]
            k = cameras.matrix(o, stride)
            ray = k @ rotation @ torch.linalg.inv(cameras.matrix(r, stride)) @ pixels
            # The point at depth 1 / disparity, over that depth: [3, candidates, pixels].
            q = ray[:, None, :] + disparity * (k @ translation)[:, None, None]
            ahead = (q[2] > MIN_DEPTH_RATIO).reshape(-1, height, width)
            u, v = q[:2] / q[2].clamp(min=MIN_DEPTH_RATIO)
            grid = torch.stack([2 * u / (width - 1) - 1, 2 * v / (height - 1) - 1], dim=2)
            grid = grid.reshape(1, -1, width, 2).clamp(-1e4, 1e4).to(features.dtype)
            sampled = F.grid_sample(features[o : o + 1], grid, padding_mode="zeros", align_corners=True)
            sampled = sampled.reshape(channels, -1, height, width)
            product = (features[r][:, None] * sampled).sum(dim=0) / channels**0.5
            total = total + product * ahead
        volumes.append(total / len(neighbours[r]))
    return torch.stack(volumes)


class CoarseDepth(nn.Module):
    """Relative disparity and confidence, both `[views, 1, h, w]`."""

    def __init__(self, channels, config):
        super().__init__()
        candidates, width = config["num_candidates"], config["unet"]["channels"]
        self.enter, self.enter_norm = Conv(candidates + channels, width, 3), GroupNorm(width)
        self.unet = Unet(config["unet"])
        self.leave = Conv(width, candidates, 3)
        self.residual = Conv(candidates + channels, candidates, 1)
        self.head = nn.ModuleList([Conv(candidates, 2 * candidates, 3), Conv(2 * candidates, candidates, 3)])

    def forward(self, correlation, features, sources):
        x = torch.cat([correlation, features], dim=1)
        y = self.unet(F.gelu(self.enter_norm(self.enter(x))), sources)
        refined = self.leave(y) + self.residual(x)
        pdf = self.head[1](F.gelu(self.head[0](refined))).softmax(dim=1)
        position = torch.linspace(0, 1, pdf.shape[1], dtype=pdf.dtype).reshape(1, -1, 1, 1)
        return (pdf * position).sum(dim=1, keepdim=True), pdf.max(dim=1, keepdim=True).values
