//! Reader of binary glTF 2.0: triangles, texture coordinates and base colour, nothing else.
//!
//! Leaves out what scans do not use: node transforms (must be baked in), sparse or strided accessors,
//! external buffers. Invariant: indices of a returned primitive are in range, positions are finite.

use serde::Deserialize;

/// The meshes of a GLB file.
#[derive(Debug)]
pub struct Glb<'a> {
    /// All primitives of all meshes.
    pub primitives: Vec<Primitive>,
    /// Encoded images (JPEG or PNG), as referred to by [`Primitive::image`].
    pub images: Vec<&'a [u8]>,
}

/// Triangles of one material.
#[derive(Debug)]
pub struct Primitive {
    /// Vertex positions, file units.
    pub positions: Vec<[f32; 3]>,
    /// Texture coordinates per vertex, (0, 0) top left; empty when the file has none.
    pub uvs: Vec<[f32; 2]>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Linear factor of the base colour.
    pub base_colour: [f32; 3],
    /// Index of the base colour's image.
    pub image: Option<usize>,
    /// Roughness in \[0, 1\].
    pub roughness: f32,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
#[derive(Default)]
struct Document {
    accessors: Vec<Accessor>,
    buffer_views: Vec<BufferView>,
    images: Vec<Image>,
    textures: Vec<Texture>,
    materials: Vec<Material>,
    meshes: Vec<Mesh>,
    nodes: Vec<serde_json::Map<String, serde_json::Value>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: usize,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    r#type: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Image {
    buffer_view: Option<usize>,
}

#[derive(Deserialize)]
struct Texture {
    source: Option<usize>,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Material {
    pbr_metallic_roughness: Pbr,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Pbr {
    base_color_factor: Option<[f32; 4]>,
    base_color_texture: Option<TextureInfo>,
    roughness_factor: Option<f32>,
}

#[derive(Deserialize)]
struct TextureInfo {
    index: usize,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<MeshPrimitive>,
}

#[derive(Deserialize)]
struct MeshPrimitive {
    attributes: std::collections::BTreeMap<String, usize>,
    indices: Option<usize>,
    material: Option<usize>,
    mode: Option<u32>,
}

const MAGIC: &[u8; 4] = b"glTF";
const JSON_CHUNK: u32 = 0x4e4f_534a;
const TRIANGLES: u32 = 4;

/// Reads a GLB file.
///
/// # Errors
/// A sentence about the first problem found.
pub fn read_glb(bytes: &[u8]) -> Result<Glb<'_>, String> {
    let (json, binary) = chunks(bytes)?;
    let document: Document = serde_json::from_slice(json).map_err(|e| format!("its JSON is not glTF 2.0 ({e})"))?;
    let moved = ["matrix", "rotation", "translation", "scale"];
    if document.nodes.iter().any(|node| moved.iter().any(|key| node.contains_key(*key))) {
        return Err("a node has a transform; bake transforms into the vertices first".into());
    }
    let reader = Reader { document: &document, binary };
    let primitives = document.meshes.iter().flat_map(|mesh| &mesh.primitives).map(|p| reader.primitive(p));
    let primitives = primitives.collect::<Result<Vec<_>, _>>()?;
    let images = document.images.iter().map(|image| {
        let view = image.buffer_view.ok_or("an image lies outside the file; embed it")?;
        reader.view(view)
    });
    Ok(Glb { primitives, images: images.collect::<Result<_, String>>()? })
}

/// The JSON and the binary chunk.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), String> {
    let word = |at: usize| -> Result<u32, String> {
        let four = bytes.get(at..at + 4).ok_or("the file ends in its header")?;
        Ok(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
    };
    if bytes.get(..4) != Some(MAGIC.as_slice()) || word(4)? != 2 {
        return Err("it is not a binary glTF 2.0 file".into());
    }
    let json_length = word(12)? as usize;
    if word(16)? != JSON_CHUNK {
        return Err("its first chunk is not JSON".into());
    }
    let json = bytes.get(20..20 + json_length).ok_or("the file ends in its JSON chunk")?;
    let binary = bytes.get(20 + json_length + 8..).unwrap_or(&[]);
    Ok((json, binary))
}

struct Reader<'a, 'd> {
    document: &'d Document,
    binary: &'a [u8],
}

impl<'a> Reader<'a, '_> {
    fn primitive(&self, primitive: &MeshPrimitive) -> Result<Primitive, String> {
        if primitive.mode.unwrap_or(TRIANGLES) != TRIANGLES {
            return Err("a primitive is not made of plain triangles".into());
        }
        let position = primitive.attributes.get("POSITION").ok_or("a primitive has no positions")?;
        let positions: Vec<[f32; 3]> = self.floats(*position, "VEC3")?;
        if positions.iter().flatten().any(|v| !v.is_finite()) {
            return Err("a vertex position is not a finite number".into());
        }
        let uvs: Vec<[f32; 2]> = match primitive.attributes.get("TEXCOORD_0") {
            Some(&accessor) => self.floats(accessor, "VEC2")?,
            None => Vec::new(),
        };
        if uvs.iter().flatten().any(|v| !v.is_finite()) {
            return Err("a texture coordinate is not a finite number".into());
        }
        if !uvs.is_empty() && uvs.len() != positions.len() {
            return Err("a primitive has more positions than texture coordinates, or fewer".into());
        }
        let indices = match primitive.indices {
            Some(accessor) => self.indices(accessor)?,
            None => (0..positions.len() as u32).collect(),
        };
        if indices.iter().any(|&i| i as usize >= positions.len()) {
            return Err("a triangle refers to a vertex that does not exist".into());
        }
        let triangles = indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        let material = primitive.material.and_then(|m| self.document.materials.get(m));
        let pbr = material.map(|m| &m.pbr_metallic_roughness);
        let factor = pbr.and_then(|p| p.base_color_factor).unwrap_or([1.0; 4]);
        let texture = pbr.and_then(|p| p.base_color_texture.as_ref());
        let image = texture.and_then(|info| self.document.textures.get(info.index)?.source);
        Ok(Primitive {
            positions,
            uvs,
            triangles,
            base_colour: [factor[0], factor[1], factor[2]],
            image: image.filter(|&i| i < self.document.images.len()),
            roughness: pbr.and_then(|p| p.roughness_factor).unwrap_or(1.0),
        })
    }

    fn view(&self, index: usize) -> Result<&'a [u8], String> {
        let view = self.document.buffer_views.get(index).ok_or("a buffer view does not exist")?;
        if view.byte_stride.is_some() {
            return Err("interleaved vertices are not supported".into());
        }
        let end = view.byte_offset.checked_add(view.byte_length).ok_or("a buffer view is too large")?;
        self.binary.get(view.byte_offset..end).ok_or_else(|| "a buffer view lies outside the file".into())
    }

    fn elements(&self, index: usize, size: impl Fn(&Accessor) -> Option<usize>) -> Result<(&'a [u8], u32), String> {
        let accessor = self.document.accessors.get(index).ok_or("an accessor does not exist")?;
        let size = size(accessor).ok_or("an accessor has an unexpected type")?;
        let length = accessor.count.checked_mul(size).ok_or("an accessor is too large")?;
        let end = accessor.byte_offset.checked_add(length).ok_or("an accessor is too large")?;
        let view = self.view(accessor.buffer_view)?;
        let bytes = view.get(accessor.byte_offset..end).ok_or("an accessor lies outside its buffer view")?;
        Ok((bytes, accessor.component_type))
    }

    fn floats<const N: usize>(&self, index: usize, kind: &str) -> Result<Vec<[f32; N]>, String> {
        const FLOAT: u32 = 5126;
        let (bytes, _) = self.elements(index, |a| (a.component_type == FLOAT && a.r#type == kind).then_some(4 * N))?;
        let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        Ok(bytes.chunks_exact(4 * N).map(|e| std::array::from_fn(|i| number(&e[4 * i..]))).collect())
    }

    fn indices(&self, index: usize) -> Result<Vec<u32>, String> {
        let width = |kind: u32| match kind {
            5121 => Some(1),
            5123 => Some(2),
            5125 => Some(4),
            _ => None,
        };
        let (bytes, kind) = self.elements(index, |a| width(a.component_type).filter(|_| a.r#type == "SCALAR"))?;
        let little_endian = |b: &[u8]| b.iter().rev().fold(0u32, |value, &byte| value << 8 | u32::from(byte));
        Ok(bytes.chunks_exact(width(kind).unwrap_or(4)).map(little_endian).collect())
    }
}
