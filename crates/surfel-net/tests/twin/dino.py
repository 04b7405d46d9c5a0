"""The vision transformer of DINOv2 (spec 2.5), its published names, and how its features join the backbone's."""

import math

import torch
import torch.nn.functional as F
from torch import nn

from features import imagenet_normalised
from layers import Conv, LayerNorm, Linear, empty

PATCH = 14


class Block(nn.Module):
    def __init__(self, width, num_heads):
        super().__init__()
        self.attention_norm = LayerNorm(width, eps=1e-6)
        self.qkv, self.merge = Linear(width, 3 * width), Linear(width, width)
        self.attention_gamma = empty(width)
        self.feed_norm = LayerNorm(width, eps=1e-6)
        self.widen, self.narrow = Linear(width, 4 * width), Linear(4 * width, width)
        self.feed_gamma = empty(width)
        self.num_heads = num_heads

    def forward(self, x):
        query, key, value = self.qkv(self.attention_norm(x)).chunk(3, dim=2)
        outputs = []
        for q, k, v in zip(*(part.chunk(self.num_heads, dim=2) for part in (query, key, value))):
            outputs.append((q @ k.transpose(1, 2) / math.sqrt(q.shape[2])).softmax(dim=2) @ v)
        x = x + self.attention_gamma * self.merge(torch.cat(outputs, dim=2))
        return x + self.feed_gamma * self.narrow(F.gelu(self.widen(self.feed_norm(x))))


class Vit(nn.Module):
    """Normalised images `[images, 3, 14 rows, 14 columns]` to features of patches `[images, width, rows, columns]`."""

    def __init__(self, width=16, depth=2, num_heads=2, grid=3):
        super().__init__()
        self.class_token, self.positions = empty(width), empty(1 + grid * grid, width)
        self.patches = Linear(3 * PATCH * PATCH, width)
        self.blocks = nn.ModuleList(Block(width, num_heads) for _ in range(depth))
        self.norm, self.grid = LayerNorm(width, eps=1e-6), grid

    def forward(self, images):
        rows, columns = (side // PATCH for side in images.shape[2:])
        x = self.patches(F.unfold(images, PATCH, stride=PATCH).transpose(1, 2))
        positions = self.positions[1:].reshape(1, self.grid, self.grid, -1).permute(0, 3, 1, 2)
        if (rows, columns) != (self.grid, self.grid):
            # A tenth of a patch more, as the published models do against rounding.
            factor = [(n + 0.1) / self.grid for n in (rows, columns)]
            positions = F.interpolate(positions, scale_factor=factor, mode="bicubic")
        x = x + positions.flatten(2).transpose(1, 2)
        first = (self.class_token + self.positions[0]).expand(len(x), 1, -1)
        x = torch.cat([first, x], dim=1)
        for block in self.blocks:
            x = block(x)
        return self.norm(x)[:, 1:].transpose(1, 2).reshape(len(x), -1, rows, columns)


def patches_of(vit, images):
    """Of images in [0, 1], resized upwards to whole patches."""
    size = [math.ceil(side / PATCH) * PATCH for side in images.shape[2:]]
    return vit(imagenet_normalised(F.interpolate(images, size=size, mode="bilinear")))


def published(vit, hugging_face):
    """The parameters by the names and shapes of the original release, or of Hugging Face."""
    width = len(vit.class_token)
    pick = lambda original, other: other if hugging_face else original
    prefix = pick("", "embeddings.")
    tensors = {
        f"{prefix}cls_token": vit.class_token[None, None],
        prefix + pick("pos_embed", "position_embeddings"): vit.positions[None],
        f"{prefix}mask_token": torch.ones(1, width),
    }

    def linear(name, layer):
        tensors[f"{name}.weight"], tensors[f"{name}.bias"] = layer.weight.t(), layer.bias

    def norm(name, layer):
        tensors[f"{name}.weight"], tensors[f"{name}.bias"] = layer.gamma, layer.beta

    embed = pick("patch_embed.proj", "embeddings.patch_embeddings.projection")
    linear(embed, vit.patches)
    tensors[f"{embed}.weight"] = tensors[f"{embed}.weight"].reshape(width, 3, PATCH, PATCH)
    norm(pick("norm", "layernorm"), vit.norm)
    for i, block in enumerate(vit.blocks):
        at = pick(f"blocks.{i}", f"encoder.layer.{i}")
        norm(f"{at}.norm1", block.attention_norm)
        norm(f"{at}.norm2", block.feed_norm)
        linear(f"{at}.mlp.fc1", block.widen)
        linear(f"{at}.mlp.fc2", block.narrow)
        linear(f"{at}." + pick("attn.proj", "attention.output.dense"), block.merge)
        tensors[f"{at}." + pick("ls1.gamma", "layer_scale1.lambda1")] = block.attention_gamma
        tensors[f"{at}." + pick("ls2.gamma", "layer_scale2.lambda1")] = block.feed_gamma
        if hugging_face:
            for part, weight, bias in zip(
                ("query", "key", "value"), block.qkv.weight.t().chunk(3), block.qkv.bias.chunk(3)
            ):
                tensors[f"{at}.attention.attention.{part}.weight"] = weight
                tensors[f"{at}.attention.attention.{part}.bias"] = bias
        else:
            linear(f"{at}.attn.qkv", block.qkv)
    return tensors


class DinoFusion(nn.Module):
    """The backbone's `[views, channels, h, w]` at stride 4 with the features of patches added."""

    def __init__(self, width, channels):
        super().__init__()
        self.project, self.join = Conv(width, channels, 1), Conv(channels, channels, 3)

    def forward(self, context, patches):
        # Pixel i stands over the centre of input pixel 4 i; `grid_sample` counts shares of a side from -1 to 1.
        shares = [(4 * torch.arange(n, dtype=torch.float64) + 0.5) / (4 * n) for n in context.shape[2:]]
        y, x = torch.meshgrid(*(2 * share - 1 for share in shares), indexing="ij")
        grid = torch.stack([x, y], dim=2).expand(len(context), -1, -1, -1)
        projected = F.grid_sample(self.project(patches), grid, padding_mode="border", align_corners=False)
        return context + self.join(projected)
