//! A description as the text of its file: reading it again gives the same numbers.

use std::fmt::Write;

use pid_derive::model::{Expr, JointKind};

use super::{EncoderSide, Nominal, Role, Servo, Velocity, servo};

/// The fourteen values of a joint and how far each is trusted.
#[derive(Default, Clone)]
struct Values {
    mass: [f64; 2],
    com: [[f64; 2]; 3],
    inertia: [[f64; 2]; 6],
    rotor: [f64; 2],
    gain: [f64; 2],
    coulomb: [f64; 2],
    viscous: [f64; 2],
    sharpness: f64,
}

impl Nominal {
    /// The text of a file that states this description. Every value stands with a tolerance of its
    /// own, in `[joint.tolerance]`. `None` for a mechanism that such a file cannot state: one with
    /// followers, drives on several joints, or a potential.
    pub fn to_toml(&self) -> Option<String> {
        let joints = self.robot.joints.len();
        let each = |role| {
            let own = self.tolerances.iter().filter(|t| t.role == role);
            own.count() == joints
        };
        if self.drives.is_some() || !each(Role::Mass) || !each(Role::Gain) {
            return None;
        }
        let mut out = String::new();
        self.write_robot(&mut out);
        for joint in 0..self.robot.joints.len() {
            self.write_joint(&mut out, joint);
        }
        self.write_effects(&mut out);
        self.write_simulated(&mut out);
        Some(out)
    }

    fn write_robot(&self, out: &mut String) {
        let measurement = &self.measurement;
        line(out, "[robot]");
        line(out, &format!("name = {}", text(&self.robot.name)));
        let gravity = self.robot.gravity.each_ref().map(number);
        line(out, &format!("gravity = {gravity:?}"));
        if let Some(tool) = measurement.tool {
            line(out, &format!("tool = {tool:?}"));
        }
        let side = match measurement.encoder_side {
            EncoderSide::Motor => "motor",
            EncoderSide::Joint => "joint",
        };
        line(out, &format!("encoder_side = \"{side}\""));
        if let Some(hz) = self.filter_hz() {
            line(out, &format!("velocity_filter_hz = {hz:?}"));
        }
        if let Some(horizon) = measurement.horizon {
            line(out, &format!("horizon_s = {horizon:?}"));
        }
    }

    fn filter_hz(&self) -> Option<f64> {
        self.measurement
            .channels
            .iter()
            .find_map(|c| match c.velocity {
                Velocity::Derived { filter_hz } => filter_hz,
                _ => None,
            })
    }

    fn values(&self, joint: usize) -> Values {
        let mut values = Values::default();
        for t in self.tolerances.iter().filter(|t| t.joint == Some(joint)) {
            let both = [t.nominal, t.half_width];
            match t.role {
                Role::Mass => values.mass = both,
                Role::CenterOfMass(k) => values.com[k] = both,
                Role::Inertia(k) => values.inertia[k] = both,
                Role::RotorInertia => values.rotor = both,
                Role::Coulomb => values.coulomb = both,
                Role::Viscous => values.viscous = both,
                Role::Gain => values.gain = both,
                Role::Sharpness => values.sharpness = t.nominal,
                Role::Declared | Role::Servo(_) => {}
            }
        }
        values
    }

    fn write_joint(&self, out: &mut String, index: usize) {
        let joint = &self.robot.joints[index];
        let channel = &self.measurement.channels[index];
        let values = self.values(index);
        let (kind, axis) = match joint.kind {
            JointKind::Prismatic(axis) => ("prismatic", axis),
            JointKind::Revolute(axis) => ("revolute", axis),
            // A description has no other kinds.
            _ => ("revolute", [f64::NAN; 3]),
        };
        let parent = match joint.parent {
            Some(link) => self.robot.joints[link].name.as_str(),
            None => "base",
        };
        let unit = self.robot.inputs[index].unit.as_str();
        let input = match unit {
            "A" => "current",
            "V" => "voltage",
            "N" => "force",
            _ => "torque",
        };
        line(out, "\n[[joint]]");
        line(out, &format!("name = {}", text(&joint.name)));
        line(out, &format!("type = \"{kind}\""));
        line(out, &format!("axis = {axis:?}"));
        line(out, &format!("parent = {}", text(parent)));
        let (origin, rpy) = (joint.origin.each_ref(), joint.rpy.each_ref());
        line(out, &format!("origin = {:?}", origin.map(number)));
        line(out, &format!("rpy = {:?}", rpy.map(number)));
        if let Some((lower, upper)) = joint.limits {
            line(out, &format!("limits = [{lower:?}, {upper:?}]"));
        }
        for (which, place) in [("", 0), ("[joint.tolerance]", 1)] {
            if !which.is_empty() {
                write_channel(out, (input, channel, values.sharpness));
                line(out, which);
            }
            let of = |x: &[f64; 2]| x[place];
            line(out, &format!("mass = {:?}", of(&values.mass)));
            line(out, &format!("com = {:?}", values.com.each_ref().map(of)));
            let inertia = values.inertia.each_ref().map(of);
            line(out, &format!("inertia = {inertia:?}"));
            line(out, &format!("rotor_inertia = {:?}", of(&values.rotor)));
            line(out, &format!("coulomb = {:?}", of(&values.coulomb)));
            line(out, &format!("viscous = {:?}", of(&values.viscous)));
            line(out, &format!("motor_gain = {:?}", of(&values.gain)));
        }
        if let Some(servo) = self.servo(index) {
            write_servo(out, servo);
        }
        if let Some(known) = self.drive_model(index) {
            line(out, "[joint.drive_model]");
            line(out, &format!("mass = {:?}", known.mass));
            line(out, &format!("com = {:?}", known.com));
            line(out, &format!("inertia = {:?}", known.inertia));
            line(out, &format!("rotor_inertia = {:?}", known.rotor_inertia));
            line(out, &format!("motor_gain = {:?}", known.motor_gain));
        }
    }

    fn write_effects(&self, out: &mut String) {
        for effect in &self.effects {
            line(out, "\n[[effect]]");
            line(out, &format!("id = {}", text(&effect.id.value)));
            if let Some(joint) = &effect.joint {
                let name = &self.robot.joints[joint.value].name;
                line(out, &format!("joint = {}", text(name)));
            }
            line(out, "[effect.parameters]");
            for p in &effect.parameters {
                let mut value = format!("value = {:?}", p.value.value);
                if let Some(unit) = &p.unit {
                    let _ = write!(value, ", unit = {}", text(&unit.value));
                }
                if let Some((low, high)) = p.interval {
                    let _ = write!(value, ", interval = [{low:?}, {high:?}]");
                }
                line(out, &format!("{} = {{ {value} }}", p.name));
            }
        }
    }

    fn write_simulated(&self, out: &mut String) {
        let Some(simulated) = &self.simulated else {
            return;
        };
        line(out, "\n[simulated]");
        line(out, &format!("substeps = {}", simulated.substeps));
        line(
            out,
            &format!("short_substeps = {}", simulated.short_substeps),
        );
        line(out, &format!("hidden_states = {}", simulated.hidden_states));
        let records: Vec<String> = simulated.fitted_records.iter().map(|r| text(r)).collect();
        line(out, &format!("fitted_records = [{}]", records.join(", ")));
        for j in &simulated.joints {
            line(out, "[[simulated.joint]]");
            let numbers = [
                ("position_noise", j.position_noise),
                ("velocity_noise", j.velocity_noise),
                ("torque_noise", j.torque_noise),
                ("passed_noise", j.passed_noise),
                ("torque", j.torque),
                ("inertia", j.inertia),
            ];
            for (key, x) in numbers {
                line(out, &format!("{key} = {x:?}"));
            }
        }
    }
}

fn write_channel(out: &mut String, (input, channel, sharpness): (&str, &super::Channel, f64)) {
    line(out, &format!("sharpness = {sharpness:?}"));
    line(out, &format!("input = \"{input}\""));
    let (word, noise) = match channel.velocity {
        Velocity::Measured { noise } => ("measured", noise),
        Velocity::Derived { .. } => ("derived", None),
        Velocity::Absent => ("absent", None),
    };
    line(out, &format!("velocity = \"{word}\""));
    let numbers = [
        ("dq_noise_std", noise),
        ("q_noise_std", channel.position_noise),
        ("q_resolution", channel.position_resolution),
        ("input_noise_std", channel.input_noise),
        ("torque_peak", channel.torque_peak),
        ("speed_scale", channel.speed_scale),
    ];
    for (key, value) in numbers {
        if let Some(x) = value {
            line(out, &format!("{key} = {x:?}"));
        }
    }
}

fn write_servo(out: &mut String, servo: &Servo) {
    line(out, "[joint.drive]");
    line(out, &format!("law = \"{}\"", servo.law.word()));
    for gain in servo.gains() {
        let value = servo::written(servo.gain(gain));
        line(out, &format!("{} = {value}", gain.key()));
    }
    for (key, x) in servo.stated() {
        line(out, &format!("{key} = {x:?}"));
    }
}

fn line(out: &mut String, text: &str) {
    out.push_str(text);
    out.push('\n');
}

fn text(x: &str) -> String {
    toml::Value::from(x).to_string()
}

/// A description states numbers where the language of robots allows expressions.
fn number(x: &Expr) -> f64 {
    match x {
        Expr::Num(x) => *x,
        _ => f64::NAN,
    }
}
