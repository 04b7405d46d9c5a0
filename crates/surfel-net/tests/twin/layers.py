"""Layers all twins share, with the parameter names and shapes of the Rust modules (`src/layers.rs`).

Linear weights are `[inputs, outputs]`, normalisations have `gamma` and `beta`: burn's names and layout, so that
one list of names fits both sides.
"""

import torch
import torch.nn.functional as F
from torch import nn


def empty(*shape):
    return nn.Parameter(torch.zeros(*shape))


class Conv(nn.Module):
    """Convolution that keeps the size at stride 1."""

    def __init__(self, inputs, outputs, kernel, stride=1, bias=True):
        super().__init__()
        self.weight = empty(outputs, inputs, kernel, kernel)
        self.bias = empty(outputs) if bias else None
        self.stride, self.padding = stride, kernel // 2

    def forward(self, x):
        return F.conv2d(x, self.weight, self.bias, self.stride, self.padding)


class Linear(nn.Module):
    def __init__(self, inputs, outputs, bias=True):
        super().__init__()
        self.weight = empty(inputs, outputs)
        self.bias = empty(outputs) if bias else None

    def forward(self, x):
        return F.linear(x, self.weight.t(), self.bias)


class LayerNorm(nn.Module):
    def __init__(self, channels, eps=1e-5):
        super().__init__()
        self.gamma, self.beta, self.eps = empty(channels), empty(channels), eps

    def forward(self, x):
        return F.layer_norm(x, self.gamma.shape, self.gamma, self.beta, self.eps)


class GroupNorm(nn.Module):
    """The wished number of groups, or 4 where the channels do not divide (spec 2.6)."""

    def __init__(self, channels, groups=8):
        super().__init__()
        self.gamma, self.beta = empty(channels), empty(channels)
        self.groups = groups if channels % groups == 0 else 4

    def forward(self, x):
        return F.group_norm(x, self.groups, self.gamma, self.beta, 1e-5)


def instance_norm(x):
    return F.instance_norm(x, eps=1e-5)


def upsample(x, factor, before=0):
    """Bilinear, so that coarse pixel i stands over fine pixel `factor i + before`; the border is repeated.

    The spec's `align_corners` would stretch a map of n pixels over `factor n`; the project keeps positions instead.
    """
    if factor == 1:
        return x
    for dim in (2, 3):
        n = x.shape[dim]
        position = ((torch.arange(factor * n, dtype=torch.float64) - before) / factor).clamp(0, n - 1)
        low = position.floor().long()
        high = (low + 1).clamp(max=n - 1)
        shape = [1, 1, 1, 1]
        shape[dim] = -1
        share = (position - low).to(x.dtype).reshape(shape)
        x = x.index_select(dim, low) * (1 - share) + x.index_select(dim, high) * share
    return x


def space_to_depth(x, factor):
    """Each block of pixels becomes the channels of one pixel; row by row inside the block."""
    return F.pixel_unshuffle(x, factor)


def depth_to_space(x, factor):
    return F.pixel_shuffle(x, factor)
