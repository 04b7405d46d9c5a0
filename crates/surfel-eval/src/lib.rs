//! Scores: depth maps, normals, Chamfer distances and reports.
//!
//! Takes depth maps, points, meshes and images from whoever made them and never a pipeline. Invariant: a
//! missing answer counts as a miss, and the rule that says so stands in the module that scores.

pub mod calibration;
pub mod calibration_plot;
pub mod chamfer;
pub mod cull;
pub mod depth_map;
pub mod depth_metrics;
pub mod dtu;
pub mod dtu_reference;
pub mod first_hit;
pub mod histogram_plot;
pub mod keep_faces;
pub mod mat;
pub mod nearest;
pub mod normal_metrics;
pub mod nyquist_stats;
pub mod object_chamfer;
pub mod paper_tables;
pub mod psnr;
pub mod reference;
pub mod report;
pub mod sample_mesh;
pub mod ssim;
pub mod surface_score;
pub mod thin;
pub mod view_score;

pub use calibration::Calibration;
pub use chamfer::{Beyond, ChamferScore, chamfer};
pub use depth_map::DepthMap;
pub use depth_metrics::{DepthScore, score_depth};
pub use dtu::{DtuScore, DtuSettings, score_dtu};
pub use normal_metrics::{NormalScore, score_depth_normals, score_normals};
pub use reference::{PointCloud, Reference};
pub use surface_score::{SurfaceScore, score_surface};
pub use view_score::{ViewScore, score_view};
