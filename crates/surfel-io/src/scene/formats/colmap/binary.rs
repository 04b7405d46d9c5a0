//! COLMAP's binary files, little endian.
//!
//! Counts in the headers are never trusted: nothing is reserved for them, and every read is checked
//! against the bytes that are there.

use super::camera::{camera, model_of_id};
use super::{Cameras, ModelImage, ModelPoint, pose};
use crate::scene::error::Fault;
use glam::DVec3;

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    fn take(&mut self, len: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(len).filter(|&end| end <= self.bytes.len());
        let end = end.ok_or_else(|| {
            Fault::text(format!("is cut short: {} bytes, more expected at byte {}", self.bytes.len(), self.at))
        })?;
        let slice = &self.bytes[self.at..end];
        self.at = end;
        Ok(slice)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, Fault> {
        self.array().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, Fault> {
        self.array().map(f64::from_le_bytes)
    }

    fn f64s<const N: usize>(&mut self) -> Result<[f64; N], Fault> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Skips `count` records of `size` bytes.
    fn skip(&mut self, count: u64, size: usize) -> Result<(), Fault> {
        let len = usize::try_from(count).ok().and_then(|count| count.checked_mul(size));
        self.take(len.unwrap_or(usize::MAX)).map(|_| ())
    }

    fn c_string(&mut self) -> Result<String, Fault> {
        let len = self.bytes[self.at..].iter().position(|&byte| byte == 0);
        let len = len.ok_or_else(|| Fault::text(format!("is cut short: the name at byte {} has no end", self.at)))?;
        let name = String::from_utf8_lossy(self.take(len)?).into_owned();
        self.take(1)?;
        Ok(name)
    }
}

pub(in crate::scene::formats) fn parse_cameras(bytes: &[u8]) -> Result<(Cameras, Vec<String>), Fault> {
    let mut reader = Reader::new(bytes);
    let (mut cameras, mut warnings) = (Cameras::new(), Vec::new());
    for _ in 0..reader.u64()? {
        let id = reader.u32()?;
        let (model, num_parameters) = model_of_id(i32::from_le_bytes(reader.array()?))?;
        let size = (reader.u64()?, reader.u64()?);
        let mut parameters = Vec::with_capacity(num_parameters);
        for _ in 0..num_parameters {
            parameters.push(reader.f64()?);
        }
        cameras.insert(id, camera(id, model, size, &parameters, &mut warnings)?);
    }
    Ok((cameras, warnings))
}

pub(in crate::scene::formats) fn parse_images(bytes: &[u8]) -> Result<Vec<ModelImage>, Fault> {
    let mut reader = Reader::new(bytes);
    let mut images = Vec::new();
    for _ in 0..reader.u64()? {
        let id = reader.u32()?;
        let numbers = reader.f64s::<7>()?;
        let camera_id = reader.u32()?;
        let name = reader.c_string()?;
        let num_points = reader.u64()?;
        // x, y as f64 and a point id each.
        reader.skip(num_points, 24)?;
        images.push(ModelImage { id, camera_id, camera_from_world: pose(&name, &numbers)?, name });
    }
    Ok(images)
}

pub(in crate::scene::formats) fn parse_points(bytes: &[u8]) -> Result<Vec<ModelPoint>, Fault> {
    let mut reader = Reader::new(bytes);
    let mut points = Vec::new();
    for _ in 0..reader.u64()? {
        reader.u64()?;
        let position = DVec3::from_array(reader.f64s()?);
        // Colour and reprojection error.
        reader.skip(1, 3 + 8)?;
        let mut image_ids = Vec::new();
        for _ in 0..reader.u64()? {
            image_ids.push(reader.u32()?);
            reader.u32()?;
        }
        points.push(ModelPoint { position, image_ids });
    }
    Ok(points)
}
