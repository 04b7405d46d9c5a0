"""The refinement of a network whose coarse depth comes from matching: plane propagation, and sweeps over its tries.

Inside, inverse depth is counted in steps: a step moves a neighbour's pixel by about one.
"""

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from torch import nn

from layers import Conv, GroupNorm, depth_to_space, space_to_depth, upsample
from matching import plane_sweep
from unet import Unet

OWN_LEAD = 7.0
# Lean to nearer planes of an output of one.
LEAN = 10.0
# Score of an output of one of the judge, and the judge's width.
SCORE_GAIN = 10.0
JUDGE_WIDTH = 32
# Offset, in steps, up to which what a pass starts from knows better where it is sure; and matching, of all passes.
FINE_STEPS = 1.5
FINEST_STEPS = 0.5
# Steps, and tangents of tilt, that an output of one corrects.
CORRECTION = 0.1
FARTHEST = 64.0
# Proposals this far from the one in their middle are of its surface, steps.
REACH = 4.0
AROUND = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)]


@dataclass
class Seeds:
    """Matching's answer."""

    planes: torch.Tensor  # [views, 3, h, w]: inverse depth and its change per pixel to the right and down
    evidence: torch.Tensor  # [views, 2, h, w]: inverse depth of best agreement, and the weight of that finding
    correlation: torch.Tensor  # [views, 1, h, w]
    confidence: torch.Tensor  # [views, 1, h, w]
    step: torch.Tensor  # [views]

    def padded(self, right, down):
        grow = lambda x: F.pad(x, (0, right, 0, down), mode="replicate")
        maps = (self.planes, self.evidence, self.correlation, self.confidence)
        return Seeds(*(grow(x) for x in maps), self.step)


def offsets_of(distances):
    return [(0, 0)] + [(x * d, y * d) for d in distances for x, y in AROUND]


def looked_up(x, dx, dy):
    """`x` `[..., h, w]` at the pixel `(dx, dy)` away, or at the border; and the way back to the pixel asked."""
    height, width = x.shape[-2:]
    rows, columns = torch.arange(height), torch.arange(width)
    there_rows, there_columns = (rows + dy).clamp(0, height - 1), (columns + dx).clamp(0, width - 1)
    back = (columns - there_columns).expand(height, width), (rows - there_rows)[:, None].expand(height, width)
    return x[..., there_rows[:, None], there_columns[None, :]], back


def proposals_of(planes, offsets):
    """`[views, proposals, 3, h, w]`: the plane of each proposing pixel, continued to this one and relative to it."""
    proposals = []
    for dx, dy in offsets:
        there, (back_x, back_y) = looked_up(planes, dx, dy)
        w = there[:, 0] + there[:, 1] * back_x + there[:, 2] * back_y - planes[:, 0]
        proposals.append(torch.stack([w.clamp(-FARTHEST, FARTHEST), there[:, 1], there[:, 2]], dim=1))
    return torch.stack(proposals, dim=1)


def propagated(scores, leans, proposals, stride):
    """Weighted means `[views, 3, h, w]` of the proposals within `REACH` of the one that most weight is within reach
    of; `scores` `[views, proposals, h / stride, w / stride]`, `leans` to the nearer `[views, 1, h, w]`."""
    depths = proposals[:, :, 0]
    scores = F.interpolate(scores, scale_factor=stride, mode="nearest")
    weights = (scores + leans * soft(depths)).softmax(dim=1)
    near = ((depths[:, None] - depths[:, :, None]).abs() <= REACH).to(weights.dtype)
    masses = (near * weights[:, None]).sum(dim=2)
    middle = masses.argmax(dim=1, keepdim=True)
    chosen = weights * near.gather(1, middle[:, :, None].expand(-1, -1, *near.shape[2:]))[:, 0]
    shares = chosen / chosen.sum(dim=1, keepdim=True)
    return (shares[:, :, None] * proposals).sum(dim=1)


def soft(steps):
    return steps / (2 + steps.abs())


def said_of(seeds, inverse_depth, cameras, neighbours):
    """What the neighbours' surfaces say of points `[views, h, w]` (1 / scene unit): how surely the best of them
    confirms one, and how surely on average it is in front of or behind them, `[views, 3, h, w]`."""
    height, width = inverse_depth.shape[1:]
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    index = torch.stack([x, y, torch.ones_like(x)]).to(inverse_depth.dtype)
    all_said = []
    for view, others in enumerate(neighbours):
        said = []
        for other in others:
            turn = cameras.rotation[other] @ cameras.rotation[view].T
            shift = cameras.translation[other] - turn @ cameras.translation[view]
            turn = (cameras.matrix(other) @ turn @ cameras.matrix(view).inverse()).to(index.dtype)
            shift = (cameras.matrix(other) @ shift).to(index.dtype)
            u, v, z = torch.einsum("ij,jhw->ihw", turn, index) + shift[:, None, None] * inverse_depth[view]
            u, v = u / z, v / z
            column, row = u.round(), v.round()
            seen = (z > 0) & (column >= 0) & (row >= 0) & (column < width) & (row < height)
            at = (row.clamp(0, height - 1).long(), column.clamp(0, width - 1).long())
            own, own_x, own_y = seeds.planes[other][:, at[0], at[1]]
            steps = (inverse_depth[view] / z - own - own_x * (u - column) - own_y * (v - row)) / seeds.step[other]
            sure = torch.where(seen, seeds.confidence[other, 0][at], torch.zeros_like(steps))
            steps = torch.where(seen, steps, torch.zeros_like(steps))
            said.append(torch.stack([sure / (1 + steps**2), sure * soft(steps).relu(), sure * soft(-steps).relu()]))
        said = torch.stack(said)
        all_said.append(torch.cat([said[:, :1].amax(dim=0), said[:, 1:].mean(dim=0)]))
    return torch.stack(all_said)


def seed_inputs(seeds, proposals, offsets, stride, cameras, neighbours):
    """What the U-Net sees of the seeds."""
    step = seeds.step.reshape(-1, 1, 1, 1)
    offset = soft((seeds.evidence[:, :1] - seeds.planes[:, :1]) / step)
    weight = seeds.evidence[:, 1:].clamp(min=0).log1p()
    said = said_of(seeds, seeds.planes[:, 0], cameras, neighbours)
    per_pixel = torch.cat([offset, weight, seeds.correlation, seeds.confidence, said], dim=1)
    slopes = soft(4 * seeds.planes[:, 1:] / step)
    differences = soft(proposals[:, 1:, 0])
    confidences = torch.cat([looked_up(seeds.confidence, dx, dy)[0] for dx, dy in offsets[1:]], dim=1)
    per_block = F.avg_pool2d(torch.cat([slopes, differences, confidences], dim=1), stride)
    return torch.cat([space_to_depth(per_pixel, stride), per_block], dim=1)


def likeness_of(images, offsets):
    """How far, softly, the colour at each proposer is from the pixel's, and the largest step of colour on the way,
    `[views, proposals, 2, h, w]`."""
    means = F.avg_pool2d(F.pad(images, (0, 1, 0, 1), mode="replicate"), 2, stride=1)
    maps = []
    for dx, dy in offsets:
        count = max(abs(dx), abs(dy))
        way = [looked_up(means, dx * i // count, dy * i // count)[0] for i in range(1, count + 1)]
        steps = [(a - b).norm(dim=1) for a, b in zip([means, *way], way)]
        nothing = torch.zeros_like(means[:, 0])
        ends = [(way[-1] - means).norm(dim=1), torch.stack(steps).amax(dim=0)] if way else [nothing, nothing]
        maps.append(torch.stack(ends, dim=1))
    distances = torch.stack(maps, dim=1)
    return distances / (0.1 + distances)


def known_of(images, seeds, proposals, offsets, stride, cameras, neighbours):
    """What is known of each proposal at the pixel a block stands over, `[views, proposals, 10, h / stride, w / stride]`:
    difference to the pixel's own plane, its size, the proposer's confidence, support by all, whether it is the
    pixel's own, what the neighbours say of it, and how alike pixel and proposer look."""
    difference = proposals[:, :, 0]
    confidence = torch.cat([looked_up(seeds.confidence, dx, dy)[0] for dx, dy in offsets], dim=1)
    apart = difference[:, :, None] - difference[:, None, :]
    support = (confidence[:, None, :] / (1 + apart.square())).mean(dim=2)
    own = torch.zeros_like(difference)
    own[:, 0] = 1
    known = torch.stack([soft(difference), soft(difference).abs(), confidence, support, own], dim=2)
    inverse_depths = seeds.planes[:, :1] + difference * seeds.step.reshape(-1, 1, 1, 1)
    said = [said_of(seeds, one, cameras, neighbours) for one in inverse_depths.unbind(1)]
    known = torch.cat([known, torch.stack(said, dim=1), likeness_of(images, offsets)], dim=2)
    return known[..., ::stride, ::stride]


def tries_of(seeds, proposals, sweep, stride):
    """Inverse depths `[views, tries, h / stride, w / stride]` at the pixel a block stands over: the block's own plane
    moved by a few steps, then the planes proposed to it."""
    half, step = sweep["num_candidates"] // 2, seeds.step.reshape(-1, 1, 1, 1)
    moves = torch.arange(-half, half + 1, dtype=seeds.step.dtype).reshape(1, -1, 1, 1) * sweep["step"]
    own = seeds.planes[:, :1] / step
    tries = step * (own + torch.cat([moves.expand(len(own), -1, *own.shape[2:]), proposals[:, 1:, 0]], dim=1))
    return tries[:, :, ::stride, ::stride]


def patches_of(images, stride):
    """5 x 5 windows of luma about every `stride`th pixel, without their brightness and contrast, `[views, 25, h, w]`;
    the product of two, over the root of their length, is their correlation."""
    luma = (images * torch.tensor([0.299, 0.587, 0.114], dtype=images.dtype).reshape(1, 3, 1, 1)).sum(1, keepdim=True)
    windows = F.unfold(F.pad(luma, (2, 2, 2, 2), mode="replicate"), 5, stride=stride)
    windows = windows - windows.mean(dim=1, keepdim=True)
    energy = windows.square().sum(dim=1, keepdim=True)
    windows = 25**0.25 * windows / (energy + 25 * 4e-5).sqrt()
    return windows.reshape(len(images), 25, images.shape[2] // stride, images.shape[3] // stride)


def held(offset, fine, sureness):
    """Small offsets, in steps, drawn back where what they start from is sure."""
    return offset * (1 - sureness * (-(offset / fine).square()).exp())


class Scorer(nn.Module):
    """One judge of all proposals: a two-layer perceptron of what is known of one and of the pixel's context."""

    def __init__(self, known, context):
        super().__init__()
        self.proposal, self.context = Conv(known, JUDGE_WIDTH, 1), Conv(context, JUDGE_WIDTH, 1)
        self.score = Conv(JUDGE_WIDTH, 1, 1)

    def forward(self, known, context):
        """Scores `[views, proposals, h, w]`, proposal by proposal."""
        context = self.context(context)
        scores = [self.score(F.relu(self.proposal(one) + context)) for one in known.unbind(1)]
        return SCORE_GAIN * torch.cat(scores, dim=1)


class SeededRefinement(nn.Module):
    def __init__(self, config):
        super().__init__()
        refinement = config["refinement"]
        self.stride = stride = refinement["stride"]
        self.sweep = refinement.get("sweep")
        self.offsets = offsets_of(config["seeded"]["distances"])
        self.passes = config["seeded"]["passes"]
        upsampled, width, image = refinement["upsampled_channels"], refinement["unet"]["channels"], 3 * stride**2
        count, num_tries = len(self.offsets), 0
        self.upsampler = Conv(config["backbone"]["channels"], upsampled, 3)
        self.matcher = None
        if self.sweep is not None:
            num_tries = self.sweep["num_candidates"] + count - 1
            self.matcher = Conv(upsampled + image, self.sweep["channels"], 3)
        inputs = image + upsampled + 7 * stride**2 + 3 + 2 * (count - 1) + 2 * num_tries
        self.enter, self.enter_norm = Conv(inputs, width, 3), GroupNorm(width, 4)
        self.unet = Unet(refinement["unet"])
        self.to_planes = nn.ModuleList([Conv(width, 2 * width, 3), Conv(2 * width, 5 * stride**2, 3)])
        self.scorer = Scorer(10 if self.sweep is None else 12, 2 * width)

    def forward(self, images, context, seeds, cameras, ranges, neighbours, sources):
        """What the last pass says; each starts from the planes and the density of the one before, as they stand."""
        near, far = (torch.tensor(ends, dtype=images.dtype).reshape(-1, 1, 1, 1) for ends in zip(*ranges))
        matched = seeds
        for number in range(self.passes):
            found = self.refined(number, images, context, seeds, matched, cameras, (near, far), neighbours, sources)
            disparity, density, _, slopes = (x.detach() for x in found)
            planes = torch.cat([1 / far + disparity * (1 / near - 1 / far), slopes], dim=1)
            seeds = replace(seeds, planes=planes, confidence=density)
        return found

    def refined(self, number, images, context, seeds, matched, cameras, ends, neighbours, sources):
        """Relative disparity, density, features and slopes (1 / scene unit), all at full resolution."""
        stride, (near, far) = self.stride, ends
        step = seeds.step.reshape(-1, 1, 1, 1)
        proposals = proposals_of(seeds.planes / step, self.offsets)
        upsampled = F.gelu(upsample(self.upsampler(context), 4 // stride))
        pixels = space_to_depth(images, stride)
        inputs = [pixels, upsampled, seed_inputs(seeds, proposals, self.offsets, stride, cameras, neighbours)]
        inputs.append(torch.full_like(pixels[:, :1], number))
        known = known_of(images, seeds, proposals, self.offsets, stride, cameras, neighbours)
        if self.matcher is not None:
            features = self.matcher(torch.cat([upsampled, pixels], dim=1))
            tries = tries_of(seeds, proposals, self.sweep, stride)
            own, fine = self.sweep["num_candidates"] // 2, self.sweep["num_candidates"]
            for maps in (features, patches_of(images, stride)):
                correlation = plane_sweep(maps, cameras, neighbours, stride, tries)
                inputs.append(correlation)
                of_proposals = torch.cat([correlation[:, own : own + 1], correlation[:, fine:]], dim=1)
                known = torch.cat([known, of_proposals[:, :, None]], dim=2)
        refined = self.unet(F.gelu(self.enter_norm(self.enter(torch.cat(inputs, dim=1)))), sources)
        context = F.gelu(self.to_planes[0](refined))
        per_pixel = depth_to_space(self.to_planes[1](context), stride)
        lead = torch.zeros(1, len(self.offsets), 1, 1, dtype=context.dtype)
        lead[:, 0] = OWN_LEAD
        leans = LEAN * per_pixel[:, 4:]
        planes = propagated(self.scorer(known, context) + lead, leans, proposals, stride)
        density = (per_pixel[:, 3:4] + 4 * seeds.confidence - 2).sigmoid()
        offset = planes[:, :1] + CORRECTION * per_pixel[:, :1]
        # Small offsets are drawn back to where the pass starts, then to matching's depth.
        sureness = seeds.confidence * density.detach()
        moved = held(offset, FINE_STEPS, sureness) * step + seeds.planes[:, :1]
        if number > 0:
            offset = (moved - matched.planes[:, :1]) / step
            moved = held(offset, FINEST_STEPS, matched.confidence * density.detach()) * step + matched.planes[:, :1]
        # A tilt is the change of inverse depth per pixel over inverse depth, times the focal length.
        focal = cameras.intrinsics[:, :2, None, None].to(context.dtype)
        slopes = planes[:, 1:] * step + CORRECTION * per_pixel[:, 1:3] / focal * seeds.planes[:, :1]
        disparity = ((moved - 1 / far) / (1 / near - 1 / far)).clamp(0, 1)
        features = torch.cat([upsample(refined, stride), images, upsample(upsampled, stride)], dim=1)
        return disparity, density, features, slopes


def normals_away(cameras, disparity, slopes):
    """Unit normals `[views, 3, h, w]` of planes in inverse depth, away from the camera (spec 2.9 with z = 1 / w)."""
    height, width = disparity.shape[-2:]
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    normals = []
    for view, (fx, fy, cx, cy) in enumerate(cameras.intrinsics.to(disparity.dtype)):
        w, (w_x, w_y) = disparity[view, 0], slopes[view]
        normal = torch.stack([fx * w_x, fy * w_y, w - w_x * (x - cx) - w_y * (y - cy)])
        normals.append(normal / (normal.square().sum(dim=0) + 1e-8 * w.square()).sqrt())
    return torch.stack(normals)


def frames_of(normals):
    """Quaternions w x y z of the shortest turn from the viewing axis to a normal."""
    x, y, z = normals.unbind(1)
    turn = torch.stack([1 + z, -y, x, torch.zeros_like(x)], dim=1)
    return turn / (turn.square().sum(dim=1, keepdim=True) + 1e-8).sqrt()
