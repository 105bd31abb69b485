use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        link upper { mass: 2 kg; com: [0, 0, 0.2] m; inertia at com: diag(0.02, 0.02, 0.001) kg*m^2; }
        link fore { mass: 1 kg; com: [0, 0, 0.1] m; inertia at com: diag(0.01, 0.01, 0.001) kg*m^2; }
        link tool { mass: 0.1 kg; }
        joint shoulder: revolute about y { base -> upper; }
        joint elbow: revolute about y { upper -> fore at [0, 0, 0.4] m; }
        joint hand: revolute about y { fore -> tool at [0, 0, 0.2] m; follows -elbo; }
        per joint { input torque: N*m; force = torque; }
        emit { dynamics }
    }
}

fn main() {}
