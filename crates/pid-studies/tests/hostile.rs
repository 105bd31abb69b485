//! Hostile input: small valid files, cut, flipped, swapped, repeated and with absurd counts, go to every reader.
//! A reader answers with a value or an error, never with a panic, and asks for memory by the size of the file.
//!
//! `HOSTILE=N cargo test --release -p pid-studies --test hostile -- --nocapture` draws N inputs for each reader
//! in place of the few of the normal tests, and prints a table. `HOSTILE_SEED` is the seed of all draws, and
//! `HOSTILE_ONLY` names the one reader that is asked. An input that a reader fails at is kept for a look at it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use peak_alloc::PeakAlloc;
use pid_data::{Dataset, InputQuantity};
use pid_interpret::nominal::Nominal;
use pid_logs::{Joint, Settings};
use pid_mjcf::Mjcf;
use pid_urdf::mesh::Mesh;
use pid_urdf::{Description, Guess, Missing, Reading};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Inputs for each reader in the normal tests.
const FEW: usize = 300;
/// Bytes that a reader may hold at once: so many beside, and so many for each byte of the file. Packed
/// records unpack to a hundred times their size and are held as text and as numbers.
const BESIDE: usize = 64 << 20;
const EACH: usize = 1000;

/// Panics so far, those that a reader catches of its parser too.
static PANICS: AtomicUsize = AtomicUsize::new(0);

const URDF: &str = r#"<robot name="r"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5" rpy="0 0.1 0"/>
<mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"><collision><origin xyz="0 0 1"/><geometry><box size="1 2 3"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="3" velocity="2"/><dynamics damping="0.1" friction="0.2"/></joint>
<joint name="k" type="prismatic"><parent link="rod"/><child link="tip"/><mimic joint="j" multiplier="2"/></joint></robot>"#;

const MJCF: &str = r#"<mujoco model="m"><compiler angle="radian" eulerseq="xyz" meshdir="parts"/><option gravity="0 0 -9.81"/>
<default><geom density="100"/><default class="c"><joint armature="0.1"/></default></default>
<asset><mesh name="w" vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 2 1 0 1 3 0 3 2 1 2 3"/></asset>
<worldbody><body name="a" pos="0 0 1" childclass="c"><joint name="j" axis="0 1 0" range="-1 1"/>
<inertial pos="0 0 0.1" mass="2" diaginertia="0.03 0.02 0.01"/><replicate count="3" offset="1 0 0" euler="0 0 0.1">
<body name="b" quat="1 0 0 0"><joint name="k" type="slide"/><geom type="box" size="0.1" fromto="0 0 0 0 0 1"/>
<geom type="mesh" mesh="w"/></body></replicate></body></worldbody>
<actuator><motor joint="j" gear="2" ctrlrange="-1 1"/><position joint="k" kp="3"/></actuator></mujoco>"#;

const DATASET: &str = r#"name = "hostile"
title = "a record"
source = "a test"
license = "as this program"
kind = "simulated"
input_hold = "zero-order"

[[joint]]
name = "j1"
type = "revolute"
input = "torque"
input_unit = "N*m"
velocity = "absent"

[[experiment]]
file = "a.csv"
role = "train"
sample_time_s = 0.01
samples = 5
note = ""
"#;

const RECORD: &str = "t,q1,u1\n0.0,0.0,1.0\n0.01,0.1,1.5\n0.02,0.3,\n0.03,0.6,2.0\n0.04,0.7,1e-3\n";

const OBJ: &str =
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1/1 2/2 4/4\nf -4 -1 -2\nf 2 3 4\n";

/// Whether something was read of some bytes.
type Read = dyn Fn(&[u8]) -> bool;

/// A name, the bytes of a valid file, and what reads them.
struct Reader {
    name: String,
    valid: Vec<u8>,
    read: Box<Read>,
}

impl Reader {
    fn new(name: &str, valid: impl Into<Vec<u8>>, read: impl Fn(&[u8]) -> bool + 'static) -> Self {
        Self {
            name: name.to_owned(),
            valid: valid.into(),
            read: Box::new(read),
        }
    }

    fn of_text(name: &str, valid: &str, read: impl Fn(&str) -> bool + 'static) -> Self {
        Self::new(name, valid, move |bytes| {
            read(&String::from_utf8_lossy(bytes))
        })
    }
}

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(path)
}

fn robots() -> Vec<Reader> {
    let urdf = |text: &str| {
        let mut reading = Reading::default();
        reading.missing = Missing::Guess(Guess::default());
        let read = Description::parse_with("a.urdf", text, &reading);
        read.is_ok_and(|robot| !robot.mechanism([0.0, 0.0, -9.81]).bodies.is_empty())
    };
    let mjcf = |text: &str| Mjcf::parse("a.xml", text).is_ok();
    let nominal = std::fs::read_to_string(here("examples/arm3/nominal.toml")).unwrap();
    let parse = |text: &str| Nominal::parse("nominal.toml", text).is_ok();
    let mut packed: Vec<u8> = [3_u32, 0, 0, 1]
        .iter()
        .flat_map(|n| n.to_le_bytes())
        .collect();
    packed.extend(
        [0.0_f32, 0.0, 1.0, 2.0, 0.0, -1.0, 0.0, 3.0, 0.5]
            .iter()
            .flat_map(|x| x.to_le_bytes()),
    );
    packed.extend([0_u32, 1, 2].iter().flat_map(|n| n.to_le_bytes()));
    let mut stl = vec![0; 80];
    stl.extend(2_u32.to_le_bytes());
    stl.extend([1; 100]);
    let mesh = |extension: &'static str| {
        move |bytes: &[u8]| Mesh::parse(bytes, extension).is_ok_and(|m| !m.triangles.is_empty())
    };
    vec![
        Reader::of_text("URDF", URDF, urdf),
        Reader::of_text("MJCF", MJCF, mjcf),
        Reader::of_text("nominal TOML", &nominal, parse),
        Reader::new("mesh, OBJ", OBJ, mesh("obj")),
        Reader::new("mesh, STL", stl, mesh("stl")),
        Reader::new("mesh, MSH", packed, mesh("msh")),
    ]
}

/// A folder of a data set, with either file changed.
fn datasets() -> Vec<Reader> {
    let read = |toml: &str, csv: &str| {
        Dataset::from_embedded(&[("dataset.toml", toml), ("a.csv", csv)]).is_ok()
    };
    vec![
        Reader::of_text("dataset TOML", DATASET, move |text| read(text, RECORD)),
        Reader::of_text("dataset CSV", RECORD, move |text| read(DATASET, text)),
    ]
}

/// What a log gives goes on to a data set.
fn record(logs: Result<Vec<pid_logs::Log>, pid_logs::LogError>) -> bool {
    let joints = [Joint::revolute("shoulder"), Joint::revolute("elbow")];
    let settings = Settings {
        input: Some(InputQuantity::Torque),
        ..Settings::default()
    };
    logs.is_ok_and(|logs| {
        let _ = pid_logs::from_logs(&logs, &joints, &settings);
        true
    })
}

fn logs() -> Vec<Reader> {
    let fixture = |name: &str| here("crates/pid-logs/tests/fixtures").join(name);
    let files = [
        "plotjuggler.csv",
        "savetxt.txt",
        "joint_states_zstd.mcap",
        "joint_states_plain.mcap",
        "controller_state.mcap",
        "table.parquet",
        "lists.parquet",
        "arrays.npz",
        "packed.npz",
        "arrays.mat",
        "packed.mat",
        "joint_states.db3",
    ];
    let mut out: Vec<Reader> = (files.iter())
        .map(|&name| {
            let valid = std::fs::read(fixture(name)).unwrap();
            Reader::new(name, valid, move |bytes| {
                record(pid_logs::parse(name, bytes.to_vec()))
            })
        })
        .collect();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("hostile-lerobot");
    for part in ["meta", "data/chunk-000"] {
        std::fs::create_dir_all(folder.join(part)).unwrap();
    }
    let data = "data/chunk-000/file-000.parquet";
    std::fs::copy(fixture("lerobot").join(data), folder.join(data)).unwrap();
    let info = std::fs::read(fixture("lerobot/meta/info.json")).unwrap();
    out.push(Reader::new("LeRobot info.json", info, move |bytes| {
        std::fs::write(folder.join("meta/info.json"), bytes).unwrap();
        record(pid_logs::open(&folder))
    }));
    out
}

/// A file with some of its bytes changed, cut, swapped, repeated or replaced by counts.
fn mutated(valid: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = valid.to_vec();
    for _ in 0..rng.random_range(1..6) {
        if bytes.is_empty() {
            break;
        }
        let at = rng.random_range(0..bytes.len());
        let end = rng.random_range(at..bytes.len().min(at + 64)) + 1;
        match rng.random_range(0..10) {
            0 => bytes[at] = rng.random(),
            1 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let part = bytes[at..end].to_vec();
                let times = rng.random_range(1..40);
                bytes.splice(at..at, part.repeat(times));
            }
            5 => bytes[at..end].reverse(),
            6 => {
                let other = rng.random_range(0..bytes.len());
                bytes.swap(at, other);
            }
            7 => rng.fill_bytes(&mut bytes[at..end]),
            8 => {
                let count: u64 =
                    [0, 1, 0x7fff_ffff, 0xffff_fff0, 1 << 20, u64::MAX][rng.random_range(0..6)];
                let width = [2, 4, 8][rng.random_range(0..3)];
                let words = bytes[at..].iter_mut().zip(count.to_le_bytes());
                words.take(width).for_each(|(b, v)| *b = v);
            }
            _ => number(&mut bytes, at, rng),
        }
    }
    bytes
}

/// Puts an absurd number in the place of the next one that is written in digits.
fn number(bytes: &mut Vec<u8>, at: usize, rng: &mut ChaCha8Rng) {
    const NUMBERS: [&str; 9] = [
        "-1",
        "0",
        "1e308",
        "1e-320",
        "nan",
        "inf",
        "4294967295",
        "199999",
        "99999999999999999999",
    ];
    let digit = |b: &u8| b.is_ascii_digit();
    let Some(start) = bytes[at..].iter().position(digit) else {
        return;
    };
    let start = at + start;
    let length = bytes[start..].iter().take_while(|b| digit(b)).count();
    let value = NUMBERS[rng.random_range(0..NUMBERS.len())].bytes();
    bytes.splice(start..start + length, value);
}

/// What became of the inputs of a reader.
#[derive(Default)]
struct Count {
    inputs: usize,
    read: usize,
    /// Inputs at which a panic left the reader.
    panics: Vec<Vec<u8>>,
    /// Inputs at which a reader turned a panic of its parser into an error.
    caught: usize,
    /// Most bytes held at once beside the input, and those allowed for that input.
    most: (usize, usize),
    /// Most bytes over those allowed, and the input where that is more than one.
    share: f64,
    beyond: Option<Vec<u8>>,
    slowest: f64,
}

fn run(reader: &Reader, inputs: usize, seed: u64) -> Count {
    let salt =
        (reader.name.bytes()).fold(seed, |a, b| a.wrapping_mul(31).wrapping_add(u64::from(b)));
    let mut rng = ChaCha8Rng::seed_from_u64(salt);
    let mut out = Count::default();
    for _ in 0..inputs {
        let bytes = mutated(&reader.valid, &mut rng);
        let before = (MEMORY.current_usage(), PANICS.load(Ordering::Relaxed));
        MEMORY.reset_peak_usage();
        let start = Instant::now();
        let read = catch_unwind(AssertUnwindSafe(|| (reader.read)(&bytes)));
        out.slowest = out.slowest.max(start.elapsed().as_secs_f64());
        let held = MEMORY.peak_usage().saturating_sub(before.0);
        let allowed = BESIDE + EACH * bytes.len();
        if held > out.most.0 {
            out.most = (held, allowed);
        }
        let share = held as f64 / allowed as f64;
        if share > out.share.max(1.0) {
            out.beyond = Some(bytes.clone());
        }
        out.share = out.share.max(share);
        out.inputs += 1;
        match read {
            Ok(read) => {
                out.read += usize::from(read);
                out.caught += usize::from(PANICS.load(Ordering::Relaxed) > before.1);
            }
            Err(_) => out.panics.push(bytes),
        }
    }
    out
}

/// Keeps an input for a look at it; says where.
fn kept(reader: &str, bytes: &[u8]) -> String {
    let name = format!("hostile-{}", reader.replace([' ', ','], "-"));
    let path = std::env::temp_dir().join(name);
    match std::fs::write(&path, bytes) {
        Ok(()) => format!("kept as {}", path.display()),
        Err(e) => format!("and it cannot be kept as {}: {e}", path.display()),
    }
}

#[test]
fn readers_answer_whatever_the_bytes() {
    let from = |name: &str| std::env::var(name).ok().and_then(|n| n.parse::<u64>().ok());
    let inputs = from("HOSTILE").map_or(FEW, |n| n as usize);
    let seed = from("HOSTILE_SEED").unwrap_or(1);
    let only = std::env::var("HOSTILE_ONLY").ok();
    let asked = |reader: &Reader| only.as_ref().is_none_or(|name| *name == reader.name);
    let all = robots().into_iter().chain(datasets()).chain(logs());
    let readers: Vec<Reader> = all.filter(asked).collect();
    assert!(!readers.is_empty(), "no reader is called {only:?}");
    std::panic::set_hook(Box::new(|_| {
        PANICS.fetch_add(1, Ordering::Relaxed);
    }));
    let mut table = format!(
        "{:<24} {:>9} {:>9} {:>9} {:>7} {:>7} {:>10} {:>10}\n",
        "reader", "inputs", "errors", "read", "panics", "caught", "most, MB", "slowest, s"
    );
    let mut faults = Vec::new();
    for reader in readers {
        assert!(
            (reader.read)(&reader.valid),
            "{} reads what is valid",
            reader.name
        );
        let count = run(&reader, inputs, seed);
        let (panics, name) = (count.panics.len(), &reader.name);
        table += &format!(
            "{name:<24} {:>9} {:>9} {:>9} {panics:>7} {:>7} {:>10.2} {:>10.3}\n",
            count.inputs,
            count.inputs - count.read - panics,
            count.read,
            count.caught,
            count.most.0 as f64 / 1e6,
            count.slowest
        );
        if let Some(bytes) = count.panics.first() {
            faults.push(format!("{name}: a panic, {}", kept(name, bytes)));
        }
        if let Some(bytes) = &count.beyond {
            let share = count.share;
            faults.push(format!(
                "{name}: {share:.1} times the bytes allowed are held, {}",
                kept(name, bytes)
            ));
        }
        if inputs >= FEW && (count.read == 0 || count.read == inputs) {
            faults.push(format!(
                "{name}: {} of {inputs} are read; errors and reads both count",
                count.read
            ));
        }
    }
    let _ = std::panic::take_hook();
    eprintln!("seed {seed}\n{table}");
    assert!(faults.is_empty(), "{table}\n{}", faults.join("\n"));
}
