"""The whole graph of a configuration (spec 2; paper: algorithm 1)."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import nn

from aggregate import Aggregation
from features import Cnn, Pyramid
from head import AttributeHead, Surfels, surfels_of
from matching import CoarseDepth, plane_sweep, uniform_disparities
from nyquist import Regions, adapted_scales, regions
from refine import Refinement
from transformer import Transformer

NEAR_CLIP = 1e-3


@dataclass
class Prediction:
    depth: torch.Tensor  # [views, h, w]
    confidence: torch.Tensor  # [views, ceil(h / 4), ceil(w / 4)]
    initial: Surfels
    surfels: Surfels
    regions: Regions


class Network(nn.Module):
    """`trunk` gives the maps of moved images at strides 4, 8 and 16 where the backbone is a pretrained one."""

    def __init__(self, config, trunk=None):
        super().__init__()
        self.config = config
        channels = config["backbone"]["channels"]
        refinement = config["refinement"]
        features = refinement["unet"]["channels"] + 3 + refinement["upsampled_channels"]
        if trunk is None:
            self.cnn = Cnn(config["backbone"]["widths"], channels)
        else:
            self.trunk, self.pyramid = trunk, Pyramid(channels)
        self.transformer = Transformer(channels, config["transformer"])
        self.coarse = CoarseDepth(channels, config["cost_volume"])
        self.refinement = Refinement(config)
        self.head = AttributeHead(features, config["head"]["sh_degree"])
        self.aggregation = Aggregation(features, config["aggregation"])

    def forward(self, images, cameras, ranges, multiple):
        """`images` `[views, 3, h, w]` in [0, 1]; padded to `multiple` by repeating the border. Every view looks at
        all others, as it does where there are no more than `num_neighbours`."""
        views, _, height, width = images.shape
        neighbours = [[o for o in range(views) if o != v] for v in range(views)]
        sources = [[v] + others for v, others in enumerate(neighbours)]
        padded = F.pad(images, (0, -width % multiple, 0, -height % multiple), mode="replicate")

        context = self.cnn(padded) if hasattr(self, "cnn") else self.pyramid(self.trunk(padded))
        matching = self.transformer(context, neighbours)
        candidates = self.config["cost_volume"]["num_candidates"]
        disparities = [uniform_disparities(near, far, candidates) for near, far in ranges]
        correlation = plane_sweep(matching, cameras, neighbours, 4, disparities)
        coarse, confidence = self.coarse(correlation, matching, sources)
        disparity, density, features = self.refinement(
            padded, matching, context, coarse, confidence, cameras, ranges, neighbours, sources
        )
        disparity, density, features = (x[:, :, :height, :width] for x in (disparity, density, features))
        depth = torch.stack(
            [1 / (1 / far + disparity[v] * (1 / near - 1 / far)) for v, (near, far) in enumerate(ranges)]
        )

        head = self.config["head"]
        initial = surfels_of(self.head(features), depth, density, cameras, head)
        found = self.regions(initial, cameras, ranges, sources)
        refined = self.aggregation(features, found.pixels, found.valid)
        surfels = surfels_of(self.head(refined), depth, density, cameras, head)
        confidence = confidence[:, 0, : -(-height // 4), : -(-width // 4)]
        return Prediction(depth[:, 0], confidence, initial, surfels, found)

    def regions(self, initial, cameras, ranges, targets):
        nyquist = self.config["nyquist"]
        near_clips = [NEAR_CLIP * near for near, _ in ranges]
        # Through f32, in which the network holds its surfels.
        centres, scales, rotations = (
            x.detach().float().double() for x in (initial.centres, initial.scales, initial.rotations)
        )
        _, adapted = adapted_scales(centres, scales, cameras, targets, near_clips, nyquist)
        scales = adapted if nyquist["adaptation"] else scales
        return regions(centres, scales, rotations, cameras, targets, near_clips, nyquist)
