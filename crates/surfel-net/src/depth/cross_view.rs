//! What the neighbours' own surfaces say of a plane: seen there, too, hanging in front of them, or hidden behind.
//!
//! Beside the photographs' agreement the second half of what two views know together; a wrong depth rarely lands on
//! the wrong depth of another view. Invariant: a plane that all views share is confirmed as surely as they are sure,
//! and a view that does not see the point says nothing.

use crate::cost_volume::warps;
use crate::ops::plane_sweep::Warp;
use crate::ops::propagate::soft;
use crate::seed::Seed;
use surfel_core::Camera;

/// Values said of a plane: confirmed, in front, behind; each in \[0, 1\].
pub(super) const SAID: usize = 3;

/// The seeds of all views and the way between them.
pub(super) struct CrossView<'a> {
    seeds: &'a [Seed],
    warps: Vec<Vec<Warp>>,
}

impl<'a> CrossView<'a> {
    pub(super) fn new(cameras: &[Camera], neighbours: &[Vec<usize>], seeds: &'a [Seed]) -> Self {
        Self { seeds, warps: warps(cameras, neighbours, 1) }
    }

    /// What the neighbours of `view` say of the point at pixel index `(x, y)` and inverse depth `w`, 1 / scene unit:
    /// how surely the best of them confirms it, and how surely, on average, it stands before or behind their
    /// surfaces.
    pub(super) fn of(&self, view: usize, x: usize, y: usize, w: f32) -> [f32; SAID] {
        let warps = &self.warps[view];
        let [mut confirmed, mut front, mut behind] = [0.0f32; SAID];
        for warp in warps {
            let Some((confidence, steps)) = self.seen(warp, [x as f32, y as f32, 1.0], w) else { continue };
            confirmed = confirmed.max(confidence / (1.0 + steps * steps));
            front += confidence * soft(steps).max(0.0);
            behind += confidence * soft(-steps).max(0.0);
        }
        let count = warps.len().max(1) as f32;
        [confirmed, front / count, behind / count]
    }

    /// Confidence of the surface at which a neighbour sees the point, and how many steps the point is before it.
    fn seen(&self, warp: &Warp, pixel: [f32; 3], w: f32) -> Option<(f32, f32)> {
        let dot = |row: &[f32; 3]| row.iter().zip(pixel).map(|(a, b)| a * b).sum::<f32>();
        let [u, v, z] = [0, 1, 2].map(|i| dot(&warp.rotation[i]) + warp.translation[i] * w);
        if z <= 0.0 {
            return None;
        }
        let (u, v, seed) = (u / z, v / z, &self.seeds[warp.other]);
        let (column, row) = (u.round(), v.round());
        let inside = |at: f32, len: usize| at >= 0.0 && at < len as f32;
        if !inside(column, seed.planes.width()) || !inside(row, seed.planes.height()) {
            return None;
        }
        let at = (column as usize, row as usize);
        let [own, own_x, own_y] = seed.planes[at];
        let surface = own + own_x * (u - column) + own_y * (v - row);
        // `z` is the neighbour's depth over this view's.
        Some((seed.confidence[at], (w / z - surface) / seed.step))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use surfel_core::{Grid, Intrinsics, Rigid};

    const SIZE: [usize; 2] = [40, 32];
    const STEP: f64 = 0.002;

    /// Two cameras before the plane `n . p = 5`, each knowing exactly what it sees of it.
    fn case() -> ([Camera; 2], Vec<Seed>) {
        let normal = DVec3::new(0.2, -0.1, 1.0);
        let camera = |angle: f64, x: f64| Camera {
            intrinsics: Intrinsics { fx: 60.0, fy: 62.0, cx: 20.3, cy: 15.2 },
            width: SIZE[0],
            height: SIZE[1],
            camera_from_world: Rigid::from_quat(DQuat::from_rotation_y(angle), DVec3::new(x, 0.05, -0.1)),
        };
        let cameras = [camera(0.0, 0.0), camera(0.1, -0.6)];
        let seed = |camera: &Camera| {
            let world_from_camera = camera.camera_from_world.inverse();
            let (origin, turned) = (world_from_camera.translation, world_from_camera.rotation.transpose() * normal);
            let w = |x: f64, y: f64| {
                let ray = camera.ray(glam::DVec2::new(x + 0.5, y + 0.5));
                turned.dot(ray / ray.z) / (5.0 - normal.dot(origin))
            };
            let plane = |x: usize, y: usize| {
                let (x, y) = (x as f64, y as f64);
                [w(x, y), w(x + 1.0, y) - w(x, y), w(x, y + 1.0) - w(x, y)].map(|value| value as f32)
            };
            Seed {
                planes: Grid::from_fn(SIZE[0], SIZE[1], plane),
                evidence: Grid::filled(SIZE[0], SIZE[1], [0.0; 2]),
                correlation: Grid::filled(SIZE[0], SIZE[1], 1.0),
                confidence: Grid::filled(SIZE[0], SIZE[1], 0.75),
                step: STEP as f32,
            }
        };
        let seeds = cameras.iter().map(seed).collect();
        (cameras, seeds)
    }

    #[test]
    fn a_shared_plane_is_confirmed_and_another_is_in_front_or_behind() {
        let (cameras, seeds) = case();
        let cross_view = CrossView::new(&cameras, &[vec![1], vec![0]], &seeds);
        for view in 0..2 {
            let (x, y) = (21, 14);
            let own = seeds[view].planes[(x, y)][0];
            let [confirmed, front, behind] = cross_view.of(view, x, y, own);
            assert!((confirmed - 0.75).abs() < 1e-3 && front < 1e-3 && behind < 1e-3, "{confirmed} {front} {behind}");
            let [near, front, none] = cross_view.of(view, x, y, own + 4.0 * STEP as f32);
            assert!(near < 0.2 && front > 0.3 && none == 0.0, "{near} {front} {none}");
            let [_, none, behind] = cross_view.of(view, x, y, own - 4.0 * STEP as f32);
            assert!(behind > 0.3 && none == 0.0, "{none} {behind}");
        }
    }

    #[test]
    fn a_view_that_does_not_see_the_point_says_nothing() {
        let (cameras, seeds) = case();
        let cross_view = CrossView::new(&cameras, &[vec![1], vec![0]], &seeds);
        assert_eq!(cross_view.of(0, 2, 14, 2.0), [0.0; SAID]);
    }
}
