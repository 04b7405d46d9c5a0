//! What a network can be built with: every limit of every setting.
//!
//! Invariant: what passes builds without a panic, and a refusal names the key, its value and what it must be.

use super::{
    AggregationConfig, BackboneConfig, ConfigError, CostVolumeConfig, EpipolarConfig, FineSweepConfig, HeadConfig,
    NetConfig, NyquistConfig, RefinementConfig, SeededConfig, TransformerConfig, UnetConfig,
};

type Checked = Result<(), ConfigError>;

fn require(ok: bool, key: &'static str, value: impl ToString, expected: &'static str) -> Checked {
    if ok { Ok(()) } else { Err(ConfigError::Value { key, value: value.to_string(), expected }) }
}

fn count(key: &'static str, value: usize, most: usize, expected: &'static str) -> Checked {
    require((1..=most).contains(&value), key, value, expected)
}

fn channels(key: &'static str, value: usize) -> Checked {
    let expected = "a multiple of 4 between 4 and 4096";
    require(value.is_multiple_of(4) && (4..=4096).contains(&value), key, value, expected)
}

impl NetConfig {
    pub(super) fn check(&self) -> Checked {
        count("num_neighbours", self.num_neighbours, 64, "between 1 and 64")?;
        self.backbone.check()?;
        self.check_source_of_depth()?;
        self.seeded.as_ref().map_or(Ok(()), SeededConfig::check)?;
        self.transformer.as_ref().map_or(Ok(()), |part| part.check(self.backbone.channels()))?;
        self.cost_volume.as_ref().map_or(Ok(()), CostVolumeConfig::check)?;
        self.refinement.check()?;
        self.head.check()?;
        self.nyquist.check()?;
        self.aggregation.check()
    }

    /// Coarse depth comes from matching or from a cost volume of the network's own.
    fn check_source_of_depth(&self) -> Checked {
        let own = self.transformer.is_some() && self.cost_volume.is_some();
        let absent = self.transformer.is_none() && self.cost_volume.is_none();
        let (ok, value) = if self.seeded.is_some() { (absent, "there") } else { (own, "absent") };
        let expected = "there when [transformer] and [cost_volume] are not, and absent when both are";
        require(ok, "[seeded]", value, expected)
    }
}

impl BackboneConfig {
    fn check(&self) -> Checked {
        channels("backbone.channels", self.channels())?;
        match self {
            Self::Cnn { widths, .. } => widths.iter().try_for_each(|&width| channels("backbone.widths", width)),
            Self::Pretrained { .. } => Ok(()),
        }
    }
}

impl SeededConfig {
    fn check(&self) -> Checked {
        count("the number of seeded.distances", self.distances.len(), 4, "between 1 and 4")?;
        count("seeded.passes", self.passes, 8, "between 1 and 8")?;
        self.distances.iter().try_for_each(|&d| count("seeded.distances", d, 256, "between 1 and 256"))
    }
}

impl TransformerConfig {
    fn check(&self, channels: usize) -> Checked {
        count("transformer.num_layers", self.num_layers, 64, "between 1 and 64")?;
        count("transformer.num_splits", self.num_splits, 64, "between 1 and 64")?;
        count("transformer.expansion", self.expansion, 16, "between 1 and 16")?;
        let Some(EpipolarConfig { num_samples, num_heads }) = self.epipolar else { return Ok(()) };
        let sampled = (2..=1024).contains(&num_samples);
        require(sampled, "transformer.epipolar.num_samples", num_samples, "between 2 and 1024")?;
        let divides = num_heads > 0 && channels.is_multiple_of(num_heads);
        require(divides, "transformer.epipolar.num_heads", num_heads, "a divisor of backbone.channels")
    }
}

impl CostVolumeConfig {
    fn check(&self) -> Checked {
        let candidates = self.num_candidates;
        require((2..=4096).contains(&candidates), "cost_volume.num_candidates", candidates, "between 2 and 4096")?;
        self.unet.check()
    }
}

impl UnetConfig {
    fn check(&self) -> Checked {
        channels("unet.channels", self.channels)?;
        count("the number of unet.multipliers", self.multipliers.len(), 8, "between 1 and 8")?;
        self.multipliers.iter().try_for_each(|&m| count("unet.multipliers", m, 16, "between 1 and 16"))?;
        for (level, multiplier) in self.multipliers.iter().enumerate() {
            let width = self.channels * multiplier;
            let ok = !self.attention_at.contains(&(1 << level)) || width < 32 || width.is_multiple_of(32);
            require(ok, "unet.channels times a multiplier", width, "a multiple of 32 where views attend")?;
        }
        Ok(())
    }
}

impl RefinementConfig {
    fn check(&self) -> Checked {
        self.unet.check()?;
        require(matches!(self.stride, 1 | 2 | 4), "refinement.stride", self.stride, "1, 2 or 4")?;
        channels("refinement.upsampled_channels", self.upsampled_channels)?;
        self.sweep.as_ref().map_or(Ok(()), FineSweepConfig::check)
    }
}

impl FineSweepConfig {
    fn check(&self) -> Checked {
        let odd = self.num_candidates % 2 == 1 && self.num_candidates < 256;
        require(odd, "refinement.sweep.num_candidates", self.num_candidates, "odd and below 256")?;
        let ok = self.step > 0.0 && self.step.is_finite();
        require(ok, "refinement.sweep.step", self.step, "a finite number above 0")?;
        channels("refinement.sweep.channels", self.channels)
    }
}

impl HeadConfig {
    fn check(&self) -> Checked {
        let Self { sh_degree, scale_min, scale_max, hidden_channels } = *self;
        require(sh_degree <= 3, "head.sh_degree", sh_degree, "between 0 and 3")?;
        let ordered = scale_min > 0.0 && scale_max > scale_min && scale_max.is_finite();
        require(ordered, "head.scale_max", scale_max, "finite and above head.scale_min, which is above 0")?;
        count("head.hidden_channels", hidden_channels.unwrap_or(1), 4096, "between 1 and 4096")
    }
}

impl NyquistConfig {
    fn check(&self) -> Checked {
        require(self.s > 0.0 && self.s.is_finite(), "nyquist.s", self.s, "a finite number above 0")?;
        let open = self.epsilon > 0.0 && self.epsilon < 1.0;
        require(open, "nyquist.epsilon", self.epsilon, "between 0 and 1, exclusive")?;
        count("nyquist.radius", self.radius, 3, "between 1 and 3")?;
        let margin = self.visibility_margin;
        require((0.0..=10.0).contains(&margin), "nyquist.visibility_margin", margin, "between 0 and 10")
    }
}

impl AggregationConfig {
    fn check(&self) -> Checked {
        channels("aggregation.channels", self.channels)?;
        let divides = self.num_heads > 0 && self.channels.is_multiple_of(self.num_heads);
        require(divides, "aggregation.num_heads", self.num_heads, "a divisor of aggregation.channels")?;
        count("aggregation.expansion", self.expansion, 16, "between 1 and 16")
    }
}
