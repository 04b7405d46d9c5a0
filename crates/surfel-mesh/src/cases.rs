//! The 256 cases of marching cubes (Lorensen and Cline 1987), derived from one rule instead of listed.
//!
//! Rule: walking around a face of the cube, every run of inside corners is cut off by one segment. It looks
//! at that face alone, so two cubes always agree on the face they share and the surface has no cracks; the
//! published tables that mirror ambiguous cases do not have this property. Invariant: triangles are
//! counter-clockwise seen from the outside corners.
//!
//! Corner `c` of a cube is at `(c & 1, c >> 1 & 1, c >> 2)`; an edge is coded `3 * corner + axis`, from the
//! corner where it starts along that axis.

use std::sync::LazyLock;

/// Edge codes of the corners of one triangle.
pub(crate) type CaseTriangle = [u8; 3];

/// Triangles by case; bit `c` of the case is set when corner `c` is inside (negative).
pub(crate) static CASES: LazyLock<Vec<Vec<CaseTriangle>>> = LazyLock::new(|| (0..=255).map(triangles_of).collect());

/// The corners of the six faces, counter-clockwise seen from outside the cube.
const FACES: [[u8; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

/// One more than the largest edge code.
pub(crate) const NUM_EDGE_CODES: usize = 24;

/// The two corners joined by an edge.
pub(crate) fn edge_corners(edge: u8) -> [u8; 2] {
    let (corner, axis) = (edge / 3, edge % 3);
    [corner, corner | 1 << axis]
}

fn edge_between(a: u8, b: u8) -> u8 {
    3 * a.min(b) + (a ^ b).trailing_zeros() as u8
}

fn triangles_of(case: u8) -> Vec<CaseTriangle> {
    loops_of(case).iter().flat_map(|edges| triangulate(edges)).collect()
}

/// Closed loops of crossed edges.
fn loops_of(case: u8) -> Vec<Vec<u8>> {
    let inside = |corner: u8| case >> corner & 1 == 1;
    let mut next = [None; NUM_EDGE_CODES];
    for face in FACES {
        for start in 0..4 {
            let corner = |step: usize| face[(start + step) % 4];
            if inside(corner(0)) || !inside(corner(1)) {
                continue;
            }
            // The run of inside corners entered here ends at the first step back out.
            let end = (1..4).find(|&step| inside(corner(step)) && !inside(corner(step + 1)));
            let end = end.expect("a face with an outside corner has an end to each inside run");
            next[edge_between(corner(0), corner(1)) as usize] = Some(edge_between(corner(end), corner(end + 1)));
        }
    }
    let mut loops = Vec::new();
    for first in 0..NUM_EDGE_CODES {
        let mut edges = Vec::new();
        let mut edge = first;
        while let Some(following) = next[edge].take() {
            edges.push(edge as u8);
            edge = following as usize;
        }
        if !edges.is_empty() {
            loops.push(edges);
        }
    }
    loops
}

/// Cuts a loop into triangles with as few diagonals as possible inside a face of the cube, where the
/// neighbouring cube might place the same diagonal.
fn triangulate(edges: &[u8]) -> Vec<CaseTriangle> {
    let fan = |apex: usize| -> Vec<CaseTriangle> {
        let at = |step: usize| edges[(apex + step) % edges.len()];
        (1..edges.len() - 1).map(|step| [at(0), at(step), at(step + 1)]).collect()
    };
    let flat_diagonals = |apex: &usize| {
        let at = |step: usize| edges[(apex + step) % edges.len()];
        (2..edges.len() - 1).filter(|&step| share_a_face(at(0), at(step))).count()
    };
    fan((0..edges.len()).min_by_key(flat_diagonals).unwrap_or(0))
}

fn share_a_face(a: u8, b: u8) -> bool {
    FACES.iter().any(|face| [a, b].iter().all(|&edge| edge_corners(edge).iter().all(|corner| face.contains(corner))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Segments that the triangles of a case leave open, by face.
    fn open_segments(case: usize) -> BTreeMap<(u8, u8), i32> {
        let mut segments = BTreeMap::new();
        for [a, b, c] in &CASES[case] {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *segments.entry((*from.min(to), *from.max(to))).or_insert(0) += if from < to { 1 } else { -1 };
            }
        }
        segments.retain(|_, count| *count != 0);
        segments
    }

    #[test]
    fn every_crossed_edge_is_used_and_no_other() {
        for case in 0..256usize {
            for corner in 0..8u8 {
                for axis in 0..3u8 {
                    if corner >> axis & 1 == 1 {
                        continue;
                    }
                    let [a, b] = edge_corners(3 * corner + axis);
                    let crossed = (case >> a & 1) != (case >> b & 1);
                    let used = CASES[case].iter().flatten().any(|&edge| edge == 3 * corner + axis);
                    assert_eq!(crossed, used, "case {case} edge {corner}+{axis}");
                }
            }
        }
    }

    #[test]
    fn open_border_lies_in_the_faces_and_depends_on_each_face_alone() {
        let mut by_face: BTreeMap<(usize, Vec<bool>), Vec<((u8, u8), i32)>> = BTreeMap::new();
        for case in 0..256usize {
            let segments = open_segments(case);
            let mut found = 0;
            for (index, face) in FACES.iter().enumerate() {
                let in_face = |edge: u8| edge_corners(edge).iter().all(|corner| face.contains(corner));
                let on_face: Vec<_> =
                    segments.iter().filter(|((a, b), _)| in_face(*a) && in_face(*b)).map(|(k, v)| (*k, *v)).collect();
                found += on_face.len();
                let signs = face.iter().map(|&corner| case >> corner & 1 == 1).collect();
                let first = by_face.entry((index, signs)).or_insert_with(|| on_face.clone());
                assert_eq!(*first, on_face, "case {case} face {index}");
            }
            assert_eq!(found, segments.len(), "case {case} is open inside the cube");
        }
    }

    #[test]
    fn no_diagonal_lies_in_a_face() {
        for case in 0..256usize {
            let border = open_segments(case);
            for [a, b, c] in &CASES[case] {
                for (a, b) in [(a, b), (b, c), (c, a)] {
                    let diagonal = !border.contains_key(&(*a.min(b), *a.max(b)));
                    assert!(!diagonal || !share_a_face(*a, *b), "case {case}: {a}-{b}");
                }
            }
        }
    }

    #[test]
    fn one_inside_corner_faces_away_from_it() {
        assert_eq!(CASES[1].len(), 1);
        let mut triangle = CASES[1][0];
        let lowest = triangle.iter().position(|&edge| edge == 0).unwrap();
        triangle.rotate_left(lowest);
        assert_eq!(triangle, [0, 1, 2]);
        assert!(CASES[0].is_empty() && CASES[255].is_empty());
    }
}
