//! The line of `CONVENTIONS.md` that this crate keeps.

use surfel_stereo::candidates::Candidates;

#[test]
fn candidates_run_far_to_near_in_disparity() {
    let (near, far) = (2.0, 10.0);
    let candidates = Candidates::uniform(near, far, 5);
    assert!((1.0 / candidates.inverse_depth(0.0) - far).abs() < 1e-12, "index 0 is the far plane");
    assert!((1.0 / candidates.inverse_depth(4.0) - near).abs() < 1e-12, "the last index is the near plane");
    let middle = 0.5 * (1.0 / near + 1.0 / far);
    assert!((candidates.inverse_depth(2.0) - middle).abs() < 1e-12, "the middle is halfway in disparity");
}
