"""Attention of each pixel along its epipolar lines, with every sample gathered by `grid_sample`."""

import math

import torch
import torch.nn.functional as F
from torch import nn

from layers import LayerNorm, Linear
from matching import MIN_DEPTH_RATIO, uniform_disparities

OCTAVES = 6


class Lines:
    """Where the pixels of each view land in each of its neighbours, for maps of stride 4.

    `positions[view][slot]` is `[2, candidates, h, w]` in index coordinates of the neighbour, `inside` tells which of
    them count, and `margin` is how far the closest call is from turning.
    """

    def __init__(self, cameras, neighbours, ranges, num_samples, height, width):
        self.neighbours, self.num_samples = neighbours, num_samples
        self.positions, self.inside, self.margin = [], [], math.inf
        for view, others in enumerate(neighbours):
            disparity = uniform_disparities(*ranges[view], num_samples)
            found = [self.landings(cameras, view, other, disparity, height, width) for other in others]
            self.positions.append([position for position, _ in found])
            self.inside.append([inside for _, inside in found])

    def landings(self, cameras, view, other, disparity, height, width):
        y, x = torch.meshgrid(
            torch.arange(height, dtype=torch.float64), torch.arange(width, dtype=torch.float64), indexing="ij"
        )
        # In continuous pixels of the photograph, whose index pixel 4 i the map's pixel i stands over.
        fx, fy, cx, cy = cameras.intrinsics[view]
        ray = torch.stack([(4 * x + 0.5 - cx) / fx, (4 * y + 0.5 - cy) / fy, torch.ones_like(x)])
        points = ray[:, None] / disparity[:, None, None]
        world = cameras.rotation[view].T @ (points.reshape(3, -1) - cameras.translation[view][:, None])
        seen = cameras.rotation[other] @ world + cameras.translation[other][:, None]
        fx, fy, cx, cy = cameras.intrinsics[other]
        ratio = seen[2].reshape(-1, height, width) * disparity[:, None, None]
        u = ((fx * seen[0] / seen[2] + cx - 0.5) / 4).reshape(ratio.shape)
        v = ((fy * seen[1] / seen[2] + cy - 0.5) / 4).reshape(ratio.shape)
        inside = ratio > MIN_DEPTH_RATIO
        for position, last in ((u, width - 1), (v, height - 1)):
            inside = inside & (position >= 0) & (position <= last)
            closest = torch.minimum(position.abs(), (position - last).abs()).min()
            self.margin = min(self.margin, float(closest), float((ratio - MIN_DEPTH_RATIO).abs().min()))
        return torch.stack([u, v]), inside


def epipolar_attention(query, key, value, depth_key, depth_value, num_heads, lines):
    """Maps `[views, h, w, C]`, tables of depth `[candidates, C]`; a pixel without samples gets zero."""
    views, height, width, channels = query.shape
    dim = channels // num_heads
    outputs = []
    for view in range(views):
        keys, values = [], []
        for slot, other in enumerate(lines.neighbours[view]):
            u, v = lines.positions[view][slot]
            grid = torch.stack([2 * u / (width - 1) - 1, 2 * v / (height - 1) - 1], dim=3)
            grid = grid.reshape(1, -1, width, 2).clamp(-1e4, 1e4).to(query.dtype)
            for source, table, into in ((key, depth_key, keys), (value, depth_value, values)):
                sampled = F.grid_sample(source[other].permute(2, 0, 1)[None], grid, align_corners=True)
                sampled = sampled.reshape(channels, -1, height, width).permute(2, 3, 1, 0)
                into.append(sampled + table)
        counts = torch.cat(lines.inside[view]).permute(1, 2, 0)[:, :, None, :]
        heads = lambda x: torch.cat(x, dim=2).reshape(height, width, -1, num_heads, dim).transpose(2, 3)
        score = (heads(keys) @ query[view].reshape(height, width, num_heads, dim, 1))[..., 0] / math.sqrt(dim)
        weight = torch.where(counts, score, -1e30).softmax(dim=3) * counts
        outputs.append((weight[..., None] * heads(values)).sum(dim=3).reshape(height, width, channels))
    return torch.stack(outputs)


def depth_code(num_samples):
    """`[samples, 2 OCTAVES]`: sine and cosine of every octave of relative disparity, far to near."""
    angle = math.pi * torch.linspace(0, 1, num_samples, dtype=torch.float64)[:, None] * 2.0 ** torch.arange(OCTAVES)
    return torch.stack([angle.sin(), angle.cos()], dim=2).reshape(num_samples, -1)


class LineAttention(nn.Module):
    def __init__(self, channels, num_heads):
        super().__init__()
        self.query, self.key, self.value = (Linear(channels, channels, bias=False) for _ in range(3))
        self.depth_key, self.depth_value = (Linear(2 * OCTAVES, channels, bias=False) for _ in range(2))
        self.merge = Linear(channels, channels, bias=False)
        self.norm, self.num_heads = LayerNorm(channels), num_heads

    def forward(self, x, memory, lines):
        code = depth_code(lines.num_samples).to(x.dtype)
        maps = self.query(x), self.key(memory), self.value(memory)
        y = epipolar_attention(*maps, self.depth_key(code), self.depth_value(code), self.num_heads, lines)
        return self.norm(self.merge(y))
