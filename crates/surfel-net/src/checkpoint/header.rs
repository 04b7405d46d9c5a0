//! What a weights file says about itself: the `__metadata__` of safetensors, text under a few fixed keys.
//!
//! Invariant: keys are written in alphabetical order, which the safetensors crate does not promise.

use super::CheckpointError;
use crate::config::NetConfig;
use safetensors::SafeTensors;
use safetensors::tensor::Metadata;
use std::collections::BTreeMap;
use surfel_features::WeightsError;

const FORMAT: &str = "surfelsplat network 1";

/// What the person who writes weights may say about them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct About {
    /// Under which terms the weights may be used.
    pub licence: Option<String>,
    /// What they were trained on, or taken from.
    pub data: Option<String>,
    /// How they were trained, in a few lines.
    pub training: Option<String>,
}

/// The header of a weights file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// The configuration of the network, TOML.
    pub config: Option<String>,
    /// CRC-32 of all tensor bytes in file order, eight hexadecimal digits.
    pub checksum: Option<String>,
    /// Licence, data, training.
    pub about: About,
    /// Whatever else is written there, by key.
    pub others: BTreeMap<String, String>,
}

impl Header {
    /// Of a safetensors buffer; `file` is for messages. All fields are empty for files of other programs.
    ///
    /// # Errors
    /// [`WeightsError::Malformed`].
    pub fn of(file: &str, bytes: &[u8]) -> Result<Self, WeightsError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes)
            .map_err(|error| WeightsError::Malformed { file: file.to_owned(), reason: error.to_string() })?;
        Ok(Self::from_metadata(&metadata))
    }

    pub(crate) fn from_metadata(metadata: &Metadata) -> Self {
        let mut entries: BTreeMap<String, String> =
            metadata.metadata().iter().flatten().map(|(key, text)| (key.clone(), text.clone())).collect();
        entries.remove("format");
        let mut take = |key: &str| entries.remove(key);
        let about = About { licence: take("licence"), data: take("data"), training: take("training") };
        Self { config: take("config"), checksum: take("checksum"), about, others: entries }
    }

    /// The configuration it states.
    ///
    /// # Errors
    /// [`CheckpointError::NoConfig`] and [`CheckpointError::Config`].
    pub fn net_config(&self, file: &str) -> Result<NetConfig, CheckpointError> {
        let text = self.config.as_ref().ok_or_else(|| CheckpointError::NoConfig { file: file.to_owned() })?;
        NetConfig::from_toml(text).map_err(|source| CheckpointError::Config { file: file.to_owned(), source })
    }

    /// Puts the header into a safetensors buffer that has none.
    pub(super) fn insert_into(&self, buffer: &[u8]) -> Vec<u8> {
        let (length, rest) = buffer.split_at(8);
        let length = length.iter().rev().fold(0usize, |n, byte| n << 8 | usize::from(*byte));
        let (tensors, data) = rest.split_at(length);
        let tensors = tensors.trim_ascii().strip_prefix(b"{").expect("a header is a JSON object");
        let comma: &[u8] = if tensors.starts_with(b"}") { b"" } else { b"," };
        let entries = serde_json::to_vec(&self.entries()).expect("text is JSON");
        let mut header = [b"{\"__metadata__\":", entries.as_slice(), comma, tensors].concat();
        header.resize(header.len().next_multiple_of(8), b' ');
        [&(header.len() as u64).to_le_bytes(), header.as_slice(), data].concat()
    }

    fn entries(&self) -> BTreeMap<&str, &str> {
        let About { licence, data, training } = &self.about;
        let fixed = [
            ("checksum", &self.checksum),
            ("config", &self.config),
            ("data", data),
            ("licence", licence),
            ("training", training),
        ];
        let fixed = fixed.into_iter().filter_map(|(key, text)| Some((key, text.as_deref()?)));
        let others = self.others.iter().map(|(key, text)| (key.as_str(), text.as_str()));
        [("format", FORMAT)].into_iter().chain(fixed).chain(others).collect()
    }
}

/// The checksum of a safetensors buffer's tensor bytes.
pub(super) fn checksum(buffer: &[u8]) -> String {
    let header = buffer.first_chunk().map_or(0, |length| u64::from_le_bytes(*length) as usize);
    format!("{:08x}", crc32fast::hash(buffer.get(8 + header..).unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use safetensors::Dtype;
    use safetensors::tensor::TensorView;

    #[test]
    fn a_header_is_read_back_and_leaves_the_tensors_alone() {
        let data = [1u8, 2, 3];
        let tensors = || [("ä \"x\"", TensorView::new(Dtype::U8, vec![3], &data).unwrap())];
        let plain = safetensors::serialize(tensors(), None).unwrap();
        assert_eq!(Header::of("x", &plain).unwrap(), Header::default());
        let header = Header {
            config: Some("a = \"1\"\n".to_owned()),
            checksum: Some(checksum(&plain)),
            about: About { licence: Some("MIT".to_owned()), ..About::default() },
            others: BTreeMap::from([("note".to_owned(), "ü".to_owned())]),
        };
        let full = header.insert_into(&plain);
        assert_eq!(full, header.insert_into(&plain));
        assert_eq!(Header::of("x", &full).unwrap(), header);
        let read = SafeTensors::deserialize(&full).unwrap();
        assert_eq!(read.tensor("ä \"x\"").unwrap().data(), data);
        assert_eq!(checksum(&full), checksum(&plain));
        let empty = safetensors::serialize::<&str, TensorView, _>([], None).unwrap();
        assert_eq!(Header::of("x", &header.insert_into(&empty)).unwrap(), header);
    }
}
