//! What `simtrue new` writes: the crate compiles and runs, the folder is identified and diagnosed.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The command, in a folder.
fn simtrue(folder: &Path, words: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_simtrue"));
    command.current_dir(folder).args(words.split(' '));
    command.output().expect("the command runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Asserts that a command ended well; what it printed.
fn done(output: &Output) -> String {
    let (out, told) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{out}\n{told}");
    out
}

/// Folder of the build that this test belongs to, and the name of its profile.
fn build() -> (PathBuf, String) {
    let program = Path::new(env!("CARGO_BIN_EXE_simtrue"));
    let profile = program.parent().expect("a folder of a profile");
    let name = profile.file_name().expect("its name").to_string_lossy();
    (
        profile.parent().expect("a target folder").to_owned(),
        name.into_owned(),
    )
}

/// Its source with its own names is the example `new_robot`, which every build compiles.
#[test]
#[ignore = "a workspace of its own compiles all crates once more"]
fn the_crate_compiles_and_lists_its_robot() {
    let folder = tempfile::tempdir().expect("a folder");
    let said = done(&simtrue(folder.path(), "new my-arm"));
    assert!(said.contains("cargo run --release -- models"), "{said}");
    let own = folder.path().join("my-arm");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    std::fs::copy(root.join("Cargo.lock"), own.join("Cargo.lock")).expect("the versions");
    let (target, profile) = build();
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .current_dir(&own)
        .args(["run", "--offline", "--quiet", "--target-dir"])
        .arg(target)
        .env("CARGO_PROFILE_RELEASE_DEBUG", "line-tables-only");
    if profile == "release" {
        cargo.arg("--release");
    }
    let listed = done(&cargo.args(["--", "models"]).output().expect("cargo runs"));
    assert!(
        listed.starts_with("my_arm: a link on a motor\n  joints: shoulder (rad)"),
        "{listed}"
    );
}

#[test]
fn names_that_no_crate_has_and_folders_in_use_are_told() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["2arm", "fn", "arm.2"] {
        let output = simtrue(folder.path(), &format!("new {name}"));
        let told = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{name}");
        assert!(
            told.contains(&format!("`{name}` is no name of a crate")),
            "{told}"
        );
    }
    std::fs::create_dir(folder.path().join("arm")).expect("a folder");
    std::fs::write(folder.path().join("arm/notes.txt"), "kept").expect("written");
    let told = text(&simtrue(folder.path(), "new arm").stderr);
    assert!(told.contains("the folder is not empty"), "{told}");
}

/// An arm of one joint that swings under a small torque, in degrees and milliseconds.
fn log(phase: f64) -> String {
    let (weight, inertia) = (6.0 * 9.81 * 0.17, 0.088 + 6.0 * 0.17 * 0.17);
    let (mut q, mut v, h) = (1.0_f64, 0.0_f64, 1e-3);
    let mut text = String::from("time_ms,shoulder_effort [Nm],shoulder_pos [deg]\n");
    for k in 0..2000 {
        let u = 3.0 * (0.004 * f64::from(k) + phase).sin();
        text.push_str(&format!("{k},{u},{}\n", q.to_degrees()));
        v += h * (u - 0.5 * v - 0.3 * (v / 0.06).tanh() - weight * q.sin()) / inertia;
        q += h * v;
    }
    text
}

const ARM: &str = r#"<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -0.17"/><mass value="6"/>
<inertia ixx="0.085" iyy="0.088" izz="0.012" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="40" velocity="3"/><dynamics damping="0.5" friction="0.3"/></joint></robot>"#;

#[test]
fn the_folder_of_a_robot_and_its_logs_is_identified_and_diagnosed() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("arm.urdf"), ARM).expect("written");
    for (name, phase) in [("a.csv", 0.0), ("b.csv", 1.0)] {
        std::fs::write(at.join(name), log(phase)).expect("written");
    }
    let said = done(&simtrue(at, "new arm --from arm.urdf a.csv b.csv"));
    let next: Vec<&str> = said
        .lines()
        .filter_map(|l| l.trim().strip_prefix("simtrue "))
        .collect();
    assert_eq!(next.len(), 2, "{said}");
    for words in next {
        let printed = done(&simtrue(at, &format!("{words} --json")));
        let result: serde_json::Value = serde_json::from_str(&printed).expect("JSON alone");
        assert!(result.is_object(), "{printed}");
    }
    for file in ["identified/identified.toml", "diagnosis/extended.toml"] {
        let path = at.join("arm").join(file);
        assert!(path.is_file(), "{}", path.display());
    }
}
