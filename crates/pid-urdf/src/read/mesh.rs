//! Bounding boxes of meshes, and where the files lie.

use std::fs;
use std::path::{Component, Path, PathBuf};

use crate::mesh::Mesh;

/// Corners of a box along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
}

/// The box around a mesh, and where the mesh was where its path leads nowhere.
///
/// # Errors
/// Why there is none.
pub(super) fn bounds(
    file: &Path,
    name: &str,
    packages: &[PathBuf],
) -> Result<(Bounds, Option<PathBuf>), String> {
    let direct = found(file, name, packages);
    let moved = match direct {
        Some(_) => None,
        None => elsewhere(file, name),
    };
    let path = direct
        .or_else(|| moved.clone())
        .ok_or_else(|| format!("its mesh `{name}` is not found"))?;
    let mesh = Mesh::read(&path).map_err(|why| format!("its mesh `{name}` {why}"))?;
    let bounds = around(&mesh.points);
    let bounds = bounds.ok_or_else(|| format!("its mesh `{name}` has no finite points"))?;
    Ok((bounds, moved))
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

/// Folder that holds the meshes of a package, by custom.
const MESHES: &str = "meshes";
/// Folders above the file in which it is looked for, folders in each other below it, and most entries seen.
const ABOVE: usize = 3;
const BELOW: usize = 6;
const MOST: usize = 20_000;

/// The one file below the `meshes` folder of the package whose path ends as the written one does, for
/// paths that lost their beginning. Several such files are none: nothing tells which is meant.
fn elsewhere(file: &Path, name: &str) -> Option<PathBuf> {
    let rest = Path::new(name.split_once("://").map_or(name, |(_, rest)| rest));
    let mut words = rest.components();
    words
        .all(|c| matches!(c, Component::Normal(_)))
        .then_some(())?;
    let folder = file.parent()?;
    let meshes = folder.ancestors().take(ABOVE).map(|f| f.join(MESHES));
    let meshes = meshes.into_iter().find(|f| f.is_dir())?;
    let (mut out, mut left) = (Vec::new(), MOST);
    below(&meshes, rest, BELOW, &mut left, &mut out);
    let one = out.pop()?;
    out.is_empty().then_some(one)
}

/// Files below a folder whose path ends with `rest`. Links to folders are not followed.
fn below(folder: &Path, rest: &Path, depth: usize, left: &mut usize, out: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        if *left == 0 {
            return;
        }
        *left -= 1;
        let (path, kind) = (entry.path(), entry.file_type());
        match kind {
            Ok(kind) if kind.is_dir() && depth > 0 => below(&path, rest, depth - 1, left, out),
            Ok(kind) if kind.is_file() && path.ends_with(rest) => out.push(path),
            _ => {}
        }
    }
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
