//! Models with values and elements changed at random are read or refused, without a panic.

use pid_mjcf::{Mjcf, MjcfError};
use pid_symbolic::random::Random;

const MODEL: &str = r#"<mujoco model="m"><compiler angle="radian" eulerseq="xyz" autolimits="true" settotalmass="3"/>
<option gravity="0 0 -9.81" timestep="0.002"/>
<default><joint damping="1"/><geom density="100"/><default class="c"><joint armature="0.1"/></default></default>
<worldbody><body name="a" pos="0 0 1" childclass="c"><joint name="j" axis="0 1 0" range="-1 1" ref="0.1"/>
<inertial pos="0 0 0.1" mass="2" diaginertia="0.03 0.02 0.01"/>
<frame euler="0 0.1 0"><body name="b" quat="1 0 0 0"><joint name="k" type="slide" pos="0 0.1 0"/><joint name="l" class="c"/>
<geom type="capsule" size="0.1" fromto="0 0 0 0 0 1"/><geom type="box" size="0.1 0.2 0.3" mass="1"/></body></frame></body>
<body name="free"><freejoint/><geom size="0.1"/></body></worldbody>
<actuator><motor joint="j" gear="2" ctrlrange="-1 1"/><position joint="k" kp="3"/></actuator></mujoco>"#;

const VALUES: [&str; 24] = [
    "nan",
    "inf",
    "1e999",
    "-1",
    "0",
    "1e308",
    "1e-320",
    "0 0 0",
    "1 2",
    "1e300 1e300 1e300",
    "",
    " ",
    "j",
    "box",
    "mesh",
    "ball",
    "free",
    "c",
    "true",
    "xyz",
    "zZx",
    "é",
    "0 0 0 0",
    "radian",
];

fn index(random: &mut Random, len: usize) -> usize {
    (random.uniform(0.0, len as f64) as usize).min(len.saturating_sub(1))
}

fn mutated(random: &mut Random) -> String {
    let mut text = MODEL.to_owned();
    for _ in 0..1 + index(random, 3) {
        if random.uniform(0.0, 1.0) < 0.75 {
            let quotes: Vec<usize> = text.match_indices('"').map(|(k, _)| k).collect();
            let k = 2 * index(random, quotes.len() / 2);
            text.replace_range(
                quotes[k] + 1..quotes[k + 1],
                VALUES[index(random, VALUES.len())],
            );
        } else {
            let ends: Vec<usize> = text.match_indices("/>").map(|(k, _)| k).collect();
            let end = ends[index(random, ends.len())];
            let start = text[..end].rfind('<').unwrap_or(end);
            let element = text[start..end + 2].to_owned();
            if random.uniform(0.0, 1.0) < 0.5 {
                text.replace_range(start..end + 2, "");
            } else {
                text.insert_str(start, &element);
            }
        }
    }
    text
}

#[test]
fn mutated_models_are_read_or_refused() {
    let mut random = Random::new(4);
    let (mut read, mut refused) = (0, 0);
    for _ in 0..5_000 {
        match Mjcf::parse("fuzz.xml", &mutated(&mut random)) {
            Ok(model) => {
                read += 1;
                assert!(!model.mechanism.bodies.is_empty());
            }
            Err(MjcfError::Xml { error, .. }) => panic!("no mutation breaks the XML: {error}"),
            Err(error) => {
                refused += 1;
                assert!(error.to_string().starts_with("fuzz.xml"), "{error}");
            }
        }
    }
    // Both ends are reached, so the mutations reach past the first checks.
    assert!(read > 500 && refused > 500, "{read} {refused}");
}
