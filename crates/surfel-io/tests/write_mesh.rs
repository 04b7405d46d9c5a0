//! Meshes read back: PLY byte by byte, GLB by the `gltf` crate, OBJ line by line.

use glam::{DMat3, DQuat, DVec3, Quat, Vec3};
use gltf::Semantic;
use surfel_core::{Similarity, TriMesh};
use surfel_io::write::PlacedMesh;
use surfel_io::write::glb::{GLTF_FROM_OPENCV, write_glb};
use surfel_io::write::obj::write_obj;
use surfel_io::write::ply_mesh::write_ply_mesh;

fn tetrahedron() -> TriMesh {
    TriMesh {
        positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]],
        normals: vec![[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        colours: vec![[255, 0, 128], [0, 255, 0], [10, 20, 30], [188, 188, 188]],
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    }
}

fn scene_in_map_coordinates() -> Similarity {
    Similarity {
        scale: 2.5,
        rotation: DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 0.2)),
        translation: DVec3::new(453_000.25, 5_412_345.125, 300.5),
    }
}

fn ply(placed: &PlacedMesh) -> (String, Vec<u8>) {
    let mut bytes = Vec::new();
    write_ply_mesh(&mut bytes, placed, &["frame: first camera\nunit: mm"]).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    (String::from_utf8(bytes[..end].to_vec()).unwrap(), bytes[end..].to_vec())
}

fn f32_at(bytes: &[u8], offset: usize) -> f32 {
    f32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap())
}

fn f64_at(bytes: &[u8], offset: usize) -> f64 {
    f64::from_le_bytes(bytes[offset..offset + 8].try_into().unwrap())
}

#[test]
fn ply_header_and_bytes() {
    let mesh = tetrahedron();
    let (header, body) = ply(&PlacedMesh::in_scene(&mesh));
    let expected = format!(
        "ply\nformat binary_little_endian 1.0\ncomment surfelsplat {}\ncomment frame: first camera\ncomment unit: mm\n\
         element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face 4\nproperty list uchar int vertex_indices\nend_header\n",
        env!("CARGO_PKG_VERSION")
    );
    assert_eq!(header, expected);
    assert_eq!(body.len(), 4 * (24 + 3) + 4 * 13);
    let third = &body[2 * 27..3 * 27];
    assert_eq!([f32_at(third, 0), f32_at(third, 4), f32_at(third, 8)], mesh.positions[2]);
    assert_eq!([f32_at(third, 12), f32_at(third, 16), f32_at(third, 20)], mesh.normals[2]);
    assert_eq!(third[24..], [10, 20, 30]);
    assert_eq!(body[4 * 27..4 * 27 + 13], [3, 0, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0]);
}

#[test]
fn ply_far_from_the_origin_keeps_its_detail_in_doubles() {
    let mesh = tetrahedron();
    let placed = PlacedMesh { mesh: &mesh, scene_from_mesh: scene_in_map_coordinates() };
    let (header, body) = ply(&placed);
    assert!(header.contains("property double x\nproperty double y\nproperty double z\nproperty float nx\n"));
    let vertices = body.chunks(24 + 12 + 3).take(4).map(|v| DVec3::new(f64_at(v, 0), f64_at(v, 8), f64_at(v, 16)));
    let vertices: Vec<DVec3> = vertices.collect();
    for (i, length) in [(1, 1.0), (2, 2.0), (3, 3.0)] {
        assert!((vertices[i].distance(vertices[0]) - 2.5 * length).abs() < 1e-8);
    }
}

#[test]
fn ply_without_normals_and_colours_has_no_such_properties() {
    let mesh = TriMesh { normals: vec![], colours: vec![], ..tetrahedron() };
    let (header, body) = ply(&PlacedMesh::in_scene(&mesh));
    assert!(!header.contains("nx") && !header.contains("red"));
    assert_eq!(body.len(), 4 * 12 + 4 * 13);
}

#[test]
fn obj_counts_from_one_and_colours_from_zero_to_one() {
    let mut text = Vec::new();
    write_obj(&mut text, &PlacedMesh::in_scene(&tetrahedron()), &["unit: mm"]).unwrap();
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("\n# unit: mm\nv 0 0 0 1.0000 0.0000 0.5020\n"));
    assert!(text.contains("\nvn 0.00000 1.00000 0.00000\n"));
    assert!(text.contains("\nf 1//1 3//3 2//2\n"));
}

/// World position, world normal and linear colour per vertex, and the indices, through the node tree.
fn read_glb(bytes: &[u8]) -> (Vec<DVec3>, Vec<Vec3>, Vec<[f32; 4]>, Vec<u32>) {
    let glb = gltf::Gltf::from_slice(bytes).unwrap();
    let blob = glb.blob.clone().unwrap();
    let root = glb.default_scene().unwrap().nodes().next().unwrap();
    let turn = Quat::from_array(root.transform().decomposed().1);
    let node = root.children().next().unwrap();
    let offset = DVec3::from(node.transform().decomposed().0.map(f64::from));
    let mesh = node.mesh().unwrap();
    let primitive = mesh.primitives().next().unwrap();
    let reader = primitive.reader(|_| Some(&blob));
    let positions = reader.read_positions().unwrap();
    (
        positions.map(|p| turn.as_dquat() * (Vec3::from(p).as_dvec3() + offset)).collect(),
        reader.read_normals().unwrap().map(|n| turn * Vec3::from(n)).collect(),
        reader.read_colors(0).unwrap().into_rgba_f32().collect(),
        reader.read_indices().unwrap().into_u32().collect(),
    )
}

fn glb(placed: &PlacedMesh) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_glb(&mut bytes, placed, GLTF_FROM_OPENCV).unwrap();
    bytes
}

#[test]
fn glb_stands_upright_with_linear_colours() {
    let mesh = tetrahedron();
    let (positions, normals, colours, indices) = read_glb(&glb(&PlacedMesh::in_scene(&mesh)));
    // OpenCV (0, 2, 0) is below the camera, (0, 0, 3) before it: glTF says -Y and -Z.
    assert!(positions[2].abs_diff_eq(DVec3::new(0.0, -2.0, 0.0), 1e-6));
    assert!(positions[3].abs_diff_eq(DVec3::new(0.0, 0.0, -3.0), 1e-6));
    assert!(normals[2].abs_diff_eq(Vec3::NEG_Y, 1e-6));
    assert_eq!(colours[1], [0.0, 1.0, 0.0, 1.0]);
    // sRGB 188 is half the light.
    assert!((colours[3][0] - 0.502_886).abs() < 1e-4 && (colours[0][2] - 0.215_861).abs() < 1e-4);
    assert_eq!(indices, mesh.triangles.concat());
}

#[test]
fn glb_follows_the_container_rules() {
    for num_triangles in [3, 4] {
        let mut mesh = tetrahedron();
        mesh.triangles.truncate(num_triangles);
        let bytes = glb(&PlacedMesh::in_scene(&mesh));
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        let json_length = word(12);
        assert_eq!((json_length % 4, &bytes[16..20]), (0, &b"JSON"[..]));
        let binary = 20 + json_length;
        assert_eq!((word(binary) % 4, &bytes[binary + 4..binary + 8]), (0, &b"BIN\0"[..]));
        assert_eq!(binary + 8 + word(binary), bytes.len());

        let glb = gltf::Gltf::from_slice(&bytes).unwrap();
        assert!(glb.views().all(|view| view.offset() % 4 == 0 && view.offset() + view.length() <= word(binary)));
        let mesh = glb.meshes().next().unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let bounds = primitive.bounding_box();
        assert_eq!((bounds.min, bounds.max), ([0.0; 3], [1.0, 2.0, 3.0]));
        assert_eq!(primitive.get(&Semantic::Positions).unwrap().count(), 4);
        assert_eq!(primitive.indices().unwrap().count(), 3 * num_triangles);
        let material = primitive.material();
        let pbr = material.pbr_metallic_roughness();
        assert!(material.double_sided() && pbr.base_color_factor() == [1.0; 4]);
        assert_eq!((pbr.metallic_factor(), pbr.roughness_factor()), (0.0, 1.0));
    }
}

#[test]
fn glb_far_from_the_origin_keeps_its_detail() {
    let mesh = tetrahedron();
    let placed = PlacedMesh { mesh: &mesh, scene_from_mesh: scene_in_map_coordinates() };
    let (positions, ..) = read_glb(&glb(&placed));
    let expected: Vec<DVec3> = placed.positions().map(|p| GLTF_FROM_OPENCV * p).collect();
    for i in 1..4 {
        let (edge, true_edge) = (positions[i] - positions[0], expected[i] - expected[0]);
        assert!(edge.abs_diff_eq(true_edge, 1e-5), "{edge} instead of {true_edge}");
    }
    // The crate reads the offset as f32; half a unit at five million.
    assert!(positions[0].abs_diff_eq(expected[0], 0.6));
}

#[test]
fn glb_of_nothing_is_refused_with_a_sentence() {
    let mesh = TriMesh::default();
    let error = write_glb(&mut Vec::new(), &PlacedMesh::in_scene(&mesh), GLTF_FROM_OPENCV).unwrap_err();
    assert!(error.to_string().contains("no triangles"));
}
