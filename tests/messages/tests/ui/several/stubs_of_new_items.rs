use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        params { m: kg = 1.0 in 0.1..=5.0; }
        link upper { inertial: solid cylinder { mass: m; radius: 30 mm; length: 0.3 s; axis: z; } }
        link fore { mass: 1 kg; com: [0, 0, 0.1] m; }
        joint shoulder: revolute about y { base -> upper; }
        joint elbow: revolute about y { upper -> fore at [0, 0, 0.3] m; }
        motor wrist: shoulder + elbow { dry: N*m = 0.1 in 0.0..=1.0; drive: torque; force = -dry*tanh(v); }
        variant Held { lock elbow = 1 m; }
    }
}

fn main() {
    // The robot and its variant are broken, their uses are not.
    let p = ArmParams { m: 2.0, dry_wrist: 0.4 };
    let u = ArmInputs { torque_wrist: 1.0 };
    let _ = (Arm::forward_dynamics(&[0.0; 2], &[0.0; 2], &u, &p), ArmJoint::Elbow);
    let (p, u) = (HeldParams { m: 2.0, dry_wrist: 0.4 }, HeldInputs { torque_wrist: 1.0 });
    let _ = (Held::forward_dynamics(&[0.0], &[0.0], &u, &p), HeldJoint::Shoulder);
    let _: [&dyn pid_runtime::dynamics::Hessian; 2] = [&Arm, &Held];
}
