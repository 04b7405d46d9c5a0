"""The multi-view transformer with shifted windows (spec 2.3), or with attention along epipolar lines across views."""

import math

import torch
import torch.nn.functional as F
from torch import nn

from epipolar import LineAttention
from layers import LayerNorm, Linear


def position_encoding(height, width, channels, dtype):
    """`[height, width, channels]`: the first half of the channels tells the row, the second the column."""
    half = channels // 2
    k = torch.arange(half, dtype=torch.float64)
    frequency = 10000.0 ** (-2 * torch.floor(k / 2) / half)

    def along(length):
        angle = (torch.arange(length, dtype=torch.float64) + 1) / (length + 1e-6) * 2 * math.pi
        angle = angle[:, None] * frequency
        return torch.where(k % 2 == 0, angle.sin(), angle.cos())

    rows = along(height)[:, None, :].expand(height, width, half)
    columns = along(width)[None, :, :].expand(height, width, half)
    return torch.cat([rows, columns], dim=2).to(dtype)


def windows_of(x, splits, shifted):
    """`[views, h, w, C]` to `[views, windows, tokens, C]`."""
    views, height, width, channels = x.shape
    hw, ww = height // splits, width // splits
    if shifted:
        x = torch.roll(x, (-(hw // 2), -(ww // 2)), dims=(1, 2))
    parts = [
        x[:, r * hw : (r + 1) * hw, c * ww : (c + 1) * ww].reshape(views, hw * ww, channels)
        for r in range(splits)
        for c in range(splits)
    ]
    return torch.stack(parts, dim=1)


def map_of(tokens, height, width, splits, shifted):
    """The inverse of `windows_of`."""
    views, _, _, channels = tokens.shape
    hw, ww = height // splits, width // splits
    rows = []
    for r in range(splits):
        row = [tokens[:, r * splits + c].reshape(views, hw, ww, channels) for c in range(splits)]
        rows.append(torch.cat(row, dim=2))
    x = torch.cat(rows, dim=1)
    return torch.roll(x, (hw // 2, ww // 2), dims=(1, 2)) if shifted else x


def shift_mask(height, width, splits, dtype):
    """`[windows, tokens, tokens]`: -100 between tokens that only rolling has made neighbours."""
    hw, ww = height // splits, width // splits
    slices = [[slice(0, n - w), slice(n - w, n - w // 2), slice(n - w // 2, n)] for n, w in ((height, hw), (width, ww))]
    region = torch.zeros(1, height, width, 1)
    for i, rows in enumerate(slices[0]):
        for j, columns in enumerate(slices[1]):
            region[:, rows, columns] = 3 * i + j
    # The map is rolled already: the regions are those of the rolled map.
    ids = windows_of(region, splits, shifted=False)[0, :, :, 0]
    return torch.where(ids[:, :, None] == ids[:, None, :], 0.0, -100.0).to(dtype)


class Attention(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.query, self.key, self.value, self.merge = (Linear(channels, channels, bias=False) for _ in range(4))
        self.norm = LayerNorm(channels)

    def forward(self, x, memory, sources, splits, shifted):
        """`sources[v]` lists the views whose tokens view v attends to."""
        views, height, width, channels = x.shape
        shifted = shifted and splits > 1
        query = windows_of(self.query(x), splits, shifted)
        key = windows_of(self.key(memory), splits, shifted)
        value = windows_of(self.value(memory), splits, shifted)
        outputs = []
        for view in range(views):
            k = torch.cat([key[s] for s in sources[view]], dim=1)
            v = torch.cat([value[s] for s in sources[view]], dim=1)
            score = query[view] @ k.transpose(1, 2) / math.sqrt(channels)
            if shifted:
                score = score + shift_mask(height, width, splits, x.dtype).repeat(1, 1, len(sources[view]))
            outputs.append(score.softmax(dim=2) @ v)
        y = map_of(torch.stack(outputs), height, width, splits, shifted)
        return self.norm(self.merge(y))


class Layer(nn.Module):
    def __init__(self, channels, config):
        super().__init__()
        expansion, epipolar = config["expansion"], config.get("epipolar")
        self.within = Attention(channels)
        if epipolar is None:
            self.across = Attention(channels)
        else:
            self.along = LineAttention(channels, epipolar["num_heads"])
        self.widen = Linear(2 * channels, 2 * channels * expansion, bias=False)
        self.narrow = Linear(2 * channels * expansion, channels, bias=False)
        self.norm = LayerNorm(channels)

    def forward(self, x, neighbours, splits, shifted, lines):
        before = x
        itself = [[view] for view in range(x.shape[0])]
        x = x + self.within(x, x, itself, splits, shifted)
        if lines is None:
            message = self.across(x, before, neighbours, splits, shifted)
        else:
            message = self.along(x, before, lines)
        message = self.narrow(F.gelu(self.widen(torch.cat([x, message], dim=3))))
        return x + self.norm(message)


class Transformer(nn.Module):
    """`[views, channels, h, w]` to the same shape; `lines` where the configuration asks for them."""

    def __init__(self, channels, config):
        super().__init__()
        self.layers = nn.ModuleList(Layer(channels, config) for _ in range(config["num_layers"]))
        self.splits = config["num_splits"]

    def forward(self, features, neighbours, lines=None):
        x = features.permute(0, 2, 3, 1)
        _, height, width, channels = x.shape
        encoding = position_encoding(height // self.splits, width // self.splits, channels, x.dtype)
        x = x + encoding.repeat(self.splits, self.splits, 1)
        for i, layer in enumerate(self.layers):
            x = layer(x, neighbours, self.splits, shifted=i % 2 == 1, lines=lines)
        return x.permute(0, 3, 1, 2)
