//! Contact shadows: how much of the sky the objects on a panel hide from it.
//!
//! Measured once per scene on a coarse grid, because light from everywhere changes slowly. Invariant:
//! depends on the geometry of the stage only.

use super::panel::{OpennessMap, Panel};
use super::stage::Stage;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Samples along each side of the grid.
const SIZE: usize = 40;
/// Rays per sample.
const RAYS: usize = 20;

/// Measures the part of panel `index` that lies near objects; `reach` is how far an object darkens.
pub(super) fn measure(stage: &Stage, index: usize, reach: f64) -> Option<OpennessMap> {
    let panel = &stage.panels[index];
    let bounds = bounds(stage, panel, reach)?;
    let normal = panel.normal();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let directions: Vec<Vec3> = (0..RAYS)
        .map(|i| {
            let radius_sq = (i as f64 + 0.5) / RAYS as f64;
            let (sin, cos) = (2.399_963 * i as f64).sin_cos();
            let flat = (tangent * cos + bitangent * sin) * radius_sq.sqrt();
            (flat + normal * (1.0 - radius_sq).sqrt()).as_vec3()
        })
        .collect();
    let values = (0..SIZE * SIZE).into_par_iter().map(|i| {
        let step = Vec2::new((i % SIZE) as f32, (i / SIZE) as f32) / (SIZE as f32 - 1.0);
        let p = bounds[0] + step * (bounds[1] - bounds[0]);
        let lift = normal * (1e-4 * stage.radius);
        let point = panel.centre + panel.half[0] * f64::from(p.x) + panel.half[1] * f64::from(p.y) + lift;
        let open = directions.iter().filter(|&&d| !stage.is_blocked(point, d, reach)).count();
        open as f32 / RAYS as f32
    });
    Some(OpennessMap { size: SIZE, values: values.collect(), bounds })
}

/// Panel coordinates of the rectangle that objects can darken; `None` when there is none.
fn bounds(stage: &Stage, panel: &Panel, reach: f64) -> Option<[Vec2; 2]> {
    let normal = panel.normal();
    let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    for instance in &stage.instances {
        let (centre, radius): (DVec3, f64) = (instance.world_from_mesh.translation, instance.world_from_mesh.scale);
        if normal.dot(centre - panel.centre) > radius + reach {
            continue;
        }
        let [u, v] = panel.coordinates(centre);
        let grow = Vec2::new((1.0 / panel.half[0].length()) as f32, (1.0 / panel.half[1].length()) as f32)
            * (radius + 0.7 * reach) as f32;
        let middle = Vec2::new(u as f32, v as f32);
        low = low.min(middle - grow);
        high = high.max(middle + grow);
    }
    let (low, high) = (low.max(Vec2::NEG_ONE), high.min(Vec2::ONE));
    (low.cmplt(high).all()).then_some([low, high])
}
