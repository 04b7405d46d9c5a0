//! Scores: depth maps, normals, Chamfer distances and reports.
