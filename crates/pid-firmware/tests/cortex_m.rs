//! The six-axis arm on a Cortex-M: symbols, bytes and operations. Needs the target thumbv7em-none-eabihf, which
//! `.ci/firmware` installs.

mod common;

use std::path::Path;

use common::{arm6, cargo, files, prefix, text, with, write};
use object::{Object, ObjectSection, ObjectSymbol};
use pid_firmware::{Precision, Target};
use pid_interpret::nominal::{Nominal, declaration};
use pid_symbolic::{Cost, Graph};

const TARGET: &str = "thumbv7em-none-eabihf";

/// Effects as a diagnosis names them.
const NAMED: &[(&str, usize, &[f64])] = &[
    ("coulomb_asymmetry", 0, &[0.12]),
    ("load_dependent_friction", 1, &[0.1]),
    ("stribeck", 2, &[0.5, 0.08]),
    ("current_offset", 4, &[0.02]),
    ("payload", 0, &[1.5]),
];

/// A program for the target.
struct Firmware {
    /// Names and bytes of its symbols.
    symbols: Vec<(String, u64)>,
    /// Bytes of code and constants.
    bytes: u64,
}

impl Firmware {
    /// Builds a program whose loop runs `calls` among `items`, and nothing else.
    fn new(folder: &Path, dependency: &str, items: &str, calls: &str) -> Self {
        let manifest = format!(
            "[package]\nname = \"firmware\"\nversion = \"0.1.0\"\nedition = \"2024\"\n[dependencies]\n{dependency}\n\
             [profile.release]\npanic = \"abort\"\n[workspace]\n"
        );
        let main = format!(
            r#"#![no_std]
#![no_main]

use core::hint::black_box;

{items}

#[panic_handler]
fn stop(_: &core::panic::PanicInfo<'_>) -> ! {{
    loop {{}}
}}

#[unsafe(no_mangle)]
pub extern "C" fn _start() -> ! {{
    loop {{
        {calls}
    }}
}}
"#
        );
        std::fs::create_dir_all(folder.join("src")).expect("made");
        std::fs::write(folder.join("Cargo.toml"), manifest).expect("written");
        std::fs::write(folder.join("src/main.rs"), main).expect("written");
        cargo(folder, &["build", "--target", TARGET]);
        let path = folder.join(format!("target/{TARGET}/release/firmware"));
        let bytes = std::fs::read(path).expect("a program");
        let elf = object::File::parse(&*bytes).expect("an ELF");
        let named = elf
            .symbols()
            .filter_map(|s| Some((s.name().ok()?.to_owned(), s.size())));
        let kept = |name: &str| [".text", ".rodata"].contains(&name);
        let sections = elf.sections().filter(|s| kept(s.name().unwrap_or("")));
        Self {
            symbols: named.collect(),
            bytes: sections.map(|s| s.size()).sum(),
        }
    }

    /// Bytes of the functions whose name has a part.
    fn size(&self, part: &str) -> u64 {
        let own = self.symbols.iter().filter(|(name, _)| name.contains(part));
        own.map(|(_, size)| size).sum()
    }

    /// Symbols whose name has a part.
    fn naming(&self, part: &str) -> Vec<&str> {
        let all = self.symbols.iter().map(|(name, _)| name.as_str());
        all.filter(|name| name.contains(part)).collect()
    }
}

/// The dependency on an exported crate in `robot`, and the calls of its functions.
fn exported(folder: &Path, nominal: &Nominal, precision: Precision) -> (String, String, String) {
    let files = files(nominal, Target::Rust, precision);
    write(&folder.join("robot"), &files);
    let own = format!("{}_feed_forward", prefix(&files));
    let calls = format!(
        "let (q, v, a, u) = black_box(([0.0; {own}::N], [0.0; {own}::N], [0.0; {own}::N], [0.0; {own}::N]));
        black_box({own}::residual(&q, &v, &a, &u));
        black_box({own}::feed_forward(&q, &v, &a));"
    );
    let about = text(&files, "lib.rs").lines();
    let mut operations =
        about.filter_map(|line| line.strip_prefix("//! Operations of the residual: "));
    (
        format!("{own} = {{ path = \"robot\" }}"),
        calls,
        operations
            .next()
            .expect("a count")
            .trim_end_matches('.')
            .to_owned(),
    )
}

#[test]
#[ignore = "needs the target thumbv7em-none-eabihf; .ci/firmware runs it"]
fn the_residual_of_a_six_axis_arm_has_no_panics_on_a_cortex_m() {
    for (nominal, what) in [
        (arm6(), "arm6"),
        (with(&arm6(), NAMED), "arm6 with five effects"),
    ] {
        for precision in [Precision::F32, Precision::F64] {
            let folder = tempfile::tempdir().expect("a folder");
            let (dependency, calls, operations) = exported(folder.path(), &nominal, precision);
            let firmware = Firmware::new(folder.path(), &dependency, "", &calls);
            let (torque, residual) = (firmware.size("torque"), firmware.size("residual"));
            // The functions are there, so a panic in them would be.
            assert!(residual > 0 && torque > 1000, "{:?}", firmware.symbols);
            assert_eq!(firmware.naming("panic"), [""; 0]);
            assert_eq!(firmware.naming("alloc"), [""; 0]);
            eprintln!(
                "{what}, {precision:?}: residual {} bytes, {operations} operations; with feed-forward and libm {} bytes",
                torque + residual,
                firmware.bytes
            );
        }
    }
}

/// What the other test looks for is found where it is.
#[test]
#[ignore = "needs the target thumbv7em-none-eabihf; .ci/firmware runs it"]
fn a_panic_would_be_among_the_symbols() {
    let folder = tempfile::tempdir().expect("a folder");
    let (dependency, calls, _) = exported(folder.path(), &arm6(), Precision::F32);
    let calls = calls + " black_box(q[black_box(0_usize)]);";
    let firmware = Firmware::new(folder.path(), &dependency, "", &calls);
    assert!(!firmware.naming("panicking").is_empty());
}

/// The same arm as `robot!` writes it, its 84 parameters arguments.
#[test]
#[ignore = "needs the target thumbv7em-none-eabihf; .ci/firmware runs it"]
fn a_declared_six_axis_arm_has_no_panics_on_a_cortex_m() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    // One folder for all runs: the compiler of robots is built once.
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("declared");
    let dependency = format!(
        "pid-runtime = {{ path = {:?}, default-features = false }}",
        root.join("pid-runtime")
    );
    let items = format!(
        "#[path = {:?}]\nmod arm6;\nuse arm6::{{Arm6, Arm6Inputs, Arm6Params}};",
        root.join("models/src/arm6.rs")
    );
    let calls = "let (q, v, a, u) = black_box(([0.0; 6], [0.0; 6], [0.0; 6], [0.0; 6]));
        let p = black_box(Arm6Params::nominal());
        black_box(Arm6::residual(&q, &v, &a, &Arm6Inputs::from_array(u), &p));
        black_box(Arm6::inverse_dynamics(&q, &v, &a, &p));
        black_box(Arm6::mass_matrix(&q, &p));
        black_box(Arm6::inverse_dynamics_derivatives(&q, &v, &a, &p));";
    let firmware = Firmware::new(&folder, &dependency, &items, calls);
    let residual = firmware.size("residual_values");
    assert!(residual > 1000, "{:?}", firmware.symbols);
    assert_eq!(firmware.naming("panic"), [""; 0]);
    assert_eq!(firmware.naming("alloc"), [""; 0]);
    let mut g = Graph::new();
    let robot = declaration(&pid_models::Arm6).expect("a declaration");
    let equations = pid_derive::equations(&mut g, &robot).expect("equations");
    eprintln!(
        "robot! Arm6, f64: residual {residual} bytes, {} operations; with M, first derivatives and libm {} bytes",
        Cost::of(&g, &equations.residual),
        firmware.bytes
    );
}

#[test]
#[ignore = "needs the target thumbv7em-none-eabihf; .ci/firmware runs it"]
fn the_static_library_has_the_functions_of_the_header() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = files(&with(&arm6(), NAMED), Target::Rust, Precision::F32);
    write(folder.path(), &files);
    let library = [
        "rustc",
        "--features",
        "c",
        "--crate-type",
        "staticlib",
        "--target",
        TARGET,
    ];
    cargo(folder.path(), &library);
    let archive = format!("target/{TARGET}/release/libarm6_feed_forward.a");
    let bytes = std::fs::read(folder.path().join(archive)).expect("an archive");
    let archive = object::read::archive::ArchiveFile::parse(&*bytes).expect("an archive");
    let mut defined = Vec::new();
    for member in archive.members() {
        let data = member.expect("a member").data(&*bytes).expect("bytes");
        let object = object::File::parse(data).expect("an object");
        let own = object
            .symbols()
            .filter(|s| s.is_definition() && s.is_global());
        defined.extend(own.filter_map(|s| s.name().ok().map(str::to_owned)));
    }
    for name in ["inverse_dynamics", "feed_forward", "residual"] {
        let name = format!("arm6_{name}");
        assert!(text(&files, ".h").contains(&format!("bool {name}(")));
        assert!(defined.contains(&name), "{name}");
    }
}
