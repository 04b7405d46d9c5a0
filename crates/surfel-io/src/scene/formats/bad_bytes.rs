//! Every parser is fed random and mutated bytes: whatever comes, it returns.
//!
//! The seeds are small valid files, so that mutations get past the first check.

use super::*;
use crate::npy::Array;
use proptest::prelude::*;
use std::io::Write;

type Parser = fn(&[u8]);

/// Each parser with a valid file for it.
fn parsers() -> Vec<(Parser, Vec<u8>)> {
    let pose = "1 0 0 0.5 0 1 0 0 0 0 1 2 0 0 0 1";
    let k = "100 0 50 0 100 40 0 0 1";
    let eye = |rows: usize| (0..rows * rows).map(|i| if i % (rows + 1) == 0 { 1.0 } else { 0.0 }).collect::<Vec<f64>>();
    let idr = npz(&[("world_mat_0", &[4, 4], &eye(4)), ("scale_mat_0", &[4, 4], &eye(4))]);
    let robustmvd = npz(&[("K", &[1, 3, 3], &eye(3)), ("to_ref_transform", &[1, 4, 4], &eye(4))]);
    let llff = [0.0, 1.0, 0.0, 0.0, 80.0, 1.0, 0.0, 0.0, 0.0, 100.0, 0.0, 0.0, -1.0, 0.0, 90.0, 1.0, 9.0];
    let transforms = r#"{"fl_x":100,"cx":50,"cy":40,"w":100,"h":80,"frames":[{"file_path":"a.png","k1":0.1,
        "transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;
    let cameras = r#"[{"image":"a.png","width":100,"height":80,"K":[100,0,50,0,100,40,0,0,1],"distortion":[0.1,0.2],
        "camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}]"#;
    let intrinsic = r#"{"width":100,"height":80,"intrinsic_matrix":[100,0,0,0,100,0,50,40,1]}"#;
    vec![
        (|b| drop(colmap::text_cameras(b)), b"# c\n1 OPENCV 100 80 90 90 50 40 0.1 0.2 0 0\n".to_vec()),
        (
            |b| drop(colmap::text_images(b)),
            b"1 1 0 0 0 0 0 0 1 a b.png\n1 2 -1 3 4 7\n2 1 0 0 0 0 0 0 1 c.png\n\n".to_vec(),
        ),
        (|b| drop(colmap::text_points(b)), b"1 0.5 0.5 2 255 0 0 0.3 1 0 2 1\n".to_vec()),
        (|b| drop(colmap::binary_cameras(b)), colmap_bytes(&[1, 1, 1, 100, 80], 4)),
        (|b| drop(colmap::binary_images(b)), colmap_bytes(&[1], 12)),
        (|b| drop(colmap::binary_points(b)), colmap_bytes(&[1, 7], 12)),
        (|b| drop(transforms::parse(b)), transforms.into()),
        (|b| drop(cameras_json::parse(b)), cameras.into()),
        (|b| drop(idr::parse(b)), idr),
        (|b| drop(robustmvd::parse(b)), robustmvd),
        (
            |b| drop(mvsnet::parse("00000001", 1, b)),
            format!("extrinsic\n{pose}\n\nintrinsic\n{k}\n\n425 2.5 192 900").into(),
        ),
        (|b| drop(middlebury::parse(b)), format!("1\na.png {k} 1 0 0 0 1 0 0 0 1 0 0 2\n").into()),
        (|b| drop(strecha::parse("a.png", b)), format!("{k} 0 0 0 1 0 0 0 1 0 0 0 1 0 0 2 100 80").into()),
        (|b| drop(re10k::parse(b)), b"https://x\n1 0.9 1.2 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 2\n".to_vec()),
        (|b| _ = re10k::looks_like(b), b"https://x\n1 0.9 1.2 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 2\n".to_vec()),
        (|b| drop(llff::parse(b)), npy(&[1, 17], &llff)),
        (|b| drop(Array::parse(b)), npy(&[1, 17], &llff)),
        (|b| drop(poses_text::parse_k(b)), k.into()),
        (|b| drop(poses_text::parse(b, &[1.0; 9], Some(b))), pose.into()),
        (|b| drop(trajectory_log::parse(b, None)), b"0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n".to_vec()),
        (|b| drop(trajectory_log::parse_intrinsic(b)), intrinsic.into()),
        (
            |b| drop(stereo_calib::parse(b)),
            b"cam0=[100 0 50; 0 100 40; 0 0 1]\ncam1=[100 0 52; 0 100 40; 0 0 1]\nbaseline=19.3\nwidth=100\nheight=80\n".to_vec(),
        ),
        (|b| _ = stereo_calib::looks_like(b), b"cam0=[100 0 50; 0 100 40; 0 0 1]\n".to_vec()),
    ]
}

/// Little-endian u64 counts followed by plausible doubles.
fn colmap_bytes(counts: &[u64], num_doubles: usize) -> Vec<u8> {
    let counts = counts.iter().flat_map(|count| count.to_le_bytes());
    counts.chain((0..num_doubles).flat_map(|_| 1.0f64.to_le_bytes())).collect()
}

fn npy(shape: &[usize], data: &[f64]) -> Vec<u8> {
    let shape: String = shape.iter().map(|length| format!("{length},")).collect();
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(data.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

fn npz(arrays: &[(&str, &[usize], &[f64])]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, shape, data) in arrays {
        let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        archive.start_file(format!("{name}.npy"), options).unwrap();
        archive.write_all(&npy(shape, data)).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

#[test]
fn the_seeds_are_valid() {
    assert_eq!(idr::parse(&parsers()[8].1).unwrap().entries.len(), 1);
    assert_eq!(robustmvd::parse(&parsers()[9].1).unwrap().entries.len(), 1);
    assert_eq!(llff::parse(&parsers()[15].1).unwrap().entries.len(), 1);
    assert_eq!(stereo_calib::parse(&parsers()[21].1).unwrap().entries.len(), 2);
    assert_eq!(transforms::parse(&parsers()[6].1).unwrap().entries.len(), 1);
    assert_eq!(cameras_json::parse(&parsers()[7].1).unwrap().entries.len(), 1);
    assert_eq!(colmap::text_images(&parsers()[1].1).unwrap().len(), 2);
}

#[test]
fn a_count_in_a_header_reserves_nothing() {
    let absurd = colmap_bytes(&[u64::MAX, u64::MAX, u64::MAX], 20);
    assert!(colmap::binary_cameras(&absurd).is_err());
    assert!(colmap::binary_images(&absurd).is_err());
    assert!(colmap::binary_points(&absurd).is_err());
    assert!(Array::parse(&npy(&[usize::MAX, usize::MAX], &[1.0])).unwrap_err().contains("cut short"));
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        for (parse, _) in parsers() {
            parse(&bytes);
        }
    }

    #[test]
    fn mutated_files_never_panic(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        keep in 0.3f64..1.3,
    ) {
        for (parse, mut bytes) in parsers() {
            for (index, byte) in &edits {
                let at = index.index(bytes.len());
                bytes[at] = *byte;
            }
            bytes.truncate((keep * bytes.len() as f64) as usize);
            parse(&bytes);
        }
    }
}
