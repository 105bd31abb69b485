//! Drives on joints, from the elements of the file.

use pid_derive::mechanism::Body;

use crate::actuator::Actuator;
use crate::element::Element;
use crate::error::MjcfError;
use crate::reader::Reader;

/// Words with a law of their own; others are named in a warning.
const KINDS: [&str; 5] = ["motor", "position", "velocity", "general", "damper"];

impl Reader {
    /// Drives on joints; others are warnings.
    pub(crate) fn actuators(&mut self, root: &Element) -> Result<(), MjcfError> {
        let all: Vec<&Element> = root.all("actuator").flat_map(|a| &a.children).collect();
        for element in all {
            let drive = self.defaults.applied(element, None)?;
            if !KINDS.contains(&drive.name.as_str()) {
                self.warn(
                    &drive,
                    "is not read: its force depends on more than the joint's motion",
                );
                continue;
            }
            let Some(joint) = drive.get("joint").or(drive.get("jointinparent")) else {
                self.warn(&drive, "moves no single joint; it is not read");
                continue;
            };
            if self.balls.iter().any(|name| name == joint) {
                self.warn(
                    &drive,
                    "turns a ball joint about an axis of its own; it is not read",
                );
                continue;
            }
            let Some(body) = self.joint_names.iter().position(|name| name == joint) else {
                self.warn(
                    &drive,
                    "moves a joint that is held or not there; it is not read",
                );
                continue;
            };
            if drive.get("dyntype").is_some_and(|kind| kind != "none") {
                self.warn(&drive, "has a state of its own; its force is read without");
            }
            let (gain, bias) = self.law(&drive)?;
            let gear = drive.list("gear")?.and_then(|x| x.first().copied());
            let actuator = Actuator {
                name: drive.get("name").unwrap_or("").to_owned(),
                kind: drive.name.clone(),
                body,
                gear: gear.unwrap_or(1.0),
                gain,
                bias,
                control: self.range(&drive, "ctrlrange", "ctrllimited")?,
                force: self.range(&drive, "forcerange", "forcelimited")?,
            };
            self.actuators.push(actuator);
        }
        self.efforts();
        Ok(())
    }

    /// Gain and bias of an element.
    fn law(&mut self, drive: &Element) -> Result<(f64, [f64; 3]), MjcfError> {
        let number = |key: &str, default: f64| -> Result<f64, MjcfError> {
            Ok(drive.number(key)?.unwrap_or(default))
        };
        let (kp, kv) = match drive.name.as_str() {
            "motor" => return Ok((1.0, [0.0; 3])),
            "position" => (number("kp", 1.0)?, number("kv", 0.0)?),
            "velocity" => {
                let kv = number("kv", 1.0)?;
                return Ok((kv, [0.0, 0.0, -kv]));
            }
            "damper" => {
                self.warn(drive, "damps by its control, which is not read");
                return Ok((0.0, [0.0; 3]));
            }
            _ => {
                let gain = drive.list("gainprm")?.unwrap_or_else(|| vec![1.0]);
                if gain.iter().skip(1).any(|x| *x != 0.0)
                    && drive.get("gaintype").is_some_and(|kind| kind != "fixed")
                {
                    self.warn(
                        drive,
                        "has a gain that depends on the motion; its constant part is read",
                    );
                }
                let stated = drive.list("biasprm")?.unwrap_or_default();
                let affine = drive.get("biastype") == Some("affine");
                let bias =
                    [0, 1, 2].map(|k| stated.get(k).copied().filter(|_| affine).unwrap_or(0.0));
                return Ok((gain.first().copied().unwrap_or(1.0), bias));
            }
        };
        if drive.get("dampratio").is_some() {
            self.warn(drive, "has a damping ratio, which is not read; state `kv`");
        }
        if drive.get("inheritrange").is_some() {
            self.warn(drive, "inherits its control range, which is not read");
        }
        Ok((kp, [0.0, -kp, -kv]))
    }

    /// The largest forces of joints: what their drives together can do, and what the joint allows.
    fn efforts(&mut self) {
        for (k, body) in self.bodies.iter_mut().enumerate() {
            let own: Vec<&crate::Actuator> =
                self.actuators.iter().filter(|a| a.body == k).collect();
            let each: Option<Vec<f64>> = own.iter().map(|a| a.effort()).collect();
            let sum = each
                .filter(|all| !all.is_empty())
                .map(|all| all.iter().sum());
            limit(body, sum);
        }
    }
}

fn limit(body: &mut Body, effort: Option<f64>) {
    body.effort = match (body.effort, effort) {
        (Some(x), Some(y)) => Some(x.min(y)),
        (x, y) => x.or(y),
    };
}
