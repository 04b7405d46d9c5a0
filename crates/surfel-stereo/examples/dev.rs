//! dev
use std::time::Instant;
use surfel_core::*;
use surfel_stereo::*;
fn main() {
    for d in std::env::args().skip(1) {
        let meta = std::fs::read_to_string(format!("{d}/meta.txt")).unwrap();
        let mut l = meta.lines();
        let h: Vec<usize> = l.next().unwrap().split(' ').map(|v| v.parse().unwrap()).collect();
        let (n, w, ht) = (h[0], h[1], h[2]);
        let mut views = vec![];
        let mut nf = vec![];
        for i in 0..n {
            let v: Vec<f64> = l.next().unwrap().split(' ').map(|v| v.parse().unwrap()).collect();
            let b = std::fs::read(format!("{d}/{i}.rgb")).unwrap();
            let f: Vec<f32> = b.chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect();
            let img = Grid::from_vec(w, ht, f.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect());
            let r = glam::DMat3::from_cols_array(&v[4..13].try_into().unwrap()).transpose();
            let cam = Camera {
                intrinsics: Intrinsics { fx: v[0], fy: v[1], cx: v[2], cy: v[3] },
                width: w,
                height: ht,
                camera_from_world: Rigid::from_matrix(r, glam::DVec3::new(v[13], v[14], v[15])).unwrap(),
            };
            nf.push((v[16], v[17]));
            views.push(View::new(format!("{i}"), img, cam));
        }
        let grays: Vec<_> = views.iter().map(|v| v.gray()).collect();
        let mv: Vec<MatchView> = (0..n)
            .map(|i| MatchView {
                image: MatchImage { gray: &grays[i], valid: &views[i].valid, camera: &views[i].camera, features: None },
                colour: &views[i].image,
                near: nf[i].0,
                far: nf[i].1,
            })
            .collect();
        let nb: Vec<Vec<usize>> = (0..n).map(|i| (0..n).filter(|&j| j != i).collect()).collect();
        let mut cfg = MatchConfig::default();
        let e = |k: &str| std::env::var(k).ok().map(|v| v.parse::<f32>().unwrap());
        if let Some(v) = e("P1") {
            cfg.smoothness.p1 = v
        }
        if let Some(v) = e("P2") {
            cfg.smoothness.p2 = v
        }
        if let Some(v) = e("P2E") {
            cfg.smoothness.p2_edge = v
        }
        if let Some(v) = e("PE") {
            cfg.smoothness.edge = v
        }
        if let Some(v) = e("ROUNDS") {
            cfg.refinement.rounds = v as usize
        }
        if let Some(v) = e("FR") {
            cfg.refinement.fit_radius = v as usize
        }
        if let Some(v) = e("REACH") {
            cfg.refinement.fit_reach = v as usize
        }
        if let Some(v) = e("FE") {
            cfg.refinement.fit_edge = v
        }
        if let Some(v) = e("WR") {
            cfg.refinement.window_radius = v as usize
        }
        if let Some(v) = e("WE") {
            cfg.refinement.window_edge = v
        }
        if let Some(v) = e("STEP") {
            cfg.step_px = v as f64
        }
        if let Some(v) = e("SR") {
            cfg.cost.small_radius = v as usize
        }
        if let Some(v) = e("BR") {
            cfg.cost.wide_radius = v as usize
        }
        if let Some(v) = e("WW") {
            cfg.cost.wide = v
        }
        if let Some(v) = e("WID") { cfg.refinement.fit_widening = v }
 if let Some(v) = e("WF") { cfg.cost.features = v }
 let t = Instant::now();
        let out = estimate_depths(&mv, &nb, &cfg);
        eprintln!("{d} {:?} D={}", t.elapsed(), out[0].num_candidates);
        for (i, o) in out.iter().enumerate() {
            let wr = |n: &str, v: Vec<f32>| {
                std::fs::write(format!("{d}/{i}.{n}"), v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())
                    .unwrap()
            };
            wr("depth", o.depth.as_slice().to_vec());
            wr("conf", o.confidence.as_slice().to_vec());
            wr("normal", o.normal.as_slice().iter().flatten().copied().collect());
        }
    }
}
