//! Where the network computes: the CPU, or a graphics card if this build knows it.
//!
//! `named` turns a name of the command line into a device that has been tried; `check` compares every kind of
//! operator there with the CPU. Invariant: a device that `named` returns has computed something.

mod cases;
mod check;

pub use check::{Check, check};

use burn::tensor::{Device, Tensor};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

/// Kinds of devices that a build may lack, each named like the feature that brings it.
const FEATURES: [&str; 3] = ["cuda", "vulkan", "wgpu"];

/// Why a device cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// No such name.
    #[error("device {0}: there is cpu, cuda (cuda:1 for the second card), vulkan and wgpu")]
    Unknown(String),
    /// The build lacks it.
    #[error("device {name}: this build does not know it; build with `--features {feature}`")]
    NotBuilt {
        /// As asked for.
        name: String,
        /// Of the crate `surfelsplat`.
        feature: &'static str,
    },
    /// It does not work here.
    #[error("device {name} does not work here ({reason}); --device cpu does")]
    Unusable {
        /// As asked for.
        name: String,
        /// In the words of its driver.
        reason: String,
    },
}

/// The device of that name: `cpu`, `cuda`, `cuda:N`, `vulkan` or `wgpu`.
///
/// # Errors
/// [`DeviceError`] for other names, for devices this build does not know, and for those that do not answer.
pub fn named(name: &str) -> Result<Device, DeviceError> {
    let unknown = || DeviceError::Unknown(name.to_owned());
    let (kind, number) = match name.split_once(':') {
        Some((kind, number)) => (kind, Some(number.parse::<usize>().map_err(|_| unknown())?)),
        None => (name, None),
    };
    let open = || match (kind, number) {
        ("cpu", None) => Ok(Device::flex()),
        #[cfg(feature = "cuda")]
        ("cuda", number) => Ok(Device::cuda(number.unwrap_or(0))),
        #[cfg(feature = "vulkan")]
        ("vulkan", None) => Ok(Device::vulkan(burn::tensor::DeviceKind::DefaultDevice)),
        #[cfg(feature = "wgpu")]
        ("wgpu", None) => Ok(Device::wgpu(burn::tensor::DeviceKind::DefaultDevice)),
        _ => {
            // What comes here is not built, for what is built was met above.
            let feature = FEATURES.into_iter().find(|feature| *feature == kind);
            let feature = feature.filter(|feature| number.is_none() || *feature == "cuda").ok_or_else(unknown)?;
            Err(DeviceError::NotBuilt { name: name.to_owned(), feature })
        }
    };
    tried(name, open)
}

/// Opens a device and adds two numbers there. Drivers that are missing make burn panic, hence the catching.
fn tried(name: &str, open: impl FnOnce() -> Result<Device, DeviceError>) -> Result<Device, DeviceError> {
    let addition = || {
        let device = open()?;
        let two = Tensor::<1>::ones([1], &device) + 1.0;
        Ok((two.into_scalar::<f32>() == 2.0, device))
    };
    // What a failing driver says belongs into our sentence, not between the lines of the console. It fails on a thread
    // of its own; the panic that reaches us only says that this thread is gone.
    let first = Arc::new(Mutex::new(None));
    let told = first.clone();
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let mut first = told.lock().unwrap_or_else(PoisonError::into_inner);
        first.get_or_insert_with(|| words(panic.payload()));
    }));
    let outcome = catch_unwind(AssertUnwindSafe(addition));
    std::panic::set_hook(hook);
    let first = first.lock().unwrap_or_else(PoisonError::into_inner).take();
    let unusable = |reason: String| DeviceError::Unusable { name: name.to_owned(), reason };
    match outcome {
        Ok(Ok((true, device))) => Ok(device),
        Ok(Ok((false, _))) => Err(unusable("it says that 1 + 1 is not 2".to_owned())),
        Ok(Err(error)) => Err(error),
        Err(panic) => Err(unusable(first.unwrap_or_else(|| words(&*panic)))),
    }
}

/// The first line of a panic's message.
fn words(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    text.and_then(|text| text.lines().next()).unwrap_or("it gave no reason").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_to_devices_or_to_a_sentence() {
        assert_eq!(named("cpu").unwrap(), Device::flex());
        for name in ["gpu", "cuda:one", "cpu:1", ""] {
            assert_eq!(named(name).unwrap_err(), DeviceError::Unknown(name.to_owned()));
        }
        #[cfg(not(feature = "cuda"))]
        assert!(named("cuda:1").unwrap_err().to_string().contains("--features cuda"));
        assert_eq!(named("vulkan:1").unwrap_err(), DeviceError::Unknown("vulkan:1".to_owned()));
    }

    #[test]
    fn a_device_that_breaks_says_why() {
        let error = tried("broken", || panic!("no driver\nbacktrace")).unwrap_err();
        assert_eq!(error, DeviceError::Unusable { name: "broken".to_owned(), reason: "no driver".to_owned() });
    }
}
