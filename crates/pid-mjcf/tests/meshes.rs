//! Masses and inertias of meshes, against those of bodies by hand.

mod common;

use common::{body_of, close, hinge, model, read};
use pid_mjcf::Mjcf;

/// A cuboid of 2 x 4 x 6 as a mesh, off its frame, turned, scaled, of a stated mass: the inertia of a box.
#[test]
fn meshes_are_filled() {
    let corner = |k: usize| [1, 2, 4].map(|bit| if k & bit == 0 { 0.0 } else { 1.0 });
    let vertices: Vec<String> = (0..8)
        .map(|k| corner(k).map(|x| x.to_string()).join(" "))
        .collect();
    let faces = "0 2 3 0 3 1 4 5 7 4 7 6 0 1 5 0 5 4 2 6 7 2 7 3 0 4 6 0 6 2 1 3 7 1 7 5";
    let asset = |more: &str| {
        format!(
            "<asset><mesh name=\"m\" scale=\"2 4 6\" vertex=\"{}\" face=\"{faces}\" {more}/></asset>",
            vertices.join(" ")
        )
    };
    let geom = "<geom type=\"mesh\" mesh=\"m\" pos=\"0 0 1\" euler=\"90 0 0\"/>";
    let of = |geom: &str, more: &str| body_of(&model(&hinge(geom), &asset(more)));
    let filled = of(geom, "");
    close(&[filled.mass], &[48_000.0]);
    // The z axis of the mesh points along -y.
    close(&filled.com, &[1.0, -3.0, 3.0]);
    let moments = [16.0 + 36.0, 4.0 + 16.0, 4.0 + 36.0].map(|x| 4000.0 * x);
    let expected = [moments[0], moments[1], moments[2], 0.0, 0.0, 0.0];
    // In t m².
    let tons = |x: [f64; 6]| x.map(|x| x / 1000.0);
    close(&tons(filled.inertia), &tons(expected));
    let exact = of(geom, "inertia=\"exact\"").inertia;
    close(&tons(exact), &tons(expected));
    let stated = of(&geom.replace("/>", " mass=\"3\"/>"), "");
    close(&[stated.mass], &[3.0]);
    close(&stated.inertia, &expected.map(|x| x / 16_000.0));
    // The frame of the mesh half way along its first edge.
    let moved = of(geom, "refpos=\"0.5 0 0\"");
    close(&moved.com, &[0.0, -3.0, 3.0]);
    // The surface of 88 square metres.
    close(&[of(geom, "inertia=\"shell\"").mass], &[88_000.0]);
    // Faces the other way round enclose the same; files that are not there leave the mass out, with a word.
    let turned = asset("inertia=\"exact\"").replace("0 2 3 0 3 1", "0 3 2 0 1 3");
    assert!(body_of(&model(&hinge(geom), &turned)).mass < 48_000.0);
    let missing = "<asset><mesh name=\"m\" file=\"nowhere.stl\"/></asset>";
    let ball = "<geom size=\"0.1\" mass=\"2\"/>";
    let warned = read(&model(&hinge(&format!("{geom}{ball}")), missing));
    assert_eq!(warned.mechanism.bodies[0].mass, 2.0);
    assert!(
        warned.warnings[0].contains("is mesh `m`, which cannot be read"),
        "{:?}",
        warned.warnings
    );
}

/// A file beside the model, found by `meshdir`; its stem is its name.
#[test]
fn mesh_files_are_found() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("mjcf_meshes");
    std::fs::create_dir_all(folder.join("parts")).expect("a folder");
    let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    std::fs::write(folder.join("parts/tip.obj"), tetrahedron).expect("a mesh");
    let text = |compiler: &str, file: &str| {
        let rest = format!("<compiler {compiler}/><asset><mesh file=\"{file}\"/></asset>");
        model(
            &hinge("<geom type=\"mesh\" mesh=\"tip\" density=\"6\"/>"),
            &rest,
        )
    };
    for (compiler, file) in [
        ("meshdir=\"parts\"", "tip.obj"),
        ("assetdir=\"parts\"", "tip.obj"),
        ("", "parts/tip.obj"),
        ("meshdir=\"parts\" strippath=\"true\"", "C/D/tip.obj"),
    ] {
        let read = Mjcf::parse(folder.join("a.xml"), &text(compiler, file));
        let body = read.expect("a model").mechanism.bodies.remove(0);
        close(&[body.mass], &[1.0]);
        close(&body.com, &[0.25; 3]);
    }
}
