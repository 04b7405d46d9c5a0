//! COLMAP's text files.
//!
//! `images.txt` has two lines per image, the second of which may be empty or, from some exporters,
//! missing; names may hold spaces and folders.

use super::camera::camera;
use super::{Cameras, ModelImage, ModelPoint, pose};
use crate::scene::error::Fault;
use crate::scene::tokens::{at_line, content_lines, exactly, integer, number, numbers, utf8};
use glam::DVec3;

pub(in crate::scene::formats) fn parse_cameras(bytes: &[u8]) -> Result<(Cameras, Vec<String>), Fault> {
    let (mut cameras, mut warnings) = (Cameras::new(), Vec::new());
    for (line, text) in content_lines(utf8(bytes)?) {
        let mut read = || {
            let tokens: Vec<&str> = text.split_whitespace().collect();
            let [id, model, width, height, parameters @ ..] = &tokens[..] else {
                return Err(Fault::text("a camera needs an id, a model, a width, a height and parameters"));
            };
            let id = integer(id)?;
            let parameters = parameters.iter().map(|token| number(token)).collect::<Result<Vec<_>, _>>()?;
            let camera = camera(id, model, (integer(width)?, integer(height)?), &parameters, &mut warnings)?;
            cameras.insert(id, camera);
            Ok(())
        };
        read().map_err(at_line(line))?;
    }
    Ok((cameras, warnings))
}

pub(in crate::scene::formats) fn parse_images(bytes: &[u8]) -> Result<Vec<ModelImage>, Fault> {
    let mut images = Vec::new();
    let mut lines = utf8(bytes)?.lines().zip(1..).filter(|(line, _)| !line.starts_with('#')).peekable();
    while let Some((text, line)) = lines.next() {
        if text.trim().is_empty() {
            continue;
        }
        images.push(image(text.trim()).map_err(at_line(line))?);
        if lines.peek().is_some_and(|(next, _)| is_points_line(next)) {
            lines.next();
        }
    }
    Ok(images)
}

/// `x y point_id` triples; an image line has ten tokens or a name among them.
fn is_points_line(line: &str) -> bool {
    numbers(line).is_ok_and(|values| values.len() % 3 == 0)
}

fn image(text: &str) -> Result<ModelImage, Fault> {
    let mut rest = text;
    let mut token = || {
        let (word, tail) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
        rest = tail.trim_start();
        word
    };
    let id = integer(token())?;
    let mut values = Vec::with_capacity(7);
    for _ in 0..7 {
        values.push(number(token())?);
    }
    let camera_id = integer(token())?;
    if rest.is_empty() {
        return Err(Fault::text(format!("image {id} has no name")));
    }
    let camera_from_world = pose(rest, &exactly(&values, "a pose")?)?;
    Ok(ModelImage { id, camera_id, name: rest.to_owned(), camera_from_world })
}

pub(in crate::scene::formats) fn parse_points(bytes: &[u8]) -> Result<Vec<ModelPoint>, Fault> {
    let mut points = Vec::new();
    for (line, text) in content_lines(utf8(bytes)?) {
        points.push(point(text).map_err(at_line(line))?);
    }
    Ok(points)
}

fn point(text: &str) -> Result<ModelPoint, Fault> {
    let tokens: Vec<&str> = text.split_whitespace().collect();
    let [_id, x, y, z, _r, _g, _b, _error, track @ ..] = &tokens[..] else {
        return Err(Fault::text("a point needs an id, a position, a colour and an error"));
    };
    let position = DVec3::new(number(x)?, number(y)?, number(z)?);
    let image_ids = track.chunks(2).map(|pair| integer(pair[0])).collect::<Result<_, _>>()?;
    Ok(ModelPoint { position, image_ids })
}
