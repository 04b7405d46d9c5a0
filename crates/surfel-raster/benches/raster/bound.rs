//! What this machine can do at best, and stopwatches for wall and processor time.

use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

/// Rates of all threads together.
pub struct Bound {
    /// f32 additions and multiplications per second, vectorised, from registers.
    pub ops: f64,
    /// Bytes per second read plus written by a large copy.
    pub bytes: f64,
    /// Threads in use.
    pub threads: usize,
}

/// Seconds of one run.
#[derive(Clone, Copy)]
pub struct Elapsed {
    /// The fastest of the rounds, on the clock.
    pub wall: f64,
    /// Mean over the rounds of all threads' processor time; 0 where the system does not tell.
    pub processor: f64,
}

impl Bound {
    pub fn measure() -> Self {
        let threads = rayon::current_num_threads();
        Self { ops: arithmetic_rate(threads), bytes: copy_rate(), threads }
    }
}

struct MulAdd;

const MUL_ADD_STEPS: usize = 2_000_000;
const MUL_ADD_LANES: usize = 128;

impl pulp::WithSimd for MulAdd {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> f32 {
        let mut lanes = [1.0f32; MUL_ADD_LANES];
        let (factor, offset) = (black_box(0.999f32), black_box(0.001f32));
        for _ in 0..MUL_ADD_STEPS {
            for lane in &mut lanes {
                *lane = *lane * factor + offset;
            }
        }
        lanes.iter().sum()
    }
}

fn arithmetic_rate(threads: usize) -> f64 {
    let arch = pulp::Arch::new();
    let time = time(3, || {
        black_box((0..threads).into_par_iter().map(|_| arch.dispatch(MulAdd)).sum::<f32>());
    });
    (threads * MUL_ADD_STEPS * MUL_ADD_LANES * 2) as f64 / time.wall
}

fn copy_rate() -> f64 {
    const LEN: usize = 1 << 25;
    let (from, mut to) = (vec![1.0f32; LEN], vec![0.0f32; LEN]);
    let time = time(5, || {
        to.par_chunks_mut(1 << 18).zip(from.par_chunks(1 << 18)).for_each(|(to, from)| to.copy_from_slice(from));
        black_box(&to);
    });
    (LEN * 8) as f64 / time.wall
}

pub fn time(rounds: usize, mut run: impl FnMut()) -> Elapsed {
    run();
    let before = processor_seconds();
    let mut wall = f64::INFINITY;
    for _ in 0..rounds {
        let start = Instant::now();
        run();
        wall = wall.min(start.elapsed().as_secs_f64());
    }
    Elapsed { wall, processor: (processor_seconds() - before) / rounds as f64 }
}

/// User and system time of this process so far, from Linux's `/proc`.
fn processor_seconds() -> f64 {
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    after_name.split_whitespace().skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>()
        / TICKS_PER_SECOND
}
