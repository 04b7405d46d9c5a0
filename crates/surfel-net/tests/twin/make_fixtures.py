"""Runs the twins on small random inputs and writes what they answer; see README.md.

    python make_fixtures.py [CASE ...]

A case is one safetensors file: `weight.*` (f16, and exact in it), `input.*` (differentiated) and `given.*` (not),
perhaps `camera.*` (f64), the `output.*` of the twin, which computes in f64, and the gradients `grad.*` of a loss that
weighs output element i by `((37 i) mod 11 - 5) / 5`. A gradient of more than 512 elements is folded: element i is
added to sum `i mod 61`.
"""

import functools
import pathlib
import sys
import tomllib

import numpy as np
import torch
from safetensors.numpy import save_file

import cameras as posed
from aggregate import Aggregation, gather_attention
from dino import DinoFusion, Vit, patches_of, published
from epipolar import Lines, epipolar_attention
from features import Cnn, Pyramid
from head import AttributeHead, surfels_of
from matching import CoarseDepth, plane_sweep, uniform_disparities
from network import Network
from nyquist import adapted_scales, regions
from refine import Refinement
from seeded import Seeds
from transformer import Transformer
from unet import Unet, ViewAttention

HERE = pathlib.Path(__file__).parent
CONFIG = tomllib.loads((HERE / "twin.toml").read_text())
TINY = tomllib.loads((HERE / "../../presets/tiny.toml").read_text())
# Rounding of f32 moves a splatted value by less than this.
SAFE_MARGIN = 1e-5
# Near and far of up to three views.
RANGES = [(1.5, 6.0), (1.4, 5.0), (1.6, 7.0)]


def random(seed, *shape, low=-1.0, high=1.0):
    """Uniform, and exact in f32."""
    values = np.random.default_rng(seed).uniform(low, high, shape)
    return torch.tensor(values.astype(np.float32)).double()


def filled(module, seed):
    """The module with random weights of the size that keeps activations near one."""
    module = module.double()
    with torch.no_grad():
        for i, (name, parameter) in enumerate(module.named_parameters()):
            value = random([seed, i], *parameter.shape)
            if parameter.dim() > 1:
                fan_in = parameter[0].numel() if parameter.dim() == 4 else parameter.shape[0]
                value *= (3 / fan_in) ** 0.5
            elif name.endswith("gamma"):
                value = 1 + 0.3 * value
            else:
                value *= 0.2
            parameter.copy_(exact(value))
    return module


def exact(weights):
    """Rounded to what a file holds."""
    return weights.half().double()


def loss_of(outputs):
    total = 0
    for output in outputs.values():
        flat = output.reshape(-1)
        weight = (37 * torch.arange(len(flat)) % 11 - 5).double() / 5
        total = total + (flat * weight).sum()
    return total


def folded(gradient):
    flat = gradient.reshape(-1)
    if len(flat) <= 512:
        return gradient
    return torch.zeros(61, dtype=flat.dtype).index_add(0, torch.arange(len(flat)) % 61, flat)


def write(name, call, inputs, module=None, cameras=None, given=None):
    """`call(**inputs)` gives a dict of outputs, or one tensor."""
    inputs = {key: value.clone().requires_grad_() for key, value in inputs.items()}
    outputs = call(**inputs)
    if torch.is_tensor(outputs):
        outputs = {"y": outputs}
    loss = loss_of(outputs)
    if loss.requires_grad:
        loss.backward()
    tensors, weights = {}, {}
    for key, value in inputs.items():
        tensors[f"input.{key}"] = value
        tensors[f"grad.input.{key}"] = folded(value.grad)
    for key, value in outputs.items():
        tensors[f"output.{key}"] = value
    if module is not None:
        for key, value in module.named_parameters():
            weights[f"weight.{key}"] = value.detach().numpy().astype(np.float16)
            tensors[f"grad.weight.{key}"] = folded(value.grad)
    arrays = {key: value.detach().numpy().astype(np.float32) for key, value in tensors.items()} | weights
    if cameras is not None:
        arrays["camera.intrinsics"] = cameras.intrinsics.numpy()
        arrays["camera.rotation"] = cameras.rotation.numpy()
        arrays["camera.translation"] = cameras.translation.numpy()
    arrays |= {f"given.{key}": value for key, value in (given or {}).items()}
    (HERE / "fixtures").mkdir(exist_ok=True)
    arrays = {key: np.ascontiguousarray(value) for key, value in arrays.items()}
    save_file(arrays, HERE / "fixtures" / f"{name}.safetensors")
    print(f"{name}: {sum(a.nbytes for a in arrays.values()) / 1024:.0f} KiB")


CASES = {}


def case(function):
    CASES[function.__name__] = function
    return function


def others(views):
    return [[o for o in range(views) if o != v] for v in range(views)]


def with_itself(views):
    return [[v] + o for v, o in enumerate(others(views))]


@case
def cnn():
    module = filled(Cnn(CONFIG["backbone"]["widths"], CONFIG["backbone"]["channels"]), 1)
    write("cnn", module, {"images": random(2, 2, 3, 16, 24, low=0)}, module)


@case
def pyramid():
    module = filled(Pyramid(8), 3)
    maps = {f"s{s}": random(4 + s, 2, c, 32 // s, 48 // s) for s, c in ((4, 24), (8, 40), (16, 112))}
    write("pyramid", lambda s4, s8, s16: module([s4, s8, s16]), maps, module)


@case
def transformer():
    for views in (2, 3):
        module = filled(Transformer(8, CONFIG["transformer"]), 10 + views)
        features = random(11, views, 8, 8, 12)
        call = functools.partial(module, neighbours=others(views))
        write(f"transformer_{views}_views", call, {"features": features}, module)


def clear_lines(num_samples, height, width, seed):
    """Cameras with different intrinsics, some of whose lines leave the neighbour, none of them by a hair."""
    for attempt in range(1000):
        rig = posed.side_by_side(3, 4 * width, 4 * height, seed=[seed, attempt])
        rig.intrinsics = rig.intrinsics * random([seed, attempt], 3, 4, low=0.8, high=1.2)
        lines = Lines(rig, others(3), RANGES, num_samples, height, width)
        if lines.margin > 10 * SAFE_MARGIN:
            break
    inside = torch.cat([inside.double().flatten() for view in lines.inside for inside in view])
    lonely = sum(int((torch.cat(view).sum(dim=0) == 0).sum()) for view in lines.inside)
    print(f"  margin {lines.margin:.1e}, {inside.mean():.0%} of the samples inside, {lonely} pixels without any")
    return rig, lines


@case
def epipolar():
    rig, lines = clear_lines(5, 6, 8, seed=14)
    inputs = {name: 2 * random(15 + i, 3, 6, 8, 8) for i, name in enumerate(("query", "key", "value"))}
    inputs |= {name: random(18 + i, 5, 8) for i, name in enumerate(("depth_key", "depth_value"))}
    call = functools.partial(epipolar_attention, num_heads=2, lines=lines)
    write("epipolar_attention", call, inputs, cameras=rig)

    config = CONFIG["transformer"] | {"epipolar": {"num_samples": 7, "num_heads": 2}}
    rig, lines = clear_lines(7, 8, 12, seed=16)
    module = filled(Transformer(8, config), 17)
    call = functools.partial(module, neighbours=others(3), lines=lines)
    write("transformer_epipolar", call, {"features": random(11, 3, 8, 8, 12)}, module, cameras=rig)


def published_file(name, tensors):
    arrays = {key: np.ascontiguousarray(value.detach().numpy().astype(np.float16)) for key, value in tensors.items()}
    save_file(arrays, HERE / "fixtures" / f"{name}.safetensors")


@case
def dino():
    module = filled(Vit(), 120)
    inputs = {"wide": random(121, 2, 3, 28, 56), "square": random(122, 1, 3, 42, 42)}
    write("vit", lambda wide, square: {"wide": module(wide), "square": module(square)}, inputs, module)
    published_file("dino_original", published(module, hugging_face=False))
    published_file("dino_hugging_face", published(module, hugging_face=True))
    images = random(123, 2, 3, 16, 32, low=0)
    write("dino_patches", lambda: patches_of(module, images), {}, given={"images": images.numpy().astype(np.float32)})
    fusion = filled(DinoFusion(16, 8), 124)
    inputs = {"context": random(125, 2, 8, 4, 6), "patches": random(126, 2, 16, 2, 3)}
    write("dino_fusion", fusion, inputs, fusion)


@case
def view_attention():
    module = filled(ViewAttention(64), 20)
    x = random(21, 3, 64, 3, 4)
    write("view_attention", lambda x: module(x, with_itself(3)), {"x": x}, module)


@case
def unet():
    module = filled(Unet({"channels": 8, "multipliers": [1, 2], "attention_at": [2]}), 22)
    write("unet", lambda x: module(x, with_itself(2)), {"x": random(23, 2, 8, 6, 8)}, module)


@case
def sweep():
    rig = posed.side_by_side(3, 40, 32, seed=30)
    disparities = [uniform_disparities(1.2, 6.0, 8)] * 3
    base = random(32, 3, 8, 10, low=0.2, high=0.6)
    step = [torch.tensor([-0.1, 0.0, 0.1], dtype=torch.float64)] * 3

    def call(features):
        return {
            "coarse": plane_sweep(features, rig, others(3), 4, disparities),
            "fine": plane_sweep(features, rig, others(3), 4, step, base),
        }

    given = {"base": base.numpy().astype(np.float32)}
    write("sweep", call, {"features": random(31, 3, 8, 8, 10)}, cameras=rig, given=given)


@case
def coarse():
    module = filled(CoarseDepth(8, CONFIG["cost_volume"]), 40)

    def call(correlation, features):
        disparity, confidence = module(correlation, features, with_itself(2))
        return {"disparity": disparity, "confidence": confidence}

    write("coarse", call, {"correlation": random(41, 2, 8, 6, 8), "features": random(42, 2, 8, 6, 8)}, module)


@case
def refine():
    module = filled(Refinement(CONFIG), 50)
    rig = posed.side_by_side(2, 16, 8, seed=51)
    with torch.no_grad():
        module.to_disparity[1].weight.copy_(exact(0.2 * module.to_disparity[1].weight))

    def call(images, matching, context, coarse, confidence):
        disparity, density, features = module(
            images, matching, context, coarse, confidence, rig, RANGES[:2], others(2), with_itself(2)
        )
        inside = ((disparity > 0) & (disparity < 1)).double().mean()
        assert inside > 0.8, f"only {inside:.2f} of the disparities are not clamped"
        return {"disparity": disparity, "density": density, "features": features}

    inputs = {
        "images": random(52, 2, 3, 8, 16, low=0),
        "matching": random(53, 2, 8, 2, 4),
        "context": random(54, 2, 8, 2, 4),
        "coarse": random(55, 2, 1, 2, 4, low=0.2, high=0.8),
        "confidence": random(56, 2, 1, 2, 4, low=0.1, high=0.9),
    }
    write("refine", call, inputs, module, cameras=rig)


@case
def attributes():
    module = filled(AttributeHead(10, CONFIG["head"]), 60)
    write("attributes", module, {"features": random(61, 2, 10, 4, 5)}, module)


def surfel_outputs(surfels, prefix=""):
    return {prefix + name: value for name, value in vars(surfels).items()}


@case
def adapter():
    rig = posed.side_by_side(2, 6, 5, seed=70)
    config = {"sh_degree": 3, "scale_min": 0.5, "scale_max": 15.0}
    inputs = {
        "attributes": random(71, 2, 54, 5, 6),
        "depth": random(72, 2, 1, 5, 6, low=1.5, high=4.0),
        "opacity": random(73, 2, 1, 5, 6, low=0.1, high=0.9),
    }

    def call(**raw):
        return surfel_outputs(surfels_of(**raw, cameras=rig, config=config))

    write("adapter", call, inputs, cameras=rig)


def scattered_surfels(rig, seed):
    """One near every pixel's ray, from a tenth of a pixel to several pixels wide."""
    count = len(rig) * rig.width * rig.height
    fx, fy, cx, cy = rig.intrinsics.T
    view, index = torch.arange(count) // (rig.width * rig.height), torch.arange(count) % (rig.width * rig.height)
    depth = random([seed, 0], count, low=1.5, high=4.0)
    x, y = index % rig.width + 0.5, index // rig.width + 0.5
    ray = torch.stack([(x - cx[view]) / fx[view], (y - cy[view]) / fy[view], torch.ones(count)], dim=1)
    centres = ((ray * depth[:, None] - rig.translation[view])[:, None] @ rig.rotation[view])[:, 0]
    scales = (depth / fx[view])[:, None] * random([seed, 1], count, 2, low=-2.3, high=1.6).exp()
    return [v.float().double() for v in (centres, scales, random([seed, 2], count, 4))]


@case
def footprints():
    nyquist = CONFIG["nyquist"]
    near_clips = [1e-3] * 2
    for seed in range(1000):
        rig = posed.side_by_side(2, 16, 12, seed=80)
        centres, scales, rotations = scattered_surfels(rig, 1000 + seed)
        rates, adapted = adapted_scales(centres, scales, rig, with_itself(2), near_clips, nyquist)
        found = regions(centres, scales, rotations, rig, with_itself(2), near_clips, nyquist)
        if found.margin > SAFE_MARGIN:
            break
    side = 2 * nyquist["radius"] + 1
    bits = found.valid.reshape(len(centres), 2, side * side)
    mask = (bits.long() << torch.arange(side * side)).sum(dim=2)
    given = {"centres": centres, "scales": scales, "rotations": rotations}
    given = {key: value.numpy().astype(np.float32) for key, value in given.items()}
    windows = torch.cat([found.first.long(), found.step.long()[..., None], mask[..., None]], dim=2)
    given["windows"] = windows.numpy().astype(np.int32)
    write("footprints", lambda: {"rates": rates, "adapted": adapted}, {}, cameras=rig, given=given)
    sparse = (found.step > 1).double().mean()
    average = bits.sum(dim=2).double().mean()
    print(f"  seed {seed}, margin {found.margin:.1e}, {average:.1f} pixels a window, {sparse:.0%} sparse")


def some_regions(views, width, height, side, seed):
    """Random windows, one surfel without any; as indices and as `[surfels, targets, (x, y, step, mask)]`."""
    rng = np.random.default_rng(seed)
    targets = with_itself(views)
    count = views * width * height
    windows = np.zeros((count, views, 4), dtype=np.int32)
    pixels = torch.zeros(count, views * side * side, dtype=torch.long)
    valid = torch.zeros(count, views * side * side, dtype=torch.bool)
    for k in range(count):
        for slot, view in enumerate(targets[k // (width * height)]):
            x, y, step, mask = int(rng.integers(-2, 4)), int(rng.integers(-2, 4)), int(rng.integers(1, 3)), 0
            for bit in range(side * side):
                px, py = x + bit % side * step, y + bit // side * step
                if 0 <= px < width and 0 <= py < height and rng.random() < 0.6 and k != 17:
                    mask |= 1 << bit
                    pixels[k, slot * side * side + bit] = (view * height + py) * width + px
                    valid[k, slot * side * side + bit] = True
            windows[k, slot] = (x, y, step, mask)
    return pixels, valid, windows


@case
def attention():
    pixels, valid, windows = some_regions(3, 6, 5, 5, seed=90)
    inputs = {name: 2 * random(91 + i, 90, 8) for i, name in enumerate(("query", "key", "value"))}
    call = functools.partial(gather_attention, num_heads=2, pixels=pixels, valid=valid)
    write("gather_attention", call, inputs, given={"windows": windows})
    module = filled(Aggregation(11, CONFIG["aggregation"]), 95)
    features = {"features": random(96, 3, 11, 5, 6)}
    call = functools.partial(module, pixels=pixels, valid=valid)
    write("aggregation", call, features, module, given={"windows": windows})


def photographs(views, width, height, seed):
    y, x = np.mgrid[:height, :width]
    waves = [[0.5 + 0.3 * np.sin(0.5 * x + 0.4 * v + c) * np.cos(0.35 * y - c) for c in range(3)] for v in range(views)]
    return (torch.tensor(np.array(waves)) + 0.2 * random(seed, views, 3, height, width)).float().double()


def whole_network(name, config, last_layer, damping, images, rig, ranges, multiple, seeds=None, given=None):
    """Damps the last layer before depth, which otherwise saturates, and looks for weights whose regions are clear."""
    for seed in range(1000):
        module = filled(Network(config), 2000 + seed)
        with torch.no_grad():
            last = last_layer(module)
            last.weight.copy_(exact(damping * last.weight))
            margin = module(images, rig, ranges, multiple, seeds).regions.margin
        if margin > SAFE_MARGIN:
            break

    def call():
        prediction = module(images, rig, ranges, multiple, seeds)
        initial = surfel_outputs(prediction.initial, "initial_")
        outputs = surfel_outputs(prediction.surfels)
        outputs |= {name: initial[name] for name in ("initial_scales", "initial_rotations")}
        return outputs | {"depth": prediction.depth, "confidence": prediction.confidence}

    given = (given or {}) | {"images": images}
    given = {key: value.numpy().astype(np.float32) for key, value in given.items()}
    write(name, call, {}, module, cameras=rig, given=given)
    print(f"  seed {seed}, margin {margin:.1e}")


@case
def network():
    rig = posed.side_by_side(3, 20, 12, seed=100)
    images = photographs(3, 20, 12, seed=101)
    last_layer = lambda module: module.refinement.to_disparity[1]
    whole_network("network", TINY, last_layer, 0.1, images, rig, RANGES, multiple=8)


@case
def seeded_network():
    """The graph that ships: no transformer and no cost volume, but seeds."""
    config = {key: value for key, value in CONFIG.items() if key not in ("transformer", "cost_volume")}
    config["seeded"] = {"distances": [2, 5], "passes": 2}
    rig = posed.side_by_side(2, 18, 11, seed=110)
    images = photographs(2, 18, 11, seed=111)
    step = torch.tensor([0.01, 0.012], dtype=torch.float32).double()
    slopes = 0.3 * random(112, 2, 2, 11, 18) * step.reshape(2, 1, 1, 1)
    y, x = torch.meshgrid(torch.arange(11), torch.arange(18), indexing="ij")
    surface = 0.35 + 0.004 * x - 0.003 * y + step.reshape(2, 1, 1, 1) * random(113, 2, 1, 11, 18)
    planes = torch.cat([surface, slopes], dim=1).float().double()
    found = planes[:, :1] + 3 * step.reshape(2, 1, 1, 1) * random(114, 2, 1, 11, 18)
    evidence = torch.cat([found, random(115, 2, 1, 11, 18, low=0, high=3)], dim=1).float().double()
    correlation, confidence = random(116, 2, 1, 11, 18), random(117, 2, 1, 11, 18, low=0)
    given = {"planes": planes, "evidence": evidence, "correlation": correlation, "confidence": confidence, "step": step}
    last_layer = lambda module: module.seeded.to_planes[1]
    whole_network("seeded_network", config, last_layer, 1.0, images, rig, RANGES[:2], 4, Seeds(**given), given)


if __name__ == "__main__":
    torch.set_num_threads(1)
    for name in sys.argv[1:] or CASES:
        CASES[name]()
