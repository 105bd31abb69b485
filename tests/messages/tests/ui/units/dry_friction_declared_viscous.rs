use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;

        params {
            m1: kg = 6.0 in 0.5..=30.0;
            m2: kg = 23.0 in 1.0..=60.0;
            sz2: m = 0.2875 in 0.0..=0.6;
            iz1: kg*m^2 = 0.03 in 1e-3..=1.0;
        }

        link upper { mass: m1; com: [0.1, 0, _] m; inertia at com: diag(_, _, iz1); }
        link fore { mass: m2; com: [0, 0, sz2]; inertia at com: diag(0.6, 0.6, 0.1) kg*m^2; }

        joint shoulder: revolute about z { base -> upper; }
        joint elbow: revolute about y { upper -> fore at [0, 0, 0.3] m; }

        per joint {
            input current: A;
            dry: N*m*s/rad = [1.0, 2.0] in 0.0..=20.0;
            gain: N*m/A = [0.7, 0.4] in 0.05..=5.0;
            sharp: s/rad = 50.0 in 5.0..=200.0;
            force = gain*current - dry*tanh(sharp*v);
        }
    }
}

fn main() {}
