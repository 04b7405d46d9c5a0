//! `mesh.glb`: the coloured mesh as binary glTF 2.0, for Blender, three.js and every phone.
//!
//! Vertices stay in data-set units and axes; the root node turns them Y up. Colours are linear, as glTF
//! demands, under one white two-sided material, without which Blender shows grey. Invariant: chunks are
//! 4-byte aligned and every accessor lies inside the binary chunk.

use super::error::unfit;
use super::{GENERATOR, PlacedMesh};
use glam::{DQuat, DVec3, Vec3};
use serde_json::{Value, json};
use std::io::{self, Write};

/// glTF axes (X right, Y up, Z towards the viewer) from OpenCV axes (X right, Y down, Z forward): half a
/// turn about X.
pub const GLTF_FROM_OPENCV: DQuat = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes a mesh whose scene frame `gltf_from_scene` turns Y up ([`GLTF_FROM_OPENCV`] when the scene is in
/// the frame of its first camera). Far from the origin the vertices are relative to the centre of the
/// mesh and a node carries the offset.
///
/// # Errors
/// When the mesh is inconsistent, has no triangle, is larger than 4 GiB, or `out` refuses.
pub fn write_glb(out: &mut impl Write, placed: &PlacedMesh, gltf_from_scene: DQuat) -> io::Result<()> {
    placed.check()?;
    let Some((low, high)) = placed.bounds().filter(|_| !placed.mesh.triangles.is_empty()) else {
        return Err(unfit("the mesh has no triangles, and glTF cannot hold an empty mesh"));
    };
    let origin = if placed.needs_double() { (low + high) / 2.0 } else { DVec3::ZERO };
    let (buffer, attributes, indices) = fill(placed, origin);

    let turn = gltf_from_scene.as_quat().normalize().to_array();
    let mut mesh_node = json!({"name": "mesh", "mesh": 0});
    if origin != DVec3::ZERO {
        mesh_node["translation"] = json!(origin.to_array());
    }
    let document = json!({
        "asset": {"version": "2.0", "generator": GENERATOR},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "gltf_from_scene", "rotation": turn, "children": [1]}, mesh_node],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0, "mode": 4}]}],
        "materials": [{
            "name": "vertex colours",
            "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorFactor": [1.0, 1.0, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
        }],
        "buffers": [{"byteLength": buffer.bytes.len()}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    });
    write_chunks(out, serde_json::to_vec(&document)?, buffer.bytes)
}

/// The binary chunk with the views and accessors that describe it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Appends one array, whose elements are multiples of 4 bytes, and returns its accessor.
    fn push(&mut self, bytes: &[u8], target: u32, mut accessor: Value) -> usize {
        self.views
            .push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len(), "target": target}));
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.bytes.extend_from_slice(bytes);
        self.accessors.len() - 1
    }
}

/// All arrays of the mesh, positions relative to `origin`; with the attribute table and the index accessor.
fn fill(placed: &PlacedMesh, origin: DVec3) -> (Buffer, Value, usize) {
    let mut buffer = Buffer::default();
    let count = placed.mesh.positions.len();
    let positions: Vec<Vec3> = placed.positions().map(|p| (p - origin).as_vec3()).collect();
    // The bounds of what is stored, after rounding: validators compare them exactly.
    let (min, max) = positions.iter().fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(*p), high.max(*p)));
    let accessor =
        json!({"componentType": FLOAT, "type": "VEC3", "count": count, "min": min.to_array(), "max": max.to_array()});
    let mut attributes =
        json!({"POSITION": buffer.push(&little_endian(positions.into_iter()), ARRAY_BUFFER, accessor)});

    if !placed.mesh.normals.is_empty() {
        let accessor = json!({"componentType": FLOAT, "type": "VEC3", "count": count});
        attributes["NORMAL"] = json!(buffer.push(&little_endian(placed.normals()), ARRAY_BUFFER, accessor));
    }
    if !placed.mesh.colours.is_empty() {
        let linear: [u16; 256] =
            std::array::from_fn(|byte| (linear_from_srgb(byte as f64 / 255.0) * 65535.0).round() as u16);
        let rgba = |c: &[u8; 3]| [linear[c[0] as usize], linear[c[1] as usize], linear[c[2] as usize], u16::MAX];
        let bytes: Vec<u8> = placed.mesh.colours.iter().flat_map(rgba).flat_map(u16::to_le_bytes).collect();
        let accessor = json!({"componentType": UNSIGNED_SHORT, "normalized": true, "type": "VEC4", "count": count});
        attributes["COLOR_0"] = json!(buffer.push(&bytes, ARRAY_BUFFER, accessor));
    }
    let bytes: Vec<u8> = placed.mesh.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let accessor = json!({"componentType": UNSIGNED_INT, "type": "SCALAR", "count": 3 * placed.mesh.triangles.len()});
    let indices = buffer.push(&bytes, ELEMENT_ARRAY_BUFFER, accessor);
    (buffer, attributes, indices)
}

fn little_endian(vectors: impl Iterator<Item = Vec3>) -> Vec<u8> {
    vectors.flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect()
}

/// IEC 61966-2-1.
fn linear_from_srgb(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn write_chunks(out: &mut impl Write, mut document: Vec<u8>, mut binary: Vec<u8>) -> io::Result<()> {
    document.resize(document.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length =
        |bytes: usize| u32::try_from(bytes).map_err(|_| unfit("the mesh is larger than the 4 GiB a GLB file can hold"));
    let total = length(12 + 8 + document.len() + 8 + binary.len())?;
    out.write_all(b"glTF")?;
    for word in [2, total, length(document.len())?] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(b"JSON")?;
    out.write_all(&document)?;
    out.write_all(&length(binary.len())?.to_le_bytes())?;
    out.write_all(b"BIN\0")?;
    out.write_all(&binary)
}
