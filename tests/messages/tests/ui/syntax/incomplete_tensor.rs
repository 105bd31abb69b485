use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;

        params {
            m1: kg = 1.0 in 0.1..=5.0;
            l1: m = 0.3 in 0.1..=1.0;
        }

        link rod {
            mass: m1;
            com: [0, 0, l1];
            inertia at com: [xx: 0.01, yy: 0.01, zz: 0.001] kg*m^2;
        }

        joint pivot: revolute about y { base -> rod; }

        per joint {
            input torque: N*m;
            viscous: N*m*s/rad = 0.1 in 0.0..=1.0;
            force = torque - viscous*v;
        }
    }
}

fn main() {}
