//! Bounding boxes of meshes in STL and OBJ.

use std::fs;
use std::path::{Path, PathBuf};

/// A larger mesh is not read: its box is no better than that of a small one.
const LARGEST: u64 = 64 << 20;
/// Header and count of a binary STL, and the bytes of a triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Corners of a box along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
}

/// The box around a mesh.
///
/// # Errors
/// Why there is none.
pub(super) fn bounds(file: &Path, name: &str, packages: &[PathBuf]) -> Result<Bounds, String> {
    let path =
        found(file, name, packages).ok_or_else(|| format!("its mesh `{name}` is not found"))?;
    let size = fs::metadata(&path).map_or(0, |m| m.len());
    if size > LARGEST {
        return Err(format!(
            "its mesh `{name}` has {size} bytes, more than {LARGEST}"
        ));
    }
    let bytes = fs::read(&path).map_err(|e| format!("its mesh `{name}` cannot be read: {e}"))?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let points = match extension.to_ascii_lowercase().as_str() {
        "stl" => stl(&bytes),
        "obj" => numbers_after(&String::from_utf8_lossy(&bytes), "v"),
        _ => return Err(format!("its mesh `{name}` is neither STL nor OBJ")),
    };
    around(&points).ok_or_else(|| format!("its mesh `{name}` has no finite points"))
}

/// The file of a path as it is written: `package://name/rest`, `file://…`, or relative to the file.
fn found(file: &Path, name: &str, packages: &[PathBuf]) -> Option<PathBuf> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let candidate = |path: PathBuf| path.is_file().then_some(path);
    let rest = match name.split_once("://") {
        Some(("file", rest)) => return candidate(PathBuf::from(rest)),
        Some((_, rest)) => rest,
        None => return candidate(folder.join(name)),
    };
    // The package is a folder of its name, or the one that holds the file.
    let inner = rest.split_once('/').map_or(rest, |(_, inner)| inner);
    let near = folder.ancestors().map(Path::to_owned);
    packages
        .iter()
        .cloned()
        .chain(near)
        .find_map(|place| candidate(place.join(rest)).or_else(|| candidate(place.join(inner))))
}

/// Points of an STL, binary or text.
fn stl(bytes: &[u8]) -> Vec<[f64; 3]> {
    let count = bytes
        .get(80..HEADER)
        .and_then(|b| b.try_into().ok())
        .map_or(0, u32::from_le_bytes) as usize;
    let binary = count
        .checked_mul(TRIANGLE)
        .and_then(|n| n.checked_add(HEADER))
        .is_some_and(|n| n <= bytes.len() && count > 0);
    if !binary {
        return numbers_after(&String::from_utf8_lossy(bytes), "vertex");
    }
    let number = |b: &[u8]| {
        b.try_into()
            .map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)))
    };
    // Twelve bytes of the normal, then three corners, then two bytes.
    let triangles = bytes[HEADER..].chunks_exact(TRIANGLE).take(count);
    let corners = triangles.flat_map(|t| t[12..48].chunks_exact(12));
    corners
        .map(|c| [number(&c[..4]), number(&c[4..8]), number(&c[8..12])])
        .collect()
}

/// Three numbers after a word at the start of each line.
fn numbers_after(text: &str, word: &str) -> Vec<[f64; 3]> {
    let point = |line: &str| {
        let mut words = line.split_ascii_whitespace();
        (words.next()? == word).then_some(())?;
        let mut next = || words.next()?.parse::<f64>().ok();
        Some([next()?, next()?, next()?])
    };
    text.lines().filter_map(point).collect()
}

fn around(points: &[[f64; 3]]) -> Option<Bounds> {
    let mut out = Bounds {
        low: [f64::INFINITY; 3],
        high: [f64::NEG_INFINITY; 3],
    };
    for point in points {
        for (k, &x) in point.iter().enumerate() {
            (out.low[k], out.high[k]) = (out.low[k].min(x), out.high[k].max(x));
        }
    }
    let all = out.low.iter().chain(&out.high);
    all.copied().all(f64::is_finite).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::{around, numbers_after, stl};

    #[test]
    fn the_box_of_a_triangle_in_three_formats() {
        let corners = [[0.0_f32, 0.0, 1.0], [2.0, 0.0, -1.0], [0.0, 3.0, 0.5]];
        let mut binary = vec![0; 80];
        binary.extend(1_u32.to_le_bytes());
        binary.extend([0; 12]);
        for x in corners.iter().flatten() {
            binary.extend(x.to_le_bytes());
        }
        binary.extend([0; 2]);
        let text = |word: &str| -> String {
            let line = |c: &[f32; 3]| format!("  {word} {} {} {}\n", c[0], c[1], c[2]);
            corners.iter().map(line).collect()
        };
        for points in [
            stl(&binary),
            stl(format!("solid a\n{}endsolid", text("vertex")).as_bytes()),
            numbers_after(&text("v"), "v"),
        ] {
            let bounds = around(&points).expect("a box");
            assert_eq!(bounds.low, [0.0, 0.0, -1.0]);
            assert_eq!(bounds.high, [2.0, 3.0, 1.0]);
        }
        // Cut short: the count says more than there is.
        assert!(around(&stl(&binary[..100])).is_none());
    }
}
