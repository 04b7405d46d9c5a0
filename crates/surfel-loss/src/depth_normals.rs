//! Normals of a depth map, differentiable (paper: `N` of `L_align`; spec 2.9, 3.8).
//!
//! Cross product of central differences of unprojected pixels, as [`surfel_core::Camera`] unprojects. Invariant: the
//! normals of the depth of any plane are that plane's normal, at any intrinsics and in any unit.

use burn::tensor::{Bool, Tensor, TensorData};
use surfel_core::Intrinsics;

/// Normals of all pixels but the border.
#[derive(Clone, Debug)]
pub struct DepthNormals {
    /// Unit normals in the camera frame, facing the camera, `[3, height - 2, width - 2]`; anything where not valid.
    pub normals: Tensor<3>,
    /// True where all four neighbours have a depth, `[height - 2, width - 2]`.
    pub valid: Tensor<2, Bool>,
}

/// Keeps the direction of a vanishing cross product finite. Depth is divided by its largest value first, so
/// cross products that mean something are above 1e-12.
const TINY: f64 = 1e-30;

/// Normals of z-depth `[height, width]`; `None` for a map without interior pixels.
pub fn depth_normals(depth: Tensor<2>, intrinsics: &Intrinsics) -> Option<DepthNormals> {
    let [height, width] = depth.dims();
    if height < 3 || width < 3 {
        return None;
    }
    let unit = depth.clone().without_autodiff().max().clamp_min(f32::MIN_POSITIVE).reshape([1, 1]);
    let z = depth.clone() / unit;
    let centre = intrinsics.principal_index();
    let slopes = |len: usize, centre: f64, focal: f64, shape: [usize; 2]| {
        let values: Vec<f32> = (0..len).map(|i| ((i as f64 - centre) / focal) as f32).collect();
        Tensor::<2>::from_data(TensorData::new(values, shape), &depth.device())
    };
    let x = z.clone() * slopes(width, centre.x, intrinsics.fx, [1, width]);
    let y = z.clone() * slopes(height, centre.y, intrinsics.fy, [height, 1]);
    let points = [x, y, z];
    let [down, right] = [Neighbours::Rows, Neighbours::Columns]
        .map(|neighbours| points.clone().map(|axis| neighbours.after(axis.clone()) - neighbours.before(axis)));

    let cross = |a: usize, b: usize| down[a].clone() * right[b].clone() - down[b].clone() * right[a].clone();
    let product: Tensor<3> = Tensor::stack(vec![cross(1, 2), cross(2, 0), cross(0, 1)], 0);
    let length = (product.clone().square().sum_dim(0) + TINY).sqrt();
    let valid = [Neighbours::Rows, Neighbours::Columns]
        .map(|n| has_depth(n.before(depth.clone())).bool_and(has_depth(n.after(depth.clone()))))
        .into_iter()
        .reduce(Tensor::bool_and)?;
    Some(DepthNormals { normals: product / length, valid })
}

fn has_depth(depth: Tensor<2>) -> Tensor<2, Bool> {
    depth.greater_scalar(0.0)
}

/// Which two neighbours of the interior pixels.
#[derive(Clone, Copy)]
enum Neighbours {
    Rows,
    Columns,
}

impl Neighbours {
    fn before(self, map: Tensor<2>) -> Tensor<2> {
        self.shifted(map, 0)
    }

    fn after(self, map: Tensor<2>) -> Tensor<2> {
        self.shifted(map, 2)
    }

    fn shifted(self, map: Tensor<2>, by: usize) -> Tensor<2> {
        let [height, width] = map.dims();
        let (row, column) = match self {
            Self::Rows => (by, 1),
            Self::Columns => (1, by),
        };
        map.narrow(0, row, height - 2).narrow(1, column, width - 2)
    }
}

/// The interior `[.., height - 2, width - 2]` of a map.
pub(crate) fn interior<const D: usize>(map: Tensor<D>) -> Tensor<D> {
    let dims = map.dims();
    map.narrow(D - 2, 1, dims[D - 2] - 2).narrow(D - 1, 1, dims[D - 1] - 2)
}
