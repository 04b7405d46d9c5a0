"""Times a network of the shapes of `presets/small.toml` in PyTorch, part by part, with random weights.

    python bench/peers/torch_small.py [--preset small] [--size 320 256] [--threads 2] [--runs 5] [--backward]

The graph is the twin of crates/surfel-net/tests/twin; only the pretrained trunk is added here. A part that the preset
does not build does not appear. Prints the best of the runs in ms.
"""

import argparse
import pathlib
import resource
import sys
import time
import tomllib
from collections import defaultdict

import torch
import torch.nn.functional as F
from torch import nn

NET = pathlib.Path(__file__).resolve().parents[2] / "crates/surfel-net"
sys.path.insert(0, str(NET / "tests/twin"))

from cameras import side_by_side  # noqa: E402
from network import Network  # noqa: E402
from seeded import Seeds  # noqa: E402

# EfficientNet-Lite0 up to stride 16: output channels, kernel, stride, expansion.
BLOCKS = [(16, 3, 1, 1), (24, 3, 2, 6), (24, 3, 1, 6), (40, 5, 2, 6), (40, 5, 1, 6), (80, 3, 2, 6)]
BLOCKS += [(80, 3, 1, 6), (80, 3, 1, 6), (112, 5, 1, 6), (112, 5, 1, 6), (112, 5, 1, 6)]
STAGE_ENDS = (2, 4, 10)
SHIFT = 3


class SameConv(nn.Module):
    """Convolution with the BatchNorm after it folded in, padded right and bottom first."""

    def __init__(self, inputs, outputs, kernel, stride=1, groups=1):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, groups=groups)
        before = (kernel - stride) // 2
        self.padding = (before, kernel - stride - before) * 2

    def forward(self, x):
        return self.conv(F.pad(x, self.padding))


class Block(nn.Module):
    def __init__(self, inputs, outputs, kernel, stride, expansion):
        super().__init__()
        wide = inputs * expansion
        self.expand = nn.Conv2d(inputs, wide, 1) if expansion > 1 else None
        self.depthwise = SameConv(wide, wide, kernel, stride, groups=wide)
        self.project = nn.Conv2d(wide, outputs, 1)
        self.residual = stride == 1 and inputs == outputs

    def forward(self, x):
        y = x if self.expand is None else F.relu6(self.expand(x))
        y = self.project(F.relu6(self.depthwise(y)))
        return x + y if self.residual else y


class Trunk(nn.Module):
    """Frozen: maps at strides 4, 8 and 16 of images moved right and down by three pixels."""

    def __init__(self):
        super().__init__()
        self.stem = SameConv(3, 32, 3, 2)
        channels, self.blocks = 32, nn.ModuleList()
        for outputs, kernel, stride, expansion in BLOCKS:
            self.blocks.append(Block(channels, outputs, kernel, stride, expansion))
            channels = outputs

    @torch.no_grad()
    def forward(self, images):
        _, _, height, width = images.shape
        moved = F.pad(images, (SHIFT, -(width + SHIFT) % 16, SHIFT, -(height + SHIFT) % 16), mode="replicate")
        x, maps = F.relu6(self.stem(moved)), []
        for i, block in enumerate(self.blocks):
            x = block(x)
            if i in STAGE_ENDS:
                stride = (4, 8, 16)[len(maps)]
                maps.append(x[:, :, : height // stride, : width // stride])
        return maps


def watch(net, spent):
    """Adds the time of every direct part of the network to `spent`."""
    for name, part in net.named_children():
        started = []
        part.register_forward_pre_hook(lambda *_, started=started: started.append(time.perf_counter()))

        def finished(*_, name=name, started=started):
            spent[name] += time.perf_counter() - started.pop()

        part.register_forward_hook(finished)


def slanted_plane(height, width):
    """As if matching had found one."""
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    w = 0.4 + 2e-4 * x + 1e-4 * y
    planes = torch.stack([w, torch.full_like(w, 2e-4), torch.full_like(w, 1e-4)]).expand(2, -1, -1, -1)
    ones = torch.ones(2, 1, height, width)
    evidence = torch.cat([planes[:, :1] + 1e-3, ones], dim=1)
    return Seeds(planes, evidence, 0.8 * ones, 0.9 * ones, torch.tensor([5e-3, 5e-3]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="small")
    parser.add_argument("--size", type=int, nargs=2, default=(320, 256), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--backward", action="store_true", help="also time forward and backward together")
    options = parser.parse_args()

    torch.set_num_threads(options.threads)
    torch.manual_seed(0)
    config = tomllib.loads((NET / f"presets/{options.preset}.toml").read_text())
    net = Network(config, Trunk() if config["backbone"]["kind"] == "pretrained" else None)
    for parameter in net.parameters():
        nn.init.uniform_(parameter, -0.1, 0.1)
    width, height = options.size
    rig = side_by_side(2, width, height, seed=0)
    images = torch.rand(2, 3, height, width)
    ranges = [(1.0, 5.0)] * 2
    seeds = slanted_plane(height, width) if "seeded" in config else None
    spent = defaultdict(float)
    watch(net, spent)

    def forward():
        return net(images, rig, ranges, multiple=64, seeds=seeds)

    best, parts = float("inf"), {}
    with torch.inference_mode():
        forward()
        for _ in range(options.runs):
            spent.clear()
            start = time.perf_counter()
            forward()
            elapsed = time.perf_counter() - start
            if elapsed < best:
                best, parts = elapsed, dict(spent)
    result = {"forward_ms": 1e3 * best, "parts_ms": {name: 1e3 * t for name, t in parts.items()}}
    result["parts_ms"]["the rest"] = 1e3 * (best - sum(parts.values()))
    if options.backward:
        best = float("inf")
        for _ in range(options.runs):
            net.zero_grad()
            start = time.perf_counter()
            prediction = forward()
            surfels = prediction.surfels
            loss = prediction.depth.sum() + sum(x.square().sum() for x in vars(surfels).values())
            loss.backward()
            best = min(best, time.perf_counter() - start)
        result["forward_backward_ms"] = 1e3 * best
    result["peak_mib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"PyTorch {torch.__version__}, {options.threads} threads, {options.preset}, two views of {width} x {height}")
    for name, ms in result["parts_ms"].items():
        print(f"  {name}: {ms:.1f} ms")
    print(f"forward: {result['forward_ms']:.0f} ms")
    if options.backward:
        print(f"forward and backward: {result['forward_backward_ms']:.0f} ms")
    print(f"peak memory: {result['peak_mib']:.0f} MiB")


if __name__ == "__main__":
    main()
