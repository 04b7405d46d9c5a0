"""Coarse depth to full resolution, and the feature each surfel is decoded from (spec 2.4.4 to 2.4.6)."""

import torch
import torch.nn.functional as F
from torch import nn

from layers import Conv, GroupNorm, depth_to_space, space_to_depth, upsample
from matching import plane_sweep
from unet import Unet


class Refinement(nn.Module):
    def __init__(self, config):
        super().__init__()
        refinement = config["refinement"]
        self.stride = refinement["stride"]
        self.sweep = refinement.get("sweep")
        self.coarse_steps = config["cost_volume"]["num_candidates"] - 1
        upsampled, width = refinement["upsampled_channels"], refinement["unet"]["channels"]
        image = 3 * self.stride**2
        self.upsampler = Conv(2 * config["backbone"]["channels"], upsampled, 3)
        self.project = Conv(upsampled, width, 3)
        num_fine = 0
        self.matcher = None
        if self.sweep is not None:
            num_fine = self.sweep["num_candidates"]
            self.matcher = Conv(upsampled + image, self.sweep["channels"], 3)
        self.enter, self.enter_norm = Conv(image + width + 2 + num_fine, width, 3), GroupNorm(width, 4)
        self.unet = Unet(refinement["unet"])
        self.to_disparity = nn.ModuleList([Conv(width, 2 * width, 3), Conv(2 * width, 2 * self.stride**2, 3)])

    def forward(self, images, matching, context, coarse, confidence, cameras, ranges, neighbours, sources):
        """Relative disparity, density and features, all at full resolution."""
        factor = 4 // self.stride
        upsampled = self.upsampler(torch.cat([matching, context], dim=1))
        upsampled = F.gelu(upsample(upsampled, factor))
        pixels = space_to_depth(images, self.stride)
        at_stride = upsample(coarse, factor)
        inputs = [pixels, self.project(upsampled), at_stride, upsample(confidence, factor)]
        if self.matcher is not None:
            features = self.matcher(torch.cat([upsampled, pixels], dim=1))
            inputs.append(self.fine_correlation(features, at_stride, cameras, ranges, neighbours))
        x = F.gelu(self.enter_norm(self.enter(torch.cat(inputs, dim=1))))
        refined = self.unet(x, sources)
        output = self.to_disparity[1](F.gelu(self.to_disparity[0](refined)))
        output = depth_to_space(output, self.stride)
        disparity = (upsample(coarse, 4) + output[:, :1]).clamp(0, 1)
        features = [upsample(refined, self.stride), images, upsample(upsampled, self.stride)]
        return disparity, output[:, 1:].sigmoid(), torch.cat(features, dim=1)

    def fine_correlation(self, features, coarse, cameras, ranges, neighbours):
        """Candidates around the coarse disparity, each `step` candidates of the coarse sweep apart."""
        half = self.sweep["num_candidates"] // 2
        offset = torch.arange(-half, half + 1, dtype=torch.float64) * self.sweep["step"] / self.coarse_steps
        spans = [1 / near - 1 / far for near, far in ranges]
        base = [coarse[v, 0] * spans[v] + 1 / far for v, (_, far) in enumerate(ranges)]
        return plane_sweep(features, cameras, neighbours, self.stride, [offset * span for span in spans], base)
