//! `surfelsplat weights info | verify | import | pack`.

use super::args::{
    NetPreset, WeightPrecision, WeightsCommand, WeightsFileArgs, WeightsImportArgs, WeightsInfoArgs, WeightsPackArgs,
};
use super::print_line;
use anyhow::{Context, Result, bail};
use serde_json::json;
use std::collections::BTreeMap;
use std::process::ExitCode;
use surfel_net::checkpoint::{self, About, Header, Precision};
use surfel_net::import::{Reference, Source, import};
use surfel_net::{Cost, Device, NetConfig, Preset, SurfelNet};

/// Fresh parameters are the same in every import.
const SEED: u64 = 1;
/// Size of the photographs that costs are stated for.
const COSTED_SIZE: (usize, usize) = (320, 256);

pub fn run(command: &WeightsCommand, json: bool, quiet: bool) -> Result<ExitCode> {
    match command {
        WeightsCommand::Info(args) => info(args, json),
        WeightsCommand::Verify(args) => verify(args, json, quiet),
        WeightsCommand::Import(args) => run_import(args, json, quiet),
        WeightsCommand::Pack(args) => pack(args, quiet),
    }
}

/// Tensors and values of one part of a network.
#[derive(Default, serde::Serialize)]
struct Part {
    tensors: usize,
    values: usize,
}

fn info(args: &WeightsInfoArgs, json: bool) -> Result<ExitCode> {
    let path = &args.file.file;
    let file = path.display();
    let source = Source::open(path)?;
    let header = source.header();
    let mut parts: BTreeMap<&str, Part> = BTreeMap::new();
    for name in source.names() {
        let part = parts.entry(name.split('.').next().unwrap_or_default()).or_default();
        part.tensors += 1;
        part.values += source.shape(name).unwrap_or_default().iter().product::<usize>();
    }
    let total = Part {
        tensors: parts.values().map(|part| part.tensors).sum(),
        values: parts.values().map(|part| part.values).sum(),
    };
    let cost = match args.cost {
        true => Cost::of(&header.net_config(&file.to_string())?, COSTED_SIZE)?,
        false => None,
    };
    if json {
        let Header { config, checksum, about, others } = &header;
        let document = json!({
            "file": path, "format": source.format(), "types": source.types(), "total": total, "parts": parts,
            "licence": about.licence, "data": about.data, "training": about.training,
            "checksum": checksum, "config": config, "others": others,
            "multiply_adds": cost.as_ref().map(|cost| cost.multiply_adds), "multiply_adds_at": COSTED_SIZE,
        });
        print_line(&serde_json::to_string_pretty(&document)?);
        return Ok(ExitCode::SUCCESS);
    }
    let whose = if header.config.is_some() { "weights of a surfel network" } else { "tensors of another program" };
    print_line(&format!("{file}: {whose}, {}", source.format()));
    let types = source.types().join(", ");
    print_line(&format!("{} tensors, {} values, stored as {types}", total.tensors, total.values));
    for (name, part) in &parts {
        print_line(&format!("  {name}: {} tensors, {} values", part.tensors, part.values));
    }
    if let Some(cost) = &cost {
        let (width, height) = COSTED_SIZE;
        let giga = cost.multiply_adds as f64 / 1e9;
        print_line(&format!("cost: {giga:.1} billion multiplications for two photographs of {width}x{height}"));
    }
    let Header { config, checksum, about, others } = &header;
    let named = [
        ("licence", &about.licence),
        ("data", &about.data),
        ("training", &about.training),
        ("checksum", checksum),
        ("configuration", config),
    ];
    let named = named.into_iter().filter_map(|(name, text)| Some((name, text.as_ref()?)));
    for (name, text) in named.chain(others.iter().map(|(name, text)| (name.as_str(), text))) {
        let several = if text.trim().contains('\n') { "\n" } else { " " };
        print_line(&format!("{name}:{several}{}", text.trim()));
    }
    Ok(ExitCode::SUCCESS)
}

fn verify(args: &WeightsFileArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let file = args.file.display();
    if !Source::open(&args.file)?.is_safetensors() {
        bail!("{file} is a PyTorch file; `verify` checks weights of this program, which `weights import` makes of it");
    }
    let found = checkpoint::verify(&args.file)?;
    if json {
        let document = json!({
            "file": args.file, "good": found.faults.is_empty(), "faults": found.faults,
            "tensors": found.num_tensors, "values": found.num_parameters, "has_checksum": found.has_checksum,
        });
        print_line(&serde_json::to_string_pretty(&document)?);
    } else if found.faults.is_empty() && !quiet {
        let (tensors, values) = (found.num_tensors, found.num_parameters);
        let checksum = if found.has_checksum { "the checksum is right" } else { "it states no checksum" };
        print_line(&format!(
            "{file} is good: {tensors} tensors of its configuration, {values} finite values, {checksum}"
        ));
    }
    if found.faults.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    if !json {
        found.faults.iter().for_each(|fault| print_line(fault));
        eprintln!("surfelsplat: {file} must not be used: {} fault(s)", found.faults.len());
    }
    Ok(ExitCode::from(1))
}

/// Writes trained weights again, with what people need to know of them.
fn pack(args: &WeightsPackArgs, quiet: bool) -> Result<ExitCode> {
    let device = Device::flex();
    let net = match &args.config {
        Some(path) => {
            let config = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
            let config = NetConfig::from_toml(&config).with_context(|| path.display().to_string())?;
            checkpoint::load(SurfelNet::new(config, &device)?, &args.file)?
        }
        None => SurfelNet::from_file(&args.file, &device)?,
    };
    let text = |path: &Option<std::path::PathBuf>| -> Result<Option<String>> {
        let read = |path: &std::path::PathBuf| {
            std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
        };
        path.as_ref().map(read).transpose()
    };
    let about = About { licence: args.licence.clone(), data: text(&args.data)?, training: text(&args.training)? };
    checkpoint::save_as(&net, &args.output, precision(args.precision), &about)?;
    if !quiet {
        print_line(&format!("{}: written", args.output.display()));
    }
    Ok(ExitCode::SUCCESS)
}

fn precision(precision: WeightPrecision) -> Precision {
    match precision {
        WeightPrecision::F16 => Precision::F16,
        WeightPrecision::F32 => Precision::F32,
    }
}

fn run_import(args: &WeightsImportArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let config = match &args.config {
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
            NetConfig::from_toml(&text).with_context(|| path.display().to_string())?
        }
        None => NetConfig::preset(match args.preset {
            NetPreset::Paper => Preset::Paper,
            NetPreset::Small => Preset::Small,
            NetPreset::Narrow => Preset::Narrow,
            NetPreset::Tiny => Preset::Tiny,
        }),
    };
    let device = Device::flex();
    device.seed(SEED);
    let mut source = Source::open(&args.source)?;
    let (net, report) = import(&mut source, config, &device)?;
    let whose = match report.reference {
        Reference::SurfelSplat => "SurfelSplat",
        Reference::MvSplat => "MVSplat",
        Reference::UniMatch => "UniMatch",
    };
    let name = args.source.file_name().unwrap_or(args.source.as_os_str()).to_string_lossy();
    let about = About {
        licence: args.licence.clone(),
        data: Some(format!("as {name}, weights of {whose}, of which {} tensors were taken", report.taken.len())),
        training: Some(report.notes.join("\n")).filter(|notes| !notes.is_empty()),
    };
    checkpoint::save_as(&net, &args.output, precision(args.precision), &about)?;
    if json {
        print_line(&serde_json::to_string_pretty(&json!({ "output": args.output, "report": report }))?);
    } else if !quiet {
        let (taken, fresh) = (report.taken.len(), report.missing.len());
        print_line(&format!("{}: {taken} parameters from {name} ({whose}), {fresh} fresh", args.output.display()));
        for (part, (taken, all)) in report.parts() {
            print_line(&format!("  {part}: {taken} of {all}"));
        }
        report.notes.iter().for_each(|note| print_line(&format!("note: {note}")));
        for (why, count) in report.reasons() {
            let example = report.left.iter().find(|left| left.why == why).map_or("", |left| &left.name);
            print_line(&format!("left: {count} tensors, such as {example}, which {why}"));
        }
    }
    Ok(ExitCode::SUCCESS)
}
