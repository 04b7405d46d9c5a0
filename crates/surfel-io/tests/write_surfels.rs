//! The splat PLY: its property list, its round trip, and the frame change on the way out.

use glam::{DMat3, DQuat, DVec3, Quat, Vec3};
use proptest::prelude::*;
use surfel_core::{Similarity, Surfels, sh};
use surfel_io::write::ply_surfels::{SplatLayout, write_surfels_ply};
use surfel_io::write::surfels_from_ply::{SurfelFile, read_surfels_ply};

fn some_surfels(num: usize, sh_degree: usize) -> Surfels {
    let wave = |k: usize, i: usize| ((k * 31 + i * 17) as f32 * 0.7).sin();
    let unit = |k: usize| Quat::from_euler(glam::EulerRot::XYZ, wave(k, 1), 2.0 * wave(k, 2), wave(k, 3));
    Surfels {
        centres: (0..num).map(|k| [wave(k, 4), wave(k, 5), 3.0 + wave(k, 6)]).collect(),
        scales: (0..num).map(|k| [0.02 + 0.01 * wave(k, 7), 0.05 + 0.04 * wave(k, 8)]).collect(),
        rotations: (0..num).map(unit).map(|q| [q.w, q.x, q.y, q.z]).collect(),
        opacities: (0..num).map(|k| 0.5 + 0.49 * wave(k, 9)).collect(),
        sh: (0..num * sh::num_coefficients(sh_degree)).map(|i| [wave(i, 10), wave(i, 11), wave(i, 12)]).collect(),
        sh_degree,
    }
}

fn write(surfels: &Surfels, scene_from_surfels: &Similarity, layout: SplatLayout) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_surfels_ply(&mut bytes, surfels, scene_from_surfels, layout, &["unit: mm"]).unwrap();
    bytes
}

fn header(bytes: &[u8]) -> String {
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
    String::from_utf8(bytes[..end].to_vec()).unwrap()
}

fn read(bytes: &[u8]) -> SurfelFile {
    read_surfels_ply(&mut &bytes[..]).unwrap()
}

fn close(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-6 * (1.0 + a.abs()))
}

#[test]
fn the_property_list_is_the_viewers() {
    for (degree, num_rest) in [(0, 0), (1, 9), (2, 24), (3, 45)] {
        let bytes = write(&some_surfels(2, degree), &Similarity::IDENTITY, SplatLayout::ThreeScales);
        let text = header(&bytes);
        let names: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
        let rest: Vec<String> = (0..num_rest).map(|i| format!("f_rest_{i}")).collect();
        let mut expected = vec!["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
        expected.extend(rest.iter().map(String::as_str));
        expected.extend(["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]);
        assert_eq!(names, expected);
        assert!(text.contains("\ncomment unit: mm\n"));
        assert_eq!(bytes.len(), text.len() + 11 + 2 * 4 * expected.len());
    }
}

#[test]
fn rows_hold_logits_logarithms_normals_and_channel_major_colour() {
    let surfels = Surfels {
        centres: vec![[1.0, 2.0, 3.0]],
        scales: vec![[1.0, 0.5]],
        // Half a turn about X: t_w = -Z.
        rotations: vec![[0.0, 1.0, 0.0, 0.0]],
        opacities: vec![0.75],
        sh: vec![[0.1, 0.2, 0.3], [1.0, 4.0, 7.0], [2.0, 5.0, 8.0], [3.0, 6.0, 9.0]],
        sh_degree: 1,
    };
    let bytes = write(&surfels, &Similarity::IDENTITY, SplatLayout::ThreeScales);
    let values = bytes[header(&bytes).len() + 11..].chunks(4);
    let row: Vec<f32> = values.map(|value| f32::from_le_bytes(value.try_into().unwrap())).collect();
    assert!(close(&row[..9], &[1.0, 2.0, 3.0, 0.0, 0.0, -1.0, 0.1, 0.2, 0.3]));
    assert!(close(&row[9..18], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]));
    assert!(close(&row[18..22], &[3f32.ln(), 0.0, 0.5f32.ln(), 1e-6f32.ln()]));
    assert!(close(&row[22..], &[0.0, 1.0, 0.0, 0.0]));
}

proptest! {
    #[test]
    fn what_is_written_is_read_back(num in 0usize..20, degree in 0usize..=3, two_scales: bool) {
        let layout = if two_scales { SplatLayout::TwoScales } else { SplatLayout::ThreeScales };
        let surfels = some_surfels(num, degree);
        let bytes = write(&surfels, &Similarity::IDENTITY, layout);
        prop_assert_eq!(header(&bytes).contains("scale_2"), !two_scales);
        let SurfelFile { surfels: back, origin } = read(&bytes);
        prop_assert!(back.is_consistent() && back.sh_degree == degree && origin == DVec3::ZERO);
        prop_assert!(close(back.centres.as_flattened(), surfels.centres.as_flattened()));
        prop_assert!(close(back.scales.as_flattened(), surfels.scales.as_flattened()));
        prop_assert!(close(back.rotations.as_flattened(), surfels.rotations.as_flattened()));
        prop_assert!(close(&back.opacities, &surfels.opacities));
        prop_assert!(close(back.sh.as_flattened(), surfels.sh.as_flattened()));
    }

    #[test]
    fn a_file_cut_short_is_refused(cut in 0usize..1000) {
        let bytes = write(&some_surfels(3, 0), &Similarity::IDENTITY, SplatLayout::ThreeScales);
        prop_assert_eq!(read_surfels_ply(&mut &bytes[..cut.min(bytes.len())]).is_err(), cut < bytes.len());
    }

    /// Any byte may be wrong: surfels or a sentence, never a panic.
    #[test]
    fn a_damaged_file_never_panics(position in 0usize..700, byte: u8) {
        let mut bytes = write(&some_surfels(3, 1), &Similarity::IDENTITY, SplatLayout::ThreeScales);
        bytes[position] = byte;
        if let Ok(file) = read_surfels_ply(&mut &bytes[..]) {
            prop_assert!(file.surfels.is_consistent());
        }
    }
}

#[test]
fn a_header_that_promises_too_much_is_refused() {
    let bytes = write(&some_surfels(3, 0), &Similarity::IDENTITY, SplatLayout::ThreeScales);
    let text = header(&bytes);
    let mut boast = text.replace("vertex 3", "vertex 99999999999999").into_bytes();
    boast.extend_from_slice(&bytes[text.len()..]);
    let message = read_surfels_ply(&mut &boast[..]).unwrap_err().to_string();
    assert_eq!(message, "the file ends after 3 of 99999999999999 surfels");
}

#[test]
fn the_frame_change_moves_discs_and_colours_together() {
    let surfels = some_surfels(5, 3);
    let rotation = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.7, -0.4, 2.1));
    let scene_from_surfels = Similarity { scale: 40.0, rotation, translation: DVec3::new(3.0, -80.0, 5.0) };
    let moved = read(&write(&surfels, &scene_from_surfels, SplatLayout::default())).surfels;
    for k in 0..surfels.len() {
        // A point of the disc goes where the similarity takes it.
        let point = |s: &Surfels| {
            let [w, x, y, z] = s.rotations[k];
            let along = Quat::from_xyzw(x, y, z, w) * Vec3::new(s.scales[k][0], 2.0 * s.scales[k][1], 0.0);
            (Vec3::from(s.centres[k]) + along).as_dvec3()
        };
        assert!(point(&moved).abs_diff_eq(scene_from_surfels.transform(point(&surfels)), 1e-4));
        // Seen along the turned direction it has the colour it had.
        let show = |s: &Surfels, direction: DVec3, channel: usize| -> f64 {
            let basis = sh::basis(direction);
            (0..16).map(|n| basis[n] * f64::from(s.sh[k * 16 + n][channel])).sum()
        };
        let direction = DVec3::new(0.3, -0.5, 0.8).normalize();
        for channel in 0..3 {
            let difference = show(&moved, rotation * direction, channel) - show(&surfels, direction, channel);
            assert!(difference.abs() < 1e-5);
        }
    }
}

#[test]
fn far_from_the_origin_the_header_carries_the_offset() {
    let surfels = some_surfels(50, 0);
    let translation = DVec3::new(453_000.25, 5_412_345.125, 300.5);
    let scene_from_surfels = Similarity { translation, ..Similarity::IDENTITY };
    let SurfelFile { surfels: back, origin } = read(&write(&surfels, &scene_from_surfels, SplatLayout::default()));
    assert!(origin.distance(translation) < 10.0);
    for (centre, expected) in back.centres.iter().zip(&surfels.centres) {
        let scene = Vec3::from(*centre).as_dvec3() + origin;
        assert!(scene.abs_diff_eq(Vec3::from(*expected).as_dvec3() + translation, 1e-6));
    }
}
