//! The U-Net, and attention between views with more than one head.

use super::fixture::{Fixture, out};
use super::{device, indices, with_itself};
use crate::config::UnetConfig;
use crate::unet::Unet;
use crate::unet::attention::ViewAttention;

#[test]
fn the_attention_between_views_equals_its_twin() {
    let fixture = Fixture::open("view_attention");
    fixture.assert_equal(ViewAttention::new(64, &device()), |attention| {
        vec![out("y", attention.forward(fixture.input("x"), &indices(&with_itself(3))))]
    });
}

#[test]
fn the_unet_equals_its_twin() {
    let fixture = Fixture::open("unet");
    let config = UnetConfig { channels: 8, multipliers: vec![1, 2], attention_at: vec![2] };
    fixture.assert_equal(Unet::new(&config, &device()), |unet| {
        vec![out("y", unet.forward(fixture.input("x"), &indices(&with_itself(2))))]
    });
}
