use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;

        link rod {
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
