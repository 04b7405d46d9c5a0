//! The pinhole camera that a distorted photograph is turned into.
//!
//! It sees as much of the photograph as is sensible: the bounding box of the undistorted border, shrunk
//! towards the largest box without blanks until at most [`MAX_BLANK`] of it is blank and each side spans
//! less than 120°. Invariant: the focal lengths stay, so the centre of the picture keeps its resolution.

use crate::scene::Frame;
use glam::DVec2;
use surfel_core::{Camera, Intrinsics};

/// Largest part of the pinhole image that may show nothing.
const MAX_BLANK: f64 = 0.25;
/// tan(60°): half of the widest field of view.
const MAX_SLOPE: f64 = 1.732_050_807_568_877_2;
/// Border samples per side, and samples per axis when measuring the blank part.
const BORDER_SAMPLES: usize = 64;
const AREA_SAMPLES: usize = 48;

impl Frame {
    /// The undistorted camera at full resolution; [`Frame::load`] returns it resized.
    ///
    /// For a photograph without distortion this is the camera as stated; otherwise its width and height
    /// differ from the photograph's, as it covers the undistorted field of view.
    pub fn pinhole(&self) -> Camera {
        let camera = Camera {
            intrinsics: self.intrinsics,
            width: self.width,
            height: self.height,
            camera_from_world: self.camera_from_world,
        };
        if self.lens.is_none() {
            return camera;
        }
        let field = Field { frame: self, radius: self.lens.radius_of_validity() };
        let k = self.intrinsics;
        let Slopes { low, high } = field.covered();
        let length = |extent: f64| (extent.round() as usize).max(1);
        let (width, height) = (length((high.x - low.x) * k.fx), length((high.y - low.y) * k.fy));
        let intrinsics = Intrinsics { cx: -low.x * k.fx, cy: -low.y * k.fy, ..k };
        Camera { intrinsics, width, height, ..camera }
    }

    /// Continuous pixel in the photograph of a pinhole slope `(x/z, y/z)`; `None` where it shows nothing.
    pub(super) fn source_pixel(&self, slope: DVec2, radius_of_validity: f64) -> Option<DVec2> {
        if slope.length() > radius_of_validity {
            return None;
        }
        let (k, bent) = (self.intrinsics, self.lens.distort(slope));
        let pixel = DVec2::new(k.fx * bent.x + k.cx, k.fy * bent.y + k.cy);
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x <= self.width as f64 && pixel.y <= self.height as f64;
        inside.then_some(pixel)
    }
}

/// A box of pinhole slopes.
#[derive(Clone, Copy, Debug)]
struct Slopes {
    low: DVec2,
    high: DVec2,
}

/// What a photograph sees through its lens.
struct Field<'a> {
    frame: &'a Frame,
    radius: f64,
}

impl Field<'_> {
    fn covered(&self) -> Slopes {
        let (outer, inner) = self.boxes();
        let blend = |t: f64| Slopes { low: inner.low.lerp(outer.low, t), high: inner.high.lerp(outer.high, t) };
        if self.blank(outer) <= MAX_BLANK {
            return outer;
        }
        let (mut good, mut bad) = (0.0, 1.0);
        for _ in 0..20 {
            let middle = 0.5 * (good + bad);
            if self.blank(blend(middle)) <= MAX_BLANK { good = middle } else { bad = middle }
        }
        blend(good)
    }

    /// The bounding box of the border, and the box that every side of the border leaves free.
    fn boxes(&self) -> (Slopes, Slopes) {
        let (w, h) = (self.frame.width as f64, self.frame.height as f64);
        let along = |a: DVec2, b: DVec2| {
            let samples = (0..=BORDER_SAMPLES).map(move |i| a.lerp(b, i as f64 / BORDER_SAMPLES as f64));
            samples.map(|pixel| self.slope(pixel)).collect::<Vec<DVec2>>()
        };
        let corners = [DVec2::ZERO, DVec2::new(w, 0.0), DVec2::new(w, h), DVec2::new(0.0, h)];
        let [top, right, bottom, left] = std::array::from_fn(|i| along(corners[i], corners[(i + 1) % 4]));
        let smallest = |side: &[DVec2], of: fn(&DVec2) -> f64| side.iter().map(of).fold(f64::INFINITY, f64::min);
        let largest = |side: &[DVec2], of: fn(&DVec2) -> f64| side.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        let (x, y): (fn(&DVec2) -> f64, fn(&DVec2) -> f64) = (|p| p.x, |p| p.y);
        let border = [top.as_slice(), &right, &bottom, &left].concat();
        let outer = Slopes {
            low: DVec2::new(smallest(&border, x), smallest(&border, y)),
            high: DVec2::new(largest(&border, x), largest(&border, y)),
        };
        let inner = Slopes {
            low: DVec2::new(largest(&left, x), largest(&top, y)),
            high: DVec2::new(smallest(&right, x), smallest(&bottom, y)),
        };
        // A principal point outside the picture, or a fold, can turn the inner box inside out.
        let usable = inner.low.cmplt(inner.high).all();
        let middle = 0.5 * (outer.low + outer.high);
        let inner = if usable {
            inner
        } else {
            Slopes { low: middle.lerp(outer.low, 0.2), high: middle.lerp(outer.high, 0.2) }
        };
        (outer, inner)
    }

    /// Pinhole slope of a border pixel; where the lens has none, of the outermost point towards it that has.
    fn slope(&self, pixel: DVec2) -> DVec2 {
        let k = self.frame.intrinsics;
        let sensor = DVec2::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy);
        let undistort = |t: f64| self.frame.lens.undistort(sensor * t);
        let slope = undistort(1.0).unwrap_or_else(|| {
            let (mut good, mut bad) = (0.0, 1.0);
            for _ in 0..30 {
                let middle = 0.5 * (good + bad);
                if undistort(middle).is_some() { good = middle } else { bad = middle }
            }
            undistort(good).unwrap_or(DVec2::ZERO)
        });
        slope.clamp(DVec2::splat(-MAX_SLOPE), DVec2::splat(MAX_SLOPE))
    }

    /// The part of a box that shows nothing of the photograph.
    fn blank(&self, slopes: Slopes) -> f64 {
        let at = |x: usize, y: usize| {
            let part = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) / AREA_SAMPLES as f64;
            slopes.low + (slopes.high - slopes.low) * part
        };
        let cells = (0..AREA_SAMPLES).flat_map(|y| (0..AREA_SAMPLES).map(move |x| (x, y)));
        let blank = cells.filter(|&(x, y)| self.frame.source_pixel(at(x, y), self.radius).is_none()).count();
        blank as f64 / (AREA_SAMPLES * AREA_SAMPLES) as f64
    }
}
