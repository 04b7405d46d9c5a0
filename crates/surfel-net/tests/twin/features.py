"""Image features: the residual CNN of the paper (spec 2.2), and the pyramid over the pretrained trunk."""

import torch
import torch.nn.functional as F
from torch import nn

from layers import Conv, instance_norm, upsample

MEAN = torch.tensor([0.485, 0.456, 0.406], dtype=torch.float64).reshape(1, 3, 1, 1)
STD = torch.tensor([0.229, 0.224, 0.225], dtype=torch.float64).reshape(1, 3, 1, 1)


def imagenet_normalised(images):
    return (images - MEAN.to(images.dtype)) / STD.to(images.dtype)


class ResidualBlock(nn.Module):
    def __init__(self, inputs, outputs, stride):
        super().__init__()
        self.first = Conv(inputs, outputs, 3, stride, bias=False)
        self.second = Conv(outputs, outputs, 3, bias=False)
        self.skip = Conv(inputs, outputs, 1, stride) if stride != 1 or inputs != outputs else None

    def forward(self, x):
        y = F.relu(instance_norm(self.first(x)))
        y = F.relu(instance_norm(self.second(y)))
        skip = x if self.skip is None else instance_norm(self.skip(x))
        return F.relu(skip + y)


class Cnn(nn.Module):
    """`[views, 3, height, width]` in [0, 1] to `[views, channels, height / 4, width / 4]`."""

    def __init__(self, widths, channels):
        super().__init__()
        stem, middle = widths
        self.stem = Conv(3, stem, 7, 2, bias=False)
        steps = [(stem, stem, 1), (stem, stem, 1), (stem, middle, 2), (middle, middle, 1)]
        steps += [(middle, channels, 1), (channels, channels, 1)]
        self.blocks = nn.ModuleList(ResidualBlock(*step) for step in steps)
        self.project = Conv(channels, channels, 1)

    def forward(self, images):
        x = F.relu(instance_norm(self.stem(imagenet_normalised(images))))
        for block in self.blocks:
            x = block(x)
        return self.project(x)


class Pyramid(nn.Module):
    """Merges the trunk's maps at strides 4, 8 and 16 (24, 40 and 112 channels) into one at stride 4.

    After the trunk's image has been moved by three pixels, pixel i of stride s stands over input pixel
    `s i + s - 4`, that is `s / 4 - 1` pixels of stride 4 late.
    """

    def __init__(self, channels, trunk_channels=(24, 40, 112)):
        super().__init__()
        self.laterals = nn.ModuleList(Conv(c, channels, 1) for c in trunk_channels)
        self.merge = Conv(channels, channels, 3)

    def forward(self, maps):
        merged = sum(
            upsample(lateral(x), factor, before=factor - 1)
            for lateral, x, factor in zip(self.laterals, maps, (1, 2, 4))
        )
        return self.merge(F.gelu(merged))
