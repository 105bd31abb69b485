use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;

        params {
            m1: kg = 1.0 in 0.1..=5.0;
            l1: m = 0.3 in 0.1..=1.0;
        }

        link rod {
            mass: m3;
            com: [0, 0, l1];
            inertia at com: diag(0.01, 0.01, 0.001) kg*m^2;
        }

        joint pivot: revolute about y { base -> rod; }

        per joint {
            input torque: N*m;
            viscous: N*m*s/rad = 0.1 in 0.0..=1.0;
            force = torque - viscous*v;
        }
    }
}

fn main() {
    // The robot is broken, its uses are not.
    let p = ArmParams { m1: 2.0, l1: 0.4, viscous_pivot: 0.2 };
    let u = ArmInputs { torque_pivot: 1.0 };
    let a = Arm::forward_dynamics(&[0.0], &[0.0], &u, &p);
    let _ = (a, ArmJoint::Pivot, ArmParam::M1.name());
    let _: &dyn pid_runtime::dynamics::Hessian = &Arm;
}
