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
from seeded import SeededRefinement, frames_of, normals_away
from transformer import Transformer

NEAR_CLIP = 1e-3


@dataclass
class Prediction:
    depth: torch.Tensor  # [views, h, w]
    confidence: torch.Tensor  # [views, h, w]
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
        if "seeded" in config:
            features += 4
            self.seeded = SeededRefinement(config)
        else:
            self.transformer = Transformer(channels, config["transformer"])
            self.coarse = CoarseDepth(channels, config["cost_volume"])
            self.refinement = Refinement(config)
        self.head = AttributeHead(features, config["head"], neutral="seeded" in config)
        self.aggregation = Aggregation(features, config["aggregation"])

    def forward(self, images, cameras, ranges, multiple, seeds=None):
        """`images` `[views, 3, h, w]` in [0, 1]; padded to `multiple` by repeating the border. Every view looks at
        all others, as it does where there are no more than `num_neighbours`."""
        views, _, height, width = images.shape
        neighbours = [[o for o in range(views) if o != v] for v in range(views)]
        sources = [[v] + others for v, others in enumerate(neighbours)]
        right, down = -width % multiple, -height % multiple
        padded = F.pad(images, (0, right, 0, down), mode="replicate")
        crop = lambda x: x[:, :, :height, :width]

        context = self.cnn(padded) if hasattr(self, "cnn") else self.pyramid(self.trunk(padded))
        scene = (cameras, ranges, neighbours, sources)
        if seeds is None:
            disparity, density, features, confidence = (crop(x) for x in self.swept(padded, context, *scene))
        else:
            found = self.seeded(padded, context, seeds.padded(right, down), *scene)
            disparity, density, features, slopes = (crop(x) for x in found)
            confidence = density
        inverse = [1 / far + disparity[v] * (1 / near - 1 / far) for v, (near, far) in enumerate(ranges)]
        depth = 1 / torch.stack(inverse)
        base = None
        if seeds is not None:
            normals = normals_away(cameras, 1 / depth, slopes)
            features = torch.cat([features, normals, density], dim=1)
            base = (frames_of(normals), images)

        head = self.config["head"]
        initial = surfels_of(self.head(features), depth, density, cameras, head, base)
        found = self.regions(initial, cameras, ranges, sources)
        refined = self.aggregation(features, found.pixels, found.valid)
        surfels = surfels_of(self.head(refined), depth, density, cameras, head, base)
        return Prediction(depth[:, 0], confidence[:, 0], initial, surfels, found)

    def swept(self, images, context, cameras, ranges, neighbours, sources):
        """Relative disparity, density, features and confidence by a cost volume."""
        matching = self.transformer(context, neighbours)
        candidates = self.config["cost_volume"]["num_candidates"]
        disparities = [uniform_disparities(near, far, candidates) for near, far in ranges]
        correlation = plane_sweep(matching, cameras, neighbours, 4, disparities)
        coarse, confidence = self.coarse(correlation, matching, sources)
        refined = self.refinement(images, matching, context, coarse, confidence, cameras, ranges, neighbours, sources)
        return *refined, F.interpolate(confidence, scale_factor=4, mode="nearest")

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
