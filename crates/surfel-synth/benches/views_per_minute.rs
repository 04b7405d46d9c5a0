//! Views per minute of each renderer, and the ray hierarchy against its slow twin, in one run.
//!
//! Plain timing, no harness: `cargo bench -p surfel-synth`. Asset scenes need the shared folder
//! (`SURFELSPLAT_SHARED` or `../shared`).

use std::time::Instant;
use surfel_synth::{SceneKind, SceneOptions};

fn main() {
    analytic();
    #[cfg(feature = "assets")]
    assets();
}

fn analytic() {
    for kind in [SceneKind::Sphere, SceneKind::StillLife, SceneKind::HeightField] {
        let options = SceneOptions { kind, ..SceneOptions::default() };
        let start = Instant::now();
        let views = options.render().len();
        report(&format!("analytic {kind:?} 320x256"), views, start);
    }
}

#[cfg(feature = "assets")]
fn assets() {
    use std::path::PathBuf;
    use surfel_synth::{AssetLibrary, SceneSampler, Split, SynthConfig};
    let workspace = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    let shared = std::env::var_os("SURFELSPLAT_SHARED").map_or_else(|| workspace.join("../shared"), PathBuf::from);
    let folder = shared.join("data/assets");
    let Ok(library) = AssetLibrary::open(&folder, Split::Val) else {
        eprintln!("SKIPPED: no assets at {}; set SURFELSPLAT_SHARED", folder.display());
        return;
    };
    let start = Instant::now();
    for entry in library.meshes() {
        library.mesh(&entry.name).expect("the shared meshes are readable");
    }
    println!(
        "{:<44}{:>9.0} meshes/min",
        "load, normals, occlusion, hierarchy",
        per_minute(library.meshes().len(), start)
    );
    for (name, room_share, street_share) in [("tabletop", 0.0, 0.0), ("room", 1.0, 0.0), ("street", 0.0, 1.0)] {
        let sampler = SceneSampler::new(&library, SynthConfig { room_share, street_share, ..SynthConfig::default() });
        let seeds = 0..6;
        // Once unmeasured, so that textures are loaded as in a long run.
        let draw =
            || -> Vec<_> { seeds.clone().map(|seed| sampler.scene(seed).expect("the scene is complete")).collect() };
        draw();
        let start = Instant::now();
        let scenes = draw();
        println!("{:<44}{:>9.0} scenes/min", format!("{name}, drawing scenes"), per_minute(scenes.len(), start));
        let start = Instant::now();
        let views = scenes.iter().flat_map(|scene| (0..2).map(|i| scene.render(i))).count();
        report(&format!("{name} 320x256"), views, start);
    }
    against_twin(&library);
}

/// Closest-hit rays on one scan: hierarchy against a loop over all triangles.
#[cfg(feature = "assets")]
fn against_twin(library: &surfel_synth::AssetLibrary) {
    use glam::Vec3;
    let meshes =
        library.meshes().iter().map(|entry| library.mesh(&entry.name).expect("the shared meshes are readable"));
    let mesh = meshes.max_by_key(|mesh| mesh.num_triangles()).expect("a library is never empty");
    let mut random = surfel_synth::Random::new(1);
    let rays: Vec<(Vec3, Vec3)> = (0..20_000)
        .map(|_| {
            let origin = random.direction().as_vec3() * 3.0;
            (origin, (random.direction().as_vec3() * 0.7 - origin).normalize())
        })
        .collect();
    let start = Instant::now();
    let hits = rays.iter().filter(|(o, d)| mesh.intersect(*o, *d, 0.0, f32::INFINITY).is_some()).count();
    let fast = start.elapsed().as_secs_f64() / rays.len() as f64;
    let triangles: Vec<[Vec3; 3]> = (0..mesh.num_triangles()).map(|i| mesh.positions(i)).collect();
    let few = &rays[..100];
    let start = Instant::now();
    let slow_hits = few.iter().filter(|(o, d)| triangles.iter().any(|t| meets(t, *o, *d))).count();
    let slow = start.elapsed().as_secs_f64() / few.len() as f64;
    println!(
        "{:<44}{:>9.2} Mrays/s, {:.0} x the loop over {} triangles ({hits}, {slow_hits} hits)",
        "one thread, incoherent rays",
        1e-6 / fast,
        slow / fast,
        triangles.len(),
    );
}

#[cfg(feature = "assets")]
fn meets(&[a, b, c]: &[glam::Vec3; 3], origin: glam::Vec3, direction: glam::Vec3) -> bool {
    let (u, v) = (b - a, c - a);
    let p = direction.cross(v);
    let inverse = 1.0 / u.dot(p);
    let offset = origin - a;
    let s = offset.dot(p) * inverse;
    let q = offset.cross(u);
    let t = direction.dot(q) * inverse;
    s >= 0.0 && t >= 0.0 && s + t <= 1.0 && v.dot(q) * inverse > 0.0
}

fn report(name: &str, views: usize, start: Instant) {
    println!("{name:<44}{:>9.0} views/min", per_minute(views, start));
}

fn per_minute(count: usize, start: Instant) -> f64 {
    60.0 * count as f64 / start.elapsed().as_secs_f64()
}
