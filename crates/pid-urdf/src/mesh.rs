//! Triangles of mesh files in STL, OBJ and the format of MuJoCo.

use std::fs;
use std::path::Path;

/// Corners of a triangle.
pub type Triangle = [[f64; 3]; 3];

/// What a mesh file holds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Points, whether a triangle has them or not.
    pub points: Vec<[f64; 3]>,
    /// Triangles, in the order of the file. Faces of more corners are fans of them.
    pub triangles: Vec<Triangle>,
}

/// A larger mesh is not read: it says no more about a mass than a small one.
const LARGEST: u64 = 64 << 20;
/// Header and count of a binary STL, and the bytes of a triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

impl Mesh {
    /// Reads a file whose format its extension tells.
    ///
    /// # Errors
    /// Why there is no mesh, without the name of the file.
    pub fn read(path: &Path) -> Result<Self, String> {
        let size = fs::metadata(path).map_or(0, |m| m.len());
        if size > LARGEST {
            return Err(format!("has {size} bytes, more than {LARGEST}"));
        }
        let bytes = fs::read(path).map_err(|e| format!("cannot be read: {e}"))?;
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        Self::parse(&bytes, extension)
    }

    /// Reads bytes of a format by its extension: `stl`, `obj`, `msh`.
    ///
    /// # Errors
    /// Another extension.
    pub fn parse(bytes: &[u8], extension: &str) -> Result<Self, String> {
        match extension.to_ascii_lowercase().as_str() {
            "stl" => Ok(Self::of_corners(stl(bytes))),
            "obj" => Ok(obj(&String::from_utf8_lossy(bytes))),
            "msh" => msh(bytes).ok_or_else(|| "is cut short".to_owned()),
            _ => Err("is neither STL, OBJ nor MSH".to_owned()),
        }
    }

    /// Triangles whose corners follow each other.
    fn of_corners(points: Vec<[f64; 3]>) -> Self {
        let triangles = points.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        Self { points, triangles }
    }

    /// Points, and triangles by places among them; triangles with places beyond are left out.
    #[must_use]
    pub fn indexed(points: Vec<[f64; 3]>, faces: &[[usize; 3]]) -> Self {
        let corners = |face: &[usize; 3]| {
            let at = |k: usize| points.get(face[k]).copied();
            Some([at(0)?, at(1)?, at(2)?])
        };
        let triangles = faces.iter().filter_map(corners).collect();
        Self { points, triangles }
    }
}

/// Corners of an STL, binary or text.
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
    // Twelve bytes of the normal, then three corners, then two bytes.
    let triangles = bytes[HEADER..].chunks_exact(TRIANGLE).take(count);
    let corners = triangles.flat_map(|t| t[12..48].chunks_exact(12));
    corners.map(point).collect()
}

/// Three numbers of four bytes.
fn point(bytes: &[u8]) -> [f64; 3] {
    let number = |k: usize| {
        let word = bytes.get(4 * k..4 * k + 4).and_then(|b| b.try_into().ok());
        word.map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)))
    };
    [number(0), number(1), number(2)]
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

/// Points and faces of an OBJ. Places count from 1, negative ones from the last point before the face.
fn obj(text: &str) -> Mesh {
    let (mut before, mut faces) = (0, Vec::new());
    for line in text.lines() {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            // As many as `numbers_after` takes.
            Some("v") => before += numbers_after(line, "v").len(),
            Some("f") => {
                let place = |word: &str| {
                    let number: i64 = word.split('/').next()?.parse().ok()?;
                    let from = if number < 0 { before as i64 } else { -1 };
                    usize::try_from(from.checked_add(number)?).ok()
                };
                let corners: Vec<usize> = words.map_while(place).collect();
                let fan = corners.windows(2).skip(1);
                faces.extend(fan.map(|w| [corners[0], w[0], w[1]]));
            }
            _ => {}
        }
    }
    Mesh::indexed(numbers_after(text, "v"), &faces)
}

/// The binary format of MuJoCo: counts of points, normals, texture coordinates and faces, then these.
fn msh(bytes: &[u8]) -> Option<Mesh> {
    let word = |k: usize| -> Option<u32> {
        let word = bytes.get(4 * k..4 * k + 4)?;
        Some(u32::from_le_bytes(word.try_into().ok()?))
    };
    let count = |k: usize| word(k).map(|n| n as usize);
    let [points, normals, textures, faces] = [count(0)?, count(1)?, count(2)?, count(3)?];
    let bytes_of = |n: usize, each: usize| n.checked_mul(each);
    let first = 16_usize.checked_add(bytes_of(points, 12)?)?;
    let skipped = bytes_of(normals, 12)?.checked_add(bytes_of(textures, 8)?)?;
    let second = first.checked_add(skipped)?;
    let end = second.checked_add(bytes_of(faces, 12)?)?;
    let all = bytes.get(16..first)?.chunks_exact(12).map(point).collect();
    let corner = |b: &[u8]| {
        let word = |k: usize| b[4 * k..4 * k + 4].try_into().map(u32::from_le_bytes);
        [0, 1, 2].map(|k| word(k).map_or(usize::MAX, |n| n as usize))
    };
    let triangles: Vec<[usize; 3]> = bytes
        .get(second..end)?
        .chunks_exact(12)
        .map(corner)
        .collect();
    Some(Mesh::indexed(all, &triangles))
}

#[cfg(test)]
mod tests {
    use super::Mesh;

    #[test]
    fn a_triangle_in_four_formats() {
        let corners = [[0.0_f32, 0.0, 1.0], [2.0, 0.0, -1.0], [0.0, 3.0, 0.5]];
        let floats: Vec<u8> = (corners.iter().flatten())
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let mut binary = vec![0; 80];
        binary.extend(1_u32.to_le_bytes());
        binary.extend([0; 12]);
        binary.extend(&floats);
        binary.extend([0; 2]);
        let text = |word: &str| -> String {
            let line = |c: &[f32; 3]| format!("  {word} {} {} {}\n", c[0], c[1], c[2]);
            corners.iter().map(line).collect()
        };
        let mut packed: Vec<u8> = [3_u32, 0, 0, 1]
            .iter()
            .flat_map(|n| n.to_le_bytes())
            .collect();
        packed.extend(&floats);
        packed.extend([0_u32, 1, 2].iter().flat_map(|n| n.to_le_bytes()));
        let expected = corners.map(|c| c.map(f64::from));
        for (bytes, extension) in [
            (binary.clone(), "STL"),
            (
                format!("solid a\n{}endsolid", text("vertex")).into_bytes(),
                "stl",
            ),
            (format!("{}f 1/1 2//2 3\n", text("v")).into_bytes(), "obj"),
            (
                format!("{}f -3 -2 -1\nf 1 2 9\n", text("v")).into_bytes(),
                "obj",
            ),
            (packed.clone(), "msh"),
        ] {
            let mesh = Mesh::parse(&bytes, extension).expect("a mesh");
            assert_eq!(mesh.points, expected, "{extension}");
            assert_eq!(mesh.triangles, [expected], "{extension}");
        }
        // Cut short: the counts say more than there is.
        assert_eq!(Mesh::parse(&binary[..100], "stl"), Ok(Mesh::default()));
        assert!(Mesh::parse(&packed[..50], "msh").is_err());
        packed[..4].fill(0xff);
        assert!(Mesh::parse(&packed, "msh").is_err());
        assert!(Mesh::parse(&packed, "dae").is_err());
    }

    #[test]
    fn a_face_of_four_corners_is_two_triangles() {
        let mesh = Mesh::parse(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n", "obj");
        let p = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
        ];
        assert_eq!(
            mesh.expect("a mesh").triangles,
            [[p[0], p[1], p[2]], [p[0], p[2], p[3]]]
        );
    }
}
