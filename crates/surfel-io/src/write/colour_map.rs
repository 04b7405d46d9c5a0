//! Turbo, the perceptual rainbow for depth (A. Mikhailov 2019), as its published polynomial of degree 5.

/// sRGB colour in \[0, 1\] of a value in \[0, 1\]: blue far, red near.
pub(super) fn turbo(value: f32) -> [f32; 3] {
    const RED: [f32; 6] = [0.135_721_38, 4.615_392_6, -42.660_324, 132.131_08, -152.942_4, 59.286_38];
    const GREEN: [f32; 6] = [0.091_402_61, 2.194_188_4, 4.842_966_6, -14.185_033, 4.277_299, 2.829_566];
    const BLUE: [f32; 6] = [0.106_673_3, 12.641_946, -60.582_05, 110.362_77, -89.903_11, 27.348_25];
    let t = value.clamp(0.0, 1.0);
    [RED, GREEN, BLUE].map(|channel| channel.iter().rev().fold(0.0, |sum, c| sum * t + c).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_from_blue_over_green_to_red() {
        let brightest = |t: f32| {
            let colour = turbo(t);
            (0..3).max_by(|&i, &j| colour[i].total_cmp(&colour[j])).unwrap()
        };
        assert_eq!([0.1, 0.5, 0.9].map(brightest), [2, 1, 0]);
    }
}
