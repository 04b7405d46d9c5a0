"""Surfel adaptation (spec 1.9.3, 2.7.3) and footprint regions (spec 1.9.7, splatting of 3.2 to 3.4), in f64."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F

from cameras import rotation_matrix

RASTER_CUTOFF = 3.0


@dataclass
class Regions:
    """`pixels[k, j]` are indices (view-major, row-major) of candidates, `valid[k, j]` tells which belong to R_k."""

    pixels: torch.Tensor  # [surfels, targets * side^2]
    valid: torch.Tensor
    first: torch.Tensor  # [surfels, targets, 2]: column and row of the first candidate
    step: torch.Tensor  # [surfels, targets]
    # How close the nearest decision was: a rounding error below this cannot change a region.
    margin: float


def adapted_scales(centres, scales, cameras, targets, near_clips, config):
    """Rates `[surfels]` and widened scales `[surfels, 2]`.

    `targets[v]` lists the views that the surfels of view v are seen by, v first.
    """
    per_view = len(centres) // len(targets)
    rates = []
    for home, views in enumerate(targets):
        p = centres[home * per_view : (home + 1) * per_view].double()
        rate = torch.zeros(per_view, dtype=torch.float64)
        for view in views:
            pixel, z = project(p, cameras, view)
            size = torch.tensor([cameras.width, cameras.height], dtype=torch.float64)
            margin = config["visibility_margin"] * size
            seen = (z > near_clips[view]) & ((pixel >= -margin) & (pixel <= size + margin)).all(dim=1)
            if view == home:
                seen = z > 0
            fx, fy = cameras.intrinsics[view, :2]
            rate = torch.where(seen, torch.maximum(rate, (fx * fy).sqrt() / z), rate)
        rates.append(rate)
    rate = torch.cat(rates)
    low_pass = torch.where(rate > 0, config["s"] / rate, torch.zeros_like(rate))
    return rate, (scales.double() ** 2 + low_pass[:, None] ** 2).sqrt()


def project(points, cameras, view):
    """Continuous pixels `[n, 2]` and z-depths `[n]`."""
    p = points @ cameras.rotation[view].T + cameras.translation[view]
    fx, fy, cx, cy = cameras.intrinsics[view]
    return torch.stack([fx * p[:, 0] / p[:, 2] + cx, fy * p[:, 1] / p[:, 2] + cy], dim=1), p[:, 2]


def regions(centres, scales, rotations, cameras, targets, near_clips, config):
    per_view = len(centres) // len(targets)
    parts = {name: [] for name in ("pixels", "valid", "first", "step")}
    margin = float("inf")
    for home, views in enumerate(targets):
        s = slice(home * per_view, (home + 1) * per_view)
        found = [
            window(
                centres[s].double(), scales[s].double(), rotations[s].double(), cameras, view, near_clips[view], config
            )
            for view in views
        ]
        # The home view counts wherever the surfel projects, the others where it projects into the image.
        for slot, view in enumerate(views):
            pixels, valid, first, step, inside, close = found[slot]
            margin = min(margin, close)
            if view == home:
                nothing = ~valid.any(dim=1)
                own = torch.arange(per_view)
                pixels[nothing, 0] = view * per_view + own[nothing]
                first[nothing] = torch.stack([own % cameras.width, own // cameras.width], dim=1)[nothing].double()
                step[nothing] = 1
                valid[nothing, 0] = True
            else:
                valid &= inside[:, None]
            found[slot] = (pixels, valid, first, step)
        for i, name in enumerate(parts):
            columns = [f[i] for f in found]
            parts[name].append(torch.cat(columns, dim=1) if i < 2 else torch.stack(columns, dim=1))
    return Regions(**{name: torch.cat(part) for name, part in parts.items()}, margin=margin)


def window(centres, scales, rotations, cameras, view, near_clip, config):
    """Candidates of each surfel in one view, which of them see more than epsilon, and how close the call was."""
    side, radius, epsilon = 2 * config["radius"] + 1, config["radius"], config["epsilon"]
    width, height = cameras.width, cameras.height
    r = cameras.rotation[view]
    world = rotation_matrix(F.normalize(rotations, dim=1))
    p = centres @ r.T + cameras.translation[view]
    tangent_u, tangent_v = world[:, :, 0] @ r.T * scales[:, :1], world[:, :, 1] @ r.T * scales[:, 1:]
    m = torch.stack([tangent_u, tangent_v, p], dim=2)  # rows X, Y, Z over (u, v, 1)
    fx, fy, cx, cy = cameras.intrinsics[view]
    t_w = m[:, 2]
    t_u, t_v = fx * m[:, 0] + (cx - 0.5) * t_w, fy * m[:, 1] + (cy - 0.5) * t_w

    def box(cutoff):
        sign = torch.tensor([cutoff**2, cutoff**2, -1.0], dtype=torch.float64)
        d = (sign * t_w * t_w).sum(dim=1)
        f = sign / d[:, None]
        middle = torch.stack([(f * t_u * t_w).sum(dim=1), (f * t_v * t_w).sum(dim=1)], dim=1)
        half = middle**2 - torch.stack([(f * t_u * t_u).sum(dim=1), (f * t_v * t_v).sum(dim=1)], dim=1)
        return middle, half.clamp(min=1e-4).sqrt(), d < 0

    cutoff = (-2 * torch.tensor(epsilon, dtype=torch.float64).log()).sqrt()
    low_pass_centre, _, usable = box(RASTER_CUTOFF)
    middle, half, _ = box(cutoff)
    continuous, z = project(centres, cameras, view)
    centre = continuous - 0.5
    size = torch.tensor([width, height], dtype=torch.float64)
    inside = (z > near_clip) & ((continuous >= 0) & (continuous <= size)).all(dim=1)

    reach = torch.maximum(half + (middle - centre).abs(), (low_pass_centre - centre).abs() + cutoff * 0.5**0.5)
    wished = reach.max(dim=1).values / radius
    step = wished.ceil().clamp(min=1) if config["adaptive_stride"] else torch.ones_like(wished)
    # Halves away from zero.
    first = (centre.abs() + 0.5).floor() * centre.sign() - radius * step[:, None]
    j = torch.arange(side * side)
    x = first[:, :1] + (j % side) * step[:, None]
    y = first[:, 1:] + (j // side) * step[:, None]
    # The ray of a pixel is where two planes through the camera meet (spec 3.4: k x l).
    column, row = x[..., None] * t_w[:, None] - t_u[:, None], y[..., None] * t_w[:, None] - t_v[:, None]
    g = torch.linalg.cross(column, row)
    rho_surfel = (g[..., 0] / g[..., 2]) ** 2 + (g[..., 1] / g[..., 2]) ** 2
    rho_low_pass = 2 * ((low_pass_centre[:, None, 0] - x) ** 2 + (low_pass_centre[:, None, 1] - y) ** 2)
    value = (-0.5 * torch.minimum(rho_surfel, rho_low_pass)).exp()
    in_image = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    seen = (usable & (z > near_clip))[:, None] & in_image & (value > epsilon)

    looked_at = (inside & usable)[:, None] & in_image
    close = [(value - epsilon).abs()[looked_at], (wished - wished.round()).abs()[inside & (wished > 0.5)]]
    close.append(((centre - centre.floor()) - 0.5).abs()[inside])
    close.append(torch.minimum(continuous.abs(), (size - continuous).abs()))
    close = min(float(c.min()) for c in close if c.numel() > 0)
    index = (view * height + y) * width + x
    return torch.where(in_image, index, torch.zeros_like(index)).long(), seen, first, step, inside, close
