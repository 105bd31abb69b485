//! Short forms of `pid-studies robot-files` and `pid-studies faults`.

use std::fs;
use std::path::PathBuf;

use pid_studies::faults;
use pid_studies::robot_files::{Format, Outcome, read_all, table};
use pid_urdf::Reading;
use pid_withheld::{Drawing, Plan};

const URDF: &str = r#"<robot name="r"><link name="base"/><link name="rod">
<inertial><origin xyz="0 0 -0.5"/><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="rod"/></joint></robot>"#;

#[test]
fn robots_of_a_folder_are_counted_once_each_and_by_what_became_of_them() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("robot-files");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(folder.join("deep")).unwrap();
    let write = |name: &str, text: &str| fs::write(folder.join(name), text).unwrap();
    write("a.urdf", URDF);
    write("deep/copy.urdf", URDF);
    write("still.urdf", &URDF.replace("revolute", "fixed"));
    write(
        "b.urdf",
        &URDF
            .replace("<inertial>", "<!--")
            .replace("</inertial>", "-->"),
    );
    write("package.xml", "<package/>");
    let body = "<body><joint/><geom size=\"0.1\"/></body>";
    write(
        "part.xml",
        &format!("<mujoco><worldbody>{body}</worldbody></mujoco>"),
    );
    write(
        "whole.xml",
        "<?xml version=\"1.0\"?><mujoco><include file=\"part.xml\"/></mujoco>",
    );
    let rows = read_all(&folder, &Reading::default()).unwrap();
    let of = |name: &str| {
        &rows
            .iter()
            .find(|r| r.file.ends_with(name))
            .unwrap()
            .outcome
    };
    assert_eq!(rows.len(), 4, "{rows:?}");
    assert!(matches!(of("a.urdf"), Outcome::Read { joints: 1, .. }));
    assert_eq!(of("still.urdf"), &Outcome::Still);
    assert!(matches!(of("b.urdf"), Outcome::Refused { kind, .. } if kind == "NoInertia"));
    assert!(matches!(of("whole.xml"), Outcome::Read { joints: 1, .. }));
    assert_eq!(rows.iter().filter(|r| r.format == Format::Mjcf).count(), 1);
    assert!(
        table(&rows).contains("Urdf, NoInertia: 1"),
        "{}",
        table(&rows)
    );
}

#[test]
fn planted_faults_are_found_and_clean_records_have_none() {
    let plan = Plan {
        seed: 11,
        cases: 3,
        fewest: 1,
        joints: 2,
        causes: Drawing::All,
    };
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("faults");
    let cases: Vec<faults::Case> = (0..plan.cases)
        .map(|i| faults::case(&plan, i, &folder).unwrap())
        .collect();
    let planted: Vec<_> = cases.iter().filter_map(|c| c.planted.as_ref()).collect();
    assert_eq!(planted.len(), 3);
    assert!(
        planted.iter().all(|p| p.named && p.others == 0),
        "{cases:?}"
    );
    assert!(cases.iter().all(|c| c.clean.is_none()), "{cases:?}");
    let text = faults::table(&cases);
    assert!(text.contains("all                     3      3"), "{text}");
}
