use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        link upper { mass: 2 kg; com: [0, 0, 0.2] m; inertia at com: diag(0.02, 0.02, 0.001) kg*m^2; }
        link fore { mass: 1 kg; com: [0, 0, 0.1] m; inertia at com: diag(0.01, 0.01, 0.001) kg*m^2; }
        joint shoulder: revolute about y { base -> upper; }
        joint elbow: revolute about y { upper -> fore at [0, 0, 0.4] m; }
        per joint { input torque: N*m; force = torque; }
        input push: N*m;
        input push: N*m;
        force on elbow = push;
        emit { dynamics }
    }
}

fn main() {}
