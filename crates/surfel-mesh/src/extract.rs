//! Marching cubes over the sparse blocks: from the field to a triangle mesh (spec 6.2).
//!
//! Every crossed grid edge makes one vertex, owned by the block in which the edge starts, so cubes and blocks
//! share vertices through their edge and nothing is merged afterwards. Invariant: a cube makes triangles only
//! when all its eight corners are observed and none of its crossed edges is torn; the order of vertices and
//! triangles is that of the blocks, whatever the number of threads.
//!
//! A crossed edge is *torn* when its outside end is saturated at `+truncation`: free space seen by one view
//! then touches the band behind a surface seen by another, and the crossing is where knowledge ends, not
//! where matter does.

use crate::{
    Tsdf,
    allocate::{BLOCK, BLOCK_VOXELS},
    cases::{CASES, edge_corners},
    neighbourhood::Neighbourhood,
    vertex::{Vertex, vertex_on_edge},
};
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use surfel_core::TriMesh;

/// Slot of an edge that carries no vertex.
const NO_VERTEX: u16 = u16::MAX;

/// What one block contributes: the vertices on edges that start in it, and the cubes that start in it.
struct Patch {
    vertices: Vec<Vertex>,
    /// Index into `vertices` by `3 * voxel + axis`.
    slots: Vec<u16>,
    /// Cubes that cross the surface: base voxel and case.
    cubes: Vec<(IVec3, u8)>,
    neighbours: [Option<usize>; 27],
}

impl Tsdf<'_> {
    /// The zero surface as triangles with unit normals and colours, scene frame and units, wound
    /// counter-clockwise seen from the cameras' side. Empty when the field crosses zero nowhere.
    pub fn extract(&self) -> TriMesh {
        let patches: Vec<Option<Patch>> =
            (0..self.blocks.len()).into_par_iter().map(|block| patch_of(self, block)).collect();
        let mut num_vertices = 0;
        let first_vertex: Vec<usize> = patches
            .iter()
            .map(|patch| {
                let first = num_vertices;
                num_vertices += patch.as_ref().map_or(0, |patch| patch.vertices.len());
                first
            })
            .collect();
        let triangles: Vec<[u32; 3]> =
            patches.par_iter().flatten().flat_map_iter(|patch| triangles_of(patch, &patches, &first_vertex)).collect();
        let mut mesh = TriMesh { triangles, ..TriMesh::default() };
        for vertex in patches.iter().flatten().flat_map(|patch| &patch.vertices) {
            mesh.positions.push(vertex.position);
            mesh.normals.push(vertex.normal);
            mesh.colours.push(vertex.colour);
        }
        fill_missing_normals(&mut mesh);
        mesh
    }
}

fn patch_of(tsdf: &Tsdf<'_>, block: usize) -> Option<Patch> {
    let around = Neighbourhood::gather(tsdf, block)?;
    let mut slots = vec![NO_VERTEX; 3 * BLOCK_VOXELS];
    let mut cubes = Vec::new();
    // Cubes that start one voxel before the block also use its edges.
    for z in -1..BLOCK {
        for y in -1..BLOCK {
            for x in -1..BLOCK {
                let cube = IVec3::new(x, y, z);
                let Some(case) = case_of(&around, cube, tsdf.truncation) else {
                    continue;
                };
                for &edge in CASES[case as usize].iter().flatten() {
                    let (start, axis) = edge_start(cube, edge);
                    if inside_block(start) {
                        slots[3 * voxel_index(start) + axis] = 0;
                    }
                }
                if inside_block(cube) {
                    cubes.push((cube, case));
                }
            }
        }
    }
    let mut vertices = Vec::new();
    for (index, slot) in slots.iter_mut().enumerate().filter(|(_, slot)| **slot != NO_VERTEX) {
        *slot = vertices.len() as u16;
        let (voxel, axis) = ((index / 3) as i32, index % 3);
        let start = IVec3::new(voxel % BLOCK, voxel / BLOCK % BLOCK, voxel / (BLOCK * BLOCK));
        vertices.push(vertex_on_edge(tsdf, &around, tsdf.blocks[block] * BLOCK, start, axis));
    }
    (!vertices.is_empty() || !cubes.is_empty()).then_some(Patch {
        vertices,
        slots,
        cubes,
        neighbours: around.neighbours,
    })
}

/// Marching-cubes case of the cube at a local voxel; `None` when it makes no triangle.
fn case_of(around: &Neighbourhood, cube: IVec3, truncation: f32) -> Option<u8> {
    let corners = around.cube(cube);
    let mut case = 0;
    for (corner, value) in corners.iter().enumerate() {
        if value.is_nan() {
            return None;
        }
        case |= u8::from(*value < 0.0) << corner;
    }
    if case == 0 || case == 255 || is_torn(&corners, case, truncation) { None } else { Some(case) }
}

/// True when a crossed edge ends in saturated free space.
pub(crate) fn is_torn(corners: &[f32; 8], case: u8, truncation: f32) -> bool {
    // A mean of saturated values may differ from `truncation` by rounding.
    let saturated = truncation * (1.0 - 1e-5);
    CASES[case as usize].iter().flatten().any(|&edge| {
        let [a, b] = edge_corners(edge).map(|corner| corners[corner as usize]);
        a.max(b) >= saturated
    })
}

/// Local voxel where an edge of a cube starts, and its axis.
fn edge_start(cube: IVec3, edge: u8) -> (IVec3, usize) {
    let corner = i32::from(edge / 3);
    (cube + IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2), usize::from(edge % 3))
}

fn inside_block(voxel: IVec3) -> bool {
    voxel.min_element() >= 0 && voxel.max_element() < BLOCK
}

fn voxel_index(voxel: IVec3) -> usize {
    ((voxel.z * BLOCK + voxel.y) * BLOCK + voxel.x) as usize
}

fn triangles_of(patch: &Patch, patches: &[Option<Patch>], first_vertex: &[usize]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for &(cube, case) in &patch.cubes {
        for triangle in &CASES[case as usize] {
            triangles.push(triangle.map(|edge| {
                let (start, axis) = edge_start(cube, edge);
                let owner = start.div_euclid(IVec3::splat(BLOCK));
                let owner = patch.neighbours[Neighbourhood::neighbour(owner)].expect("all corners were observed");
                let slots = &patches[owner].as_ref().expect("a used edge makes its owner a patch").slots;
                let slot = slots[3 * voxel_index(start.rem_euclid(IVec3::splat(BLOCK))) + axis];
                (first_vertex[owner] + usize::from(slot)) as u32
            }));
        }
    }
    triangles
}

/// Gives vertices whose field gradient vanished the area-weighted normal of their triangles.
fn fill_missing_normals(mesh: &mut TriMesh) {
    let missing: Vec<bool> = mesh.normals.iter().map(|normal| *normal == [0.0; 3]).collect();
    if !missing.contains(&true) {
        return;
    }
    for index in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(index).map(Vec3::from);
        let area_normal = (b - a).cross(c - a);
        for vertex in mesh.triangles[index].map(|vertex| vertex as usize).into_iter().filter(|&v| missing[v]) {
            mesh.normals[vertex] = (Vec3::from(mesh.normals[vertex]) + area_normal).to_array();
        }
    }
    for (normal, _) in mesh.normals.iter_mut().zip(missing).filter(|(_, missing)| *missing) {
        *normal = Vec3::from(*normal).normalize_or(Vec3::Z).to_array();
    }
}
