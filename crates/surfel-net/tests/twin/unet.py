"""The U-Net of the cost volume and of the refinement (spec 2.6)."""

import torch
import torch.nn.functional as F
from torch import nn

from layers import Conv, GroupNorm

HEAD = 32


class ResidualBlock(nn.Module):
    def __init__(self, inputs, outputs):
        super().__init__()
        self.first, self.first_norm = Conv(inputs, outputs, 3), GroupNorm(outputs)
        self.second, self.second_norm = Conv(outputs, outputs, 3), GroupNorm(outputs)
        self.skip = Conv(inputs, outputs, 1) if inputs != outputs else None

    def forward(self, x):
        y = F.silu(self.first_norm(self.first(x)))
        y = F.silu(self.second_norm(self.second(y)))
        return (x if self.skip is None else self.skip(x)) + y


class ViewAttention(nn.Module):
    """Every pixel attends to all pixels of the views listed for its view."""

    def __init__(self, channels):
        super().__init__()
        self.project, self.merge = Conv(channels, 3 * channels, 1), Conv(channels, channels, 1)
        self.norm = GroupNorm(channels)
        self.heads = max(channels // HEAD, 1)

    def forward(self, x, sources):
        views, channels, height, width = x.shape
        dim = channels // self.heads
        # Per head: its queries, then its keys, then its values.
        parts = self.project(x).reshape(views, self.heads, 3, dim, height * width)
        query, key, value = parts[:, :, 0], parts[:, :, 1], parts[:, :, 2]
        outputs = []
        for view in range(views):
            k = torch.cat([key[s] for s in sources[view]], dim=2)
            v = torch.cat([value[s] for s in sources[view]], dim=2)
            weight = (query[view].transpose(1, 2) @ k / dim**0.5).softmax(dim=2)
            outputs.append((weight @ v.transpose(1, 2)).transpose(1, 2).reshape(channels, height, width))
        return x + self.norm(self.merge(torch.stack(outputs)))


class Step(nn.Module):
    def __init__(self, inputs, outputs, attends):
        super().__init__()
        self.block = ResidualBlock(inputs, outputs)
        self.attention = ViewAttention(outputs) if attends else None

    def forward(self, x, sources):
        x = self.block(x)
        return x if self.attention is None else self.attention(x, sources)


class Unet(nn.Module):
    """`[views, base, h, w]` to the same shape."""

    def __init__(self, config):
        super().__init__()
        base, attention_at = config["channels"], config["attention_at"]
        widths = [base * m for m in config["multipliers"]]
        self.enter = Conv(base, base, 3)
        self.down, self.shrink, self.up, self.grow = (nn.ModuleList() for _ in range(4))
        skips, channels = [base], base
        for level, width in enumerate(widths):
            self.down.append(Step(channels, width, 2**level in attention_at))
            channels = width
            skips.append(channels)
            if level + 1 < len(widths):
                self.shrink.append(Conv(channels, channels, 3, stride=2))
                skips.append(channels)
        self.middle = nn.ModuleList(ResidualBlock(channels, channels) for _ in range(2))
        for level, width in reversed(list(enumerate(widths))):
            for _ in range(2):
                self.up.append(Step(channels + skips.pop(), width, 2**level in attention_at))
                channels = width
            if level > 0:
                self.grow.append(Conv(channels, channels, 3))
        self.leave, self.leave_norm = Conv(channels, base, 3), GroupNorm(base)

    def forward(self, x, sources):
        x = self.enter(x)
        skips = [x]
        for level, step in enumerate(self.down):
            x = step(x, sources)
            skips.append(x)
            if level < len(self.shrink):
                x = self.shrink[level](x)
                skips.append(x)
        for block in self.middle:
            x = block(x)
        for i, step in enumerate(self.up):
            x = step(torch.cat([x, skips.pop()], dim=1), sources)
            if i % 2 == 1 and i // 2 < len(self.grow):
                x = self.grow[i // 2](F.interpolate(x, scale_factor=2, mode="nearest"))
        return F.silu(self.leave_norm(self.leave(x)))
