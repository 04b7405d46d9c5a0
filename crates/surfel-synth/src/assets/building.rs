//! A building: four walls with windows that lie deep in them, ledges and pilasters before them, a roof on top.
//!
//! Millimetres, in a frame of its own: the front runs from the origin along +X and looks towards -Y, +Z is up.
//! Invariant: what is drawn is geometry; windows are holes with panes behind, not pictures of windows.

use super::error::AssetError;
use super::instance::Instance;
use super::library::AssetLibrary;
use super::masonry::{Masonry, Side};
use super::plot::Plot;
use super::stone::{PaintBySize, glass_paint, masonry_paint};
use crate::random::Random;
use glam::{Vec2, Vec3};

/// What all walls of a building have in common, millimetres.
struct Style {
    storeys: usize,
    storey: f32,
    bay: f32,
    window: Vec2,
    /// Height of the lower edge of a window above its floor.
    sill: f32,
    /// How deep the panes lie.
    inset: f32,
    /// How far the frames of the windows stand out, and how broad they are; 0 for none.
    frame: Vec2,
    /// How far ledges stand out; 0 for none.
    ledge: f32,
    /// How far pilasters stand out; 0 for none.
    pilaster: f32,
    /// Bars in a window, upright and level.
    bars: [usize; 2],
    /// Share of bays without a window.
    blank: f64,
}

/// Builds on a plot: walls, panes and roof.
pub(super) fn build(library: &AssetLibrary, plot: &Plot, random: &mut Random) -> Result<Vec<Instance>, AssetError> {
    let style = Style::draw(random);
    let (width, depth) = (plot.width as f32, plot.depth as f32);
    let (mut walls, mut panes, mut roof) = (Masonry::default(), Masonry::default(), Masonry::default());
    let [right, back] = [Vec3::X * width, Vec3::Y * depth];
    let sides = [
        (Side::FRONT, width),
        (Side { corner: right, right: Vec3::Y, out: Vec3::X }, depth),
        (Side { corner: right + back, right: Vec3::NEG_X, out: Vec3::Y }, width),
        (Side { corner: back, right: Vec3::NEG_Y, out: Vec3::NEG_X }, depth),
    ];
    for (side, length) in &sides {
        raise(&style, side, *length, &mut walls, &mut panes, random);
    }
    cover(&style, Vec2::new(width, depth), &mut roof, random);
    let tile = random.range(1200.0, 4000.0);
    let wall_paint = masonry_paint(library, tile, random)?;
    let roof_paint = masonry_paint(library, random.range(1000.0, 3000.0), random)?;
    let glass = glass_paint(random);
    let shine = random.range(0.03, 0.15) as f32;
    let place = |masonry: Masonry, paint: PaintBySize| masonry.stand(plot.corner, plot.heading, paint);
    let panes = place(panes, glass).map(|panes| Instance { gloss: shine, shininess: 60.0, ..panes });
    Ok([place(walls, wall_paint), panes, place(roof, roof_paint)].into_iter().flatten().collect())
}

impl Style {
    fn draw(random: &mut Random) -> Self {
        let mut range = |low: f64, high: f64| random.range(low, high) as f32;
        let (storey, bay) = (range(2800.0, 4500.0), range(2000.0, 4500.0));
        let window = Vec2::new(bay * range(0.3, 0.6), storey * range(0.4, 0.65));
        let sill = (storey - window.y) * range(0.3, 0.7);
        let (inset, frame) = (range(60.0, 350.0), Vec2::new(range(20.0, 150.0), range(80.0, 220.0)));
        let (ledge, pilaster) = (range(60.0, 300.0), range(60.0, 350.0));
        Self {
            storeys: 1 + random.below(4),
            storey,
            bay,
            window,
            sill,
            inset,
            frame: if random.chance(0.6) { frame } else { Vec2::ZERO },
            ledge: if random.chance(0.6) { ledge } else { 0.0 },
            pilaster: if random.chance(0.35) { pilaster } else { 0.0 },
            bars: [random.below(3), random.below(4)],
            blank: random.range(0.0, 0.25),
        }
    }

    fn height(&self) -> f32 {
        self.storey * self.storeys as f32
    }
}

/// One wall: its bays and storeys, then what runs along and up it.
fn raise(style: &Style, side: &Side, length: f32, walls: &mut Masonry, panes: &mut Masonry, random: &mut Random) {
    let bays = (length / style.bay).round().max(1.0) as usize;
    let bay = length / bays as f32;
    for storey in 0..style.storeys {
        for i in 0..bays {
            let (along, floor) = ([i as f32 * bay, (i + 1) as f32 * bay], storey as f32 * style.storey);
            let is_door = storey == 0 && random.chance(0.2);
            let hole = Hole::in_bay(style, along, floor, is_door);
            wall(style, side, along, floor, &hole, walls);
            if random.chance(style.blank) {
                walls.sheet(side, hole.along, hole.upright, 0.0);
            } else {
                window(style, side, &hole, is_door, walls, panes);
            }
        }
        if style.ledge > 0.0 && storey > 0 {
            let up = storey as f32 * style.storey;
            walls.block(side, [-style.ledge, length + style.ledge], [0.0, style.ledge], [up, up + 0.8 * style.ledge]);
        }
    }
    if style.pilaster > 0.0 {
        let half = 0.5 * (0.5 * (bay - style.window.x)).min(600.0);
        for i in 0..=bays {
            let middle = (i as f32 * bay).clamp(half, length - half);
            walls.block(side, [middle - half, middle + half], [0.0, style.pilaster], [0.0, style.height()]);
        }
    }
}

/// Where a window or a door is.
struct Hole {
    along: [f32; 2],
    upright: [f32; 2],
}

impl Hole {
    fn in_bay(style: &Style, [left, right]: [f32; 2], floor: f32, is_door: bool) -> Self {
        let middle = 0.5 * (left + right);
        let half = 0.5 * style.window.x.min(0.8 * (right - left));
        let low = if is_door { floor } else { floor + style.sill };
        Self { along: [middle - half, middle + half], upright: [low, floor + style.sill + style.window.y] }
    }
}

/// The wall of a bay around its hole. Cut along the hole's edges both ways: light is measured at corners, and those
/// under ledges and pilasters see none.
fn wall(style: &Style, side: &Side, [left, right]: [f32; 2], floor: f32, hole: &Hole, walls: &mut Masonry) {
    let columns = [left, hole.along[0], hole.along[1], right];
    let rows = [floor, hole.upright[0], hole.upright[1], floor + style.storey];
    for (i, column) in columns.windows(2).enumerate() {
        for (_, row) in rows.windows(2).enumerate().filter(|(j, _)| (i, *j) != (1, 1)) {
            walls.sheet(side, [column[0], column[1]], [row[0], row[1]], 0.0);
        }
    }
}

/// What is in a hole and around it: reveals, pane, bars, frame.
fn window(style: &Style, side: &Side, hole: &Hole, is_door: bool, walls: &mut Masonry, panes: &mut Masonry) {
    let Hole { along: [left, right], upright: [bottom, top] } = *hole;
    let back = -style.inset;
    for u in hole.along {
        walls.quad([(back, bottom), (0.0, bottom), (0.0, top), (back, top)].map(|(out, z)| side.at(u, out, z)));
    }
    for z in hole.upright {
        walls.quad([(left, back), (right, back), (right, 0.0), (left, 0.0)].map(|(u, out)| side.at(u, out, z)));
    }
    panes.sheet(side, hole.along, hole.upright, back);
    let bar = [back, back + 40.0];
    for i in 1..=style.bars[0] {
        let u = left + (right - left) * i as f32 / (style.bars[0] + 1) as f32;
        walls.block(side, [u - 30.0, u + 30.0], bar, hole.upright);
    }
    for i in 1..=style.bars[1] {
        let z = bottom + (top - bottom) * i as f32 / (style.bars[1] + 1) as f32;
        walls.block(side, hole.along, bar, [z - 30.0, z + 30.0]);
    }
    if style.frame.x > 0.0 {
        let ([out, broad], across) = (style.frame.to_array(), [left - style.frame.y, right + style.frame.y]);
        walls.block(side, [across[0], left], [0.0, out], hole.upright);
        walls.block(side, [right, across[1]], [0.0, out], hole.upright);
        walls.block(side, across, [0.0, out], [top, top + broad]);
        if !is_door {
            // The sill stands out farther than the rest.
            walls.block(side, across, [0.0, 1.5 * out], [bottom - 0.7 * broad, bottom]);
        }
    }
}

/// The roof: a ridge along the front with chimneys, or a flat one with a parapet.
fn cover(style: &Style, size: Vec2, roof: &mut Masonry, random: &mut Random) {
    let (eaves, over) = (style.height(), random.range(150.0, 600.0) as f32);
    let front = Side::FRONT;
    let across = [-over, size.x + over];
    if random.chance(0.3) {
        let parapet = random.range(200.0, 900.0) as f32;
        roof.block(&front, across, [-size.y - over, over], [eaves, eaves + parapet]);
        return;
    }
    let rise = size.y * random.range(0.25, 0.6) as f32;
    let ridge = eaves + rise;
    // Hipped roofs end before the walls do, gabled ones with them.
    let short = if random.chance(0.5) { 0.45 * size.y.min(size.x) } else { 0.0 };
    let (left, right) = (across[0] + short, across[1] - short);
    for (out, away) in [(over, -0.5 * size.y), (-size.y - over, -0.5 * size.y)] {
        roof.quad([
            front.at(across[0], out, eaves),
            front.at(across[1], out, eaves),
            front.at(right, away, ridge),
            front.at(left, away, ridge),
        ]);
    }
    for (end, top) in [(across[0], left), (across[1], right)] {
        let tip = front.at(top, -0.5 * size.y, ridge);
        roof.quad([front.at(end, over, eaves), front.at(end, -size.y - over, eaves), tip, tip]);
    }
    // The cornice under the eaves hides where roof and walls meet.
    roof.block(&front, across, [-size.y - over, over], [eaves - 0.4 * over, eaves]);
    for _ in 0..random.below(4) {
        let (u, out) = (size.x * random.range(0.1, 0.9) as f32, -size.y * random.range(0.3, 0.7) as f32);
        let (half, top) = (random.range(250.0, 600.0) as f32, ridge + random.range(300.0, 1500.0) as f32);
        roof.block(&front, [u - half, u + half], [out - half, out + half], [eaves, top]);
    }
}
