//! scratch
use std::path::Path;
use surfel_train::{TrainConfig, Trainer, Watcher};
struct Say;
impl Watcher for Say {
    fn logged(&self, r: &surfel_train::trainer::StepReport) { println!("{r:?}"); }
    fn validated(&self, step: u64, v: &surfel_train::validate::Validation) { println!("{step} {v:#?}"); }
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let config = TrainConfig::from_file(Path::new(&a[1])).unwrap();
    let steps = config.steps;
    let mut t = Trainer::new(config, Path::new(&a[2]), Some(Path::new("/work/cache")), None).unwrap();
    println!("{:?}", t.net().parts());
    if a.len() > 3 { let s = std::time::Instant::now(); t.prepare(|n| println!("{n} {:.1}", s.elapsed().as_secs_f64())).unwrap(); return; }
    println!("{:#?}", t.validate().unwrap());
    t.run(steps, &Say).unwrap();
}
