"""Posed views in f64: OpenCV axes, `camera_from_world`, intrinsics in pixels with the first pixel centre at 0.5."""

from dataclasses import dataclass

import numpy as np
import torch


@dataclass
class Cameras:
    intrinsics: torch.Tensor  # [views, 4]: fx, fy, cx, cy
    rotation: torch.Tensor  # [views, 3, 3] camera_from_world
    translation: torch.Tensor  # [views, 3]
    width: int
    height: int

    def __len__(self):
        return len(self.intrinsics)

    def centres(self):
        return -(self.rotation.transpose(1, 2) @ self.translation[:, :, None])[:, :, 0]

    def matrix(self, view, stride=1):
        """K in index coordinates of a map whose pixel i stands over input pixel `stride i`."""
        fx, fy, cx, cy = self.intrinsics[view] / stride
        half = 0.5 / stride
        return torch.tensor([[fx, 0, cx - half], [0, fy, cy - half], [0, 0, 1]], dtype=torch.float64)


def side_by_side(views, width, height, seed):
    """Cameras next to each other that look at the same place, none of them in a special position."""
    rng = np.random.default_rng(seed)
    intrinsics, rotations, translations = [], [], []
    for view in range(views):
        focal = width * rng.uniform(1.0, 1.2)
        intrinsics.append([focal, focal * rng.uniform(0.97, 1.03), width * 0.51, height * 0.48])
        quaternion = np.array([1.0, 0.02, 0.06 * view + 0.01, -0.03]) + rng.normal(0, 0.01, 4)
        rotations.append(rotation_matrix(torch.tensor(quaternion / np.linalg.norm(quaternion))))
        translations.append([-0.3 * view, 0.02 * view, 0.03 * view] + rng.normal(0, 0.01, 3))
    return Cameras(
        torch.tensor(np.array(intrinsics)), torch.stack(rotations), torch.tensor(np.array(translations)), width, height
    )


def rotation_matrix(q):
    """Of unit quaternions w x y z, `[..., 4]` to `[..., 3, 3]` (spec 1.4)."""
    w, x, y, z = q.unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def quaternion(rotation):
    """The unit quaternion of a rotation matrix, as the eigenvector of its symmetric form; w >= 0."""
    m = rotation
    k = torch.stack(
        [
            torch.stack([m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]),
            torch.stack([m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]]),
            torch.stack([m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]]),
            torch.stack([m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]]),
        ]
    )
    q = torch.linalg.eigh(k).eigenvectors[:, -1]
    return q if q[0] >= 0 else -q
