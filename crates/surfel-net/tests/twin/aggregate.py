"""Cross-view feature aggregation (spec 2.7.4), with every gathered key and value in memory."""

import torch.nn.functional as F
from torch import nn

from layers import LayerNorm, Linear


def gather_attention(query, key, value, num_heads, pixels, valid):
    """All `[surfels, channels]`; `pixels`, `valid` are `[surfels, candidates]`. Surfels without pixels get zero."""
    surfels, channels = query.shape
    dim = channels // num_heads
    # One row per surfel and pixel that sees it.
    surfel, candidate = valid.nonzero(as_tuple=True)
    pixel = pixels[surfel, candidate]
    k, v = (x[pixel].reshape(-1, num_heads, dim) for x in (key, value))
    score = (query[surfel].reshape(-1, num_heads, dim) * k).sum(dim=2) / dim**0.5
    rows = surfel[:, None].expand_as(score)
    largest = score.new_full((surfels, num_heads), float("-inf"))
    largest = largest.scatter_reduce(0, rows, score.detach(), "amax")
    weight = (score - largest[surfel]).exp()
    total = score.new_zeros(surfels, num_heads).index_add(0, surfel, weight)
    weight = weight / total[surfel]
    attended = score.new_zeros(surfels, num_heads, dim).index_add(0, surfel, weight[..., None] * v)
    return attended.reshape(surfels, channels)


class Aggregation(nn.Module):
    def __init__(self, features, config):
        super().__init__()
        channels, hidden = config["channels"], features * config["expansion"]
        self.query_norm, self.query = LayerNorm(features), Linear(features, channels)
        self.memory_norm, self.key, self.value = (
            LayerNorm(features),
            Linear(features, channels),
            Linear(features, channels),
        )
        self.merge = Linear(channels, features)
        self.feed_norm, self.widen, self.narrow = (
            LayerNorm(features),
            Linear(features, hidden),
            Linear(hidden, features),
        )
        self.num_heads = config["num_heads"]

    def forward(self, features, pixels, valid):
        """`[views, channels, h, w]` to the same shape."""
        views, channels, height, width = features.shape
        x = features.permute(0, 2, 3, 1).reshape(-1, channels)
        query, memory = self.query(self.query_norm(x)), self.memory_norm(x)
        attended = gather_attention(query, self.key(memory), self.value(memory), self.num_heads, pixels, valid)
        x = x + self.merge(attended)
        x = x + self.narrow(F.gelu(self.widen(self.feed_norm(x))))
        return x.reshape(views, height, width, channels).permute(0, 3, 1, 2)
