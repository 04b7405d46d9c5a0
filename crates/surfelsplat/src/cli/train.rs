//! `surfelsplat train`: trains a network as a configuration says, and goes on where it stopped.

use super::args::TrainArgs;
use super::print_line;
use anyhow::Result;
use std::process::ExitCode;
use surfel_train::trainer::StepReport;
use surfel_train::validate::{Scores, Validation};
use surfel_train::{Places, TrainConfig, Trainer, Watcher};

pub fn run(args: &TrainArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let config = TrainConfig::from_file(&args.config)?;
    let steps = args.steps.unwrap_or(config.steps);
    let device = args.device.open()?;
    let places = Places {
        assets: args.assets.as_deref(),
        cache: args.cache.as_deref(),
        initial: args.initial.as_deref(),
        lpips: args.lpips.as_deref(),
        device: Some(&device),
    };
    let mut trainer = Trainer::new(config, &args.output, places)?;
    let console = Console { quiet: quiet || json };
    if args.prepare {
        trainer.prepare(|made| console.say(&format!("{made} samples")))?;
        return Ok(ExitCode::SUCCESS);
    }
    if trainer.step() > 0 {
        console.say(&format!("{}: goes on after step {}", args.output.display(), trainer.step()));
    }
    trainer.run(steps, &console)?;
    let validation = trainer.validate()?;
    if json {
        let document = serde_json::json!({ "step": trainer.step(), "validation": validation });
        print_line(&serde_json::to_string_pretty(&document)?);
    } else if !quiet {
        print_line(&format!("{}: {} steps done", args.output.display(), trainer.step()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Says on stderr how it goes.
struct Console {
    quiet: bool,
}

impl Console {
    fn say(&self, line: &str) {
        if !self.quiet {
            eprintln!("{line}");
        }
    }
}

impl Watcher for Console {
    fn logged(&self, report: &StepReport) {
        let terms: Vec<String> = report.terms.iter().map(|(name, value)| format!("{name} {value:.4}")).collect();
        let minutes = (report.steps - report.step) as f64 * report.seconds_per_step / 60.0;
        self.say(&format!(
            "step {}/{}: loss {:.4} ({}), {:.0} steps an hour, {:.0} min left",
            report.step,
            report.steps,
            report.loss,
            terms.join(", "),
            3600.0 / report.seconds_per_step,
            minutes
        ));
    }

    fn validated(&self, step: u64, validation: &Validation) {
        let line = |name: &str, scores: Option<Scores>| {
            let Some(scores) = scores else { return format!("  {name}: no true depth to score against") };
            let normals = scores.normal_deg.map_or_else(String::new, |angle| format!("normals {angle:.2} deg, "));
            format!(
                "  {name}: {:.2} % within 1 %, median {:.3} %, {normals}calibration {:.3}",
                100.0 * scores.within_1pct,
                scores.median_pct,
                scores.calibration
            )
        };
        self.say(&format!("validation after step {step}"));
        self.say(&line("matching", validation.matching));
        self.say(&line("network ", validation.network));
        self.say(&line("matching, objects", validation.matching_objects));
        self.say(&line("network,  objects", validation.network_objects));
        if let Some(psnr) = validation.new_views_psnr {
            self.say(&format!("  new views: PSNR {psnr:.2} dB"));
        }
    }
}
