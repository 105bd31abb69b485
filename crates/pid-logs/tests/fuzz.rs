//! Hostile and truncated files: whatever the bytes, the readers return. `PID_LOGS_FUZZ=N` runs N
//! cases of each file instead of the few of the normal tests.

use std::path::Path;

use pid_data::InputQuantity;
use pid_logs::{Entry, Joint, Settings, from_logs, parse};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Cases of each file in the normal tests.
const FEW: usize = 400;

fn cases() -> usize {
    std::env::var("PID_LOGS_FUZZ")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(FEW)
}

/// A file with some of its bytes changed, cut, doubled or moved.
fn mutated(valid: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = valid.to_vec();
    for _ in 0..rng.random_range(1..6) {
        if bytes.is_empty() {
            break;
        }
        let at = rng.random_range(0..bytes.len());
        let end = rng.random_range(at..bytes.len().min(at + 64)) + 1;
        match rng.random_range(0..9) {
            0 => bytes[at] = rng.random(),
            1 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            5 => bytes[at..end].fill(0),
            6 => bytes[at..end].fill(0xff),
            7 => rng.fill_bytes(&mut bytes[at..end]),
            _ => {
                // Lengths and counts.
                let value: u32 = [0, 1, 0x7fff_ffff, 0xffff_fff0, 1 << 20][rng.random_range(0..5)];
                for (b, v) in bytes[at..].iter_mut().zip(value.to_le_bytes()) {
                    *b = v;
                }
            }
        }
    }
    bytes
}

/// Reads mutated copies of a fixture; what is read goes on to a data set. Returns how many were read.
fn run(name: &str, share: usize) -> usize {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name);
    let valid = std::fs::read(path).unwrap();
    let joints = [Joint::revolute("shoulder"), Joint::revolute("elbow")];
    let settings = Settings {
        input: Some(InputQuantity::Torque),
        ..Settings::default()
    };
    let seed = name
        .bytes()
        .fold(7, |a: u64, b| a.wrapping_mul(31).wrapping_add(u64::from(b)));
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut read = 0;
    for _ in 0..cases().div_ceil(share) {
        if let Ok(logs) = parse(name, mutated(&valid, &mut rng)) {
            for log in &logs {
                for channel in &log.channels {
                    assert_eq!(
                        channel.values.len(),
                        log.clocks[channel.clock].rows,
                        "{name}: {}",
                        channel.name
                    );
                }
            }
            if let Err(error) = from_logs(&logs, &joints, &settings) {
                assert!(error.to_string().contains("help: "), "{error}");
            }
            read += 1;
        }
    }
    read
}

#[test]
fn names() {
    const PARTS: [&str; 34] = [
        "q",
        "Pos",
        "shoulder",
        "elbow",
        "1",
        "0",
        "01",
        "_",
        "/",
        ".",
        " ",
        "[",
        "]",
        "(",
        ")",
        "deg",
        "rad_s",
        "mA",
        "°",
        "İ",
        "ß",
        "é",
        "state",
        "reference",
        "effort",
        "torque",
        "t",
        "*",
        "=",
        "-",
        "data",
        "99999999999999999999",
        "sensor",
        "Nm",
    ];
    let joints = [Joint::revolute("shoulder"), Joint::revolute("elbow")];
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let name = |rng: &mut ChaCha8Rng| -> String {
        let length = rng.random_range(1..8);
        (0..length)
            .map(|_| PARTS[rng.random_range(0..PARTS.len())])
            .collect()
    };
    let mut read = 0;
    for _ in 0..10 * cases() {
        let header: Vec<String> = (0..3).map(|_| name(&mut rng)).collect();
        let header = format!("t\tq1\tq2\ttau1\ttau2\t{}", header.join("\t"));
        let rows: String = (0..3)
            .map(|i| format!("{i}{}\n", "\t1".repeat(7)))
            .collect();
        let logs = parse("log.tsv", format!("{header}\n{rows}").into_bytes()).unwrap_or_default();
        let entry = format!("q:{}={}", name(&mut rng), name(&mut rng));
        let map = Entry::parse(&entry)
            .ok()
            .filter(|_| rng.random())
            .into_iter()
            .collect();
        let settings = Settings {
            map,
            input: Some(InputQuantity::Torque),
            ..Settings::default()
        };
        read += usize::from(from_logs(&logs, &joints, &settings).is_ok());
    }
    assert!(read > 0, "most names say nothing of positions and inputs");
}

#[test]
fn texts() {
    assert!(run("savetxt.txt", 1) + run("plotjuggler.csv", 1) > 0);
}

#[test]
fn mcaps() {
    for name in [
        "joint_states_zstd.mcap",
        "joint_states_lz4.mcap",
        "joint_states_plain.mcap",
        "vendor.mcap",
    ] {
        run(name, 1);
    }
    assert!(run("controller_state.mcap", 1) + run("dynamic_joint_states.mcap", 1) > 0);
}

#[test]
fn bags() {
    assert!(run("joint_states.db3", 2) > 0);
}

#[test]
fn parquets() {
    run("table.parquet", 1);
    run("lists.parquet", 1);
}

#[test]
fn arrays() {
    for name in ["arrays.npz", "packed.npz", "arrays.mat", "packed.mat"] {
        run(name, 1);
    }
}
