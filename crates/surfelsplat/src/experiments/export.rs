//! Writes a scene with its truth as a folder that every command, and every peer, can open.
//!
//! `images/NN.png` and `cameras.json` are the scene; `depth/NN.pfm` (z-depth), `normal/NN.pfm` (camera frame),
//! `label/NN.png` (0 nothing, 255 surroundings, else the object's number) and `truth/points.ply` (exact points on what
//! the views see of the objects, with normals), `truth/objects.ply` (their triangles) are what is true of it. Lengths
//! are millimetres. Invariant: opening the folder as a scene gives the cameras and, to 8 bits, the pictures.

use std::io::Write as _;
use std::path::Path;
use surfel_core::{Grid, TriMesh};
use surfel_io::write::cameras_json::{CameraRecord, write_cameras_json};
use surfel_io::write::pfm::{write_pfm, write_pfm_rgb};
use surfel_io::write::picture_png::{write_gray_png, write_rgb_png};
use surfel_io::write::ply_mesh::write_ply_mesh;
use surfel_io::write::{PlacedMesh, StagedDir, WriteError};
use surfel_synth::{RenderedView, SurfaceSamples, TrueScene};

/// What the headers of the truth say.
const COMMENT: &str = "exact; frame of cameras.json, millimetres";

/// Stem of the files of view `index`.
pub fn stem(index: usize) -> String {
    format!("{index:02}")
}

/// Writes a scene and all that is true of it into `folder`. With `masks`, `mask/NN.png` shows the objects, and a
/// reconstruction will see nothing else.
///
/// # Errors
/// When the folder cannot be written to; then nothing was.
pub fn write_scene(scene: &TrueScene, folder: &Path, masks: bool) -> Result<(), WriteError> {
    let staged = StagedDir::new(folder)?;
    write_photographs(&scene.views, &staged)?;
    for (index, view) in scene.views.iter().enumerate() {
        let stem = stem(index);
        staged.write(format!("depth/{stem}.pfm"), |out| write_pfm(out, &view.depth))?;
        staged.write(format!("normal/{stem}.pfm"), |out| write_pfm_rgb(out, &view.normal))?;
        staged.write(format!("label/{stem}.png"), |out| write_gray_png(out, &view.object))?;
        if masks {
            let mask: Grid<u8> = view.object_mask().map(|&on| if on { 255 } else { 0 });
            staged.write(format!("mask/{stem}.png"), |out| write_gray_png(out, &mask))?;
        }
    }
    let points = cloud(&scene.surface);
    staged.write("truth/points.ply", |out| write_ply_mesh(out, &PlacedMesh::in_scene(&points), &[COMMENT]))?;
    if let Some(objects) = &scene.objects {
        staged.write("truth/objects.ply", |out| write_ply_mesh(out, &PlacedMesh::in_scene(objects), &[COMMENT]))?;
    }
    staged.write("README.txt", |out| out.write_all(readme(scene).as_bytes()))?;
    staged.commit().map(|_| ())
}

/// Writes only what a reconstruction needs: photographs and cameras.
///
/// # Errors
/// When the folder cannot be written to; then nothing was.
pub fn write_inputs(views: &[RenderedView], folder: &Path) -> Result<(), WriteError> {
    let staged = StagedDir::new(folder)?;
    write_photographs(views, &staged)?;
    staged.commit().map(|_| ())
}

fn write_photographs(views: &[RenderedView], staged: &StagedDir) -> Result<(), WriteError> {
    let names: Vec<String> = (0..views.len()).map(|index| format!("images/{}.png", stem(index))).collect();
    for (view, name) in views.iter().zip(&names) {
        staged.write(name, |out| write_rgb_png(out, &view.view.image))?;
    }
    let records: Vec<CameraRecord> = views
        .iter()
        .zip(&names)
        .map(|(view, name)| CameraRecord { image: name, camera: &view.view.camera, near_far: None })
        .collect();
    staged.write("cameras.json", |out| write_cameras_json(out, &records))
}

/// The samples as a mesh without triangles.
fn cloud(samples: &SurfaceSamples) -> TriMesh {
    TriMesh {
        positions: samples.points.iter().map(|p| p.as_vec3().to_array()).collect(),
        normals: samples.normals.iter().map(|n| n.as_vec3().to_array()).collect(),
        ..TriMesh::default()
    }
}

fn readme(scene: &TrueScene) -> String {
    format!(
        "Rendered scene {name}: exact depth (depth/*.pfm, z-depth in mm), normals (normal/*.pfm, camera frame),\n\
         objects per pixel (label/*.png: 0 nothing, 255 surroundings) and {points} exact points on what the views see\n\
         of the objects (truth/points.ply). Cameras: cameras.json, OpenCV axes, first pixel centre at 0.5.\n",
        name = scene.name,
        points = scene.surface.points.len(),
    )
}
