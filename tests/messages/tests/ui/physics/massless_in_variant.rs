use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        link upper { }
        link fore { mass: 1 kg; com: [0, 0, 0.1] m; }
        joint shoulder: revolute about z { base -> upper; }
        joint elbow: revolute about y { upper -> fore; }
        per joint { rotor: kg*m^2 = 0.1 in 0.0..=1.0; force = -rotor*v/(1 s); }
        variant Held { lock elbow = 0 rad; }
        emit { dynamics }
    }
}

fn main() {}
