//! The terms together: what is missing is skipped, and descending the total makes a rendering like its photograph.

use crate::known::{map, picture, value, vectors};
use crate::scene::{HEIGHT, WIDTH, camera, maps, range, surfels, tensors};
use burn::tensor::{Gradients, Tensor};
use surfel_core::Grid;
use surfel_loss::{LossError, Perceptual, Recipe, Terms, Truth, view_terms};
use surfel_net::RenderedMaps;

fn everything() -> Truth {
    let towards = Grid::filled(WIDTH, HEIGHT, [0.0f32, 0.0, -1.0]);
    Truth {
        photograph: picture(WIDTH, HEIGHT, 0.0),
        depth: Some(map(WIDTH, HEIGHT, |_, _| 2.0)),
        normals: Some((vectors(&towards), map(WIDTH, HEIGHT, |_, _| 1.0))),
        mask: Some(map(WIDTH, HEIGHT, |_, _| 1.0)),
    }
}

fn terms(maps: &RenderedMaps, truth: &Truth, recipe: &Recipe) -> Result<Terms, LossError> {
    view_terms(maps, truth, (&camera(1.0).intrinsics, &range(1.0)), &Perceptual::Ssim, recipe)
}

fn names(terms: &Terms) -> Vec<&str> {
    terms.list.iter().map(|term| term.name).collect()
}

#[test]
fn what_is_missing_or_weighs_nothing_is_skipped() {
    let rendered = maps(&tensors(&surfels(1.0)), 1.0);
    let all = terms(&rendered, &everything(), &Recipe::default()).expect("equal sizes");
    assert_eq!(names(&all), ["photometric", "1 - SSIM", "alignment", "rendered depth", "normal", "silhouette"]);
    assert!(all.list.iter().all(|term| value(term.value.clone()) > 0.0));
    let sum: f64 = all.list.iter().map(|term| term.weight * value(term.value.clone())).sum();
    assert!((value(all.total().expect("six terms")) - sum).abs() < 1e-5);

    let bare = Truth { depth: None, normals: None, mask: None, ..everything() };
    let few = terms(&rendered, &bare, &Recipe::default()).expect("equal sizes");
    assert_eq!(names(&few), ["photometric", "1 - SSIM", "alignment"]);
    let recipe = Recipe { perceptual: 0.0, alignment: 0.0, ..Recipe::default() };
    assert_eq!(names(&terms(&rendered, &bare, &recipe).expect("equal sizes")), ["photometric"]);
    let nothing = Recipe { photometric: 0.0, ..recipe };
    assert!(terms(&rendered, &bare, &nothing).expect("equal sizes").total().is_none());
    let can_tell = |truth: &Truth, recipe: &Recipe| recipe.can_tell(truth);
    assert!(can_tell(&bare, &recipe) && can_tell(&everything(), &nothing) && !can_tell(&bare, &nothing));
}

#[test]
fn pictures_that_cannot_be_compared_are_refused() {
    let rendered = maps(&tensors(&surfels(1.0)), 1.0);
    let other = Truth { photograph: picture(WIDTH, HEIGHT + 1, 0.0), ..everything() };
    let error = terms(&rendered, &other, &Recipe::default()).expect_err("another size");
    assert_eq!(error, LossError::Size { found: (WIDTH, HEIGHT), expected: (WIDTH, HEIGHT + 1) });
    let error = Perceptual::Ssim.distance(picture(20, 10, 0.0), picture(20, 10, 0.0)).expect_err("too small");
    assert!(error.to_string().contains("SSIM needs at least 11 pixels"), "{error}");
}

/// `tensor` after a step downhill in which its largest change is `step`.
fn descended<const D: usize>(tensor: Tensor<D>, grads: &Gradients, step: f64) -> Tensor<D> {
    let slope = tensor.grad(grads).expect("tracked");
    let largest: f32 = slope.clone().abs().max().into_scalar();
    (tensor.without_autodiff() - slope * (step / f64::from(largest))).autodiff().require_grad()
}

#[test]
fn descending_the_loss_makes_a_rendering_like_its_photograph() {
    let target = maps(&tensors(&surfels(1.0)), 1.0);
    let truth = Truth {
        photograph: target.colour.without_autodiff(),
        depth: Some(target.depth_median.without_autodiff()),
        normals: None,
        mask: None,
    };
    // Pushed back, turned grey and made shallow.
    let mut start = surfels(1.0);
    start.centres.iter_mut().for_each(|centre| centre[2] += 0.15);
    start.sh.iter_mut().for_each(|sh| *sh = [0.0; 3]);
    let mut surfels = tensors(&start);
    let mut losses = Vec::new();
    for _ in 0..20 {
        let total = terms(&maps(&surfels, 1.0), &truth, &Recipe::default()).expect("equal sizes").total();
        let total = total.expect("four terms");
        losses.push(value(total.clone()));
        let grads = total.backward();
        surfels.centres = descended(surfels.centres, &grads, 0.02);
        surfels.sh = descended(surfels.sh, &grads, 0.3);
    }
    assert!(losses[19] < 0.5 * losses[0], "{losses:?}");
}
